"""A scene comes back from its file exactly, and nothing else passes for a scene."""

from dataclasses import fields, is_dataclass, replace

import h5py
import numpy as np
import pytest

from photoclinometry.io.scene_file import read_scene, write_scene
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.reflectance import Reflectance, published
from photoclinometry.model.scene import BODY_FIXED, OWN, Surroundings
from scenes import synthetic_scene, thinned


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=6, views=4, keypoint_noise_px=0.1)


def assert_same(a, b, where="scene"):
    """Every field equal in value and type, arrays bit by bit (NaN equals NaN)."""
    assert type(a) is type(b), where
    if is_dataclass(a):
        for f in fields(a):
            assert_same(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")
    elif isinstance(a, np.ndarray):
        assert (a.dtype, a.shape) == (b.dtype, b.shape), where
        assert a.tobytes() == b.tobytes(), where
    elif isinstance(a, dict):
        assert a.keys() == b.keys(), where
        for key in a:
            assert_same(a[key], b[key], f"{where}[{key}]")
    else:
        assert a == b, where


def variants(scene):
    count = len(scene.landmarks)
    second = Camera("SIMPLE_PINHOLE", 64, 48, (1e4 / 3, 32.1, 24.7))
    views = replace(
        scene.views,
        cameras=(second, *scene.views.cameras[1:]),
        name=("bilder/größe 1.fits", *scene.views.name[1:]),
    )
    yield "plain", scene
    yield "geometry alone", replace(scene, reflectance=None)
    yield "hapke", replace(scene, reflectance=published("hapke", "ceres"))
    yield "no phase function", replace(scene, reflectance=Reflectance("mcewen"), brightness="dn")
    yield "body and several cameras", replace(scene, body="vesta", views=views, reference=2, frame=BODY_FIXED)
    yield (
        "uncertainty",
        replace(
            scene,
            uncertainty={
                "position": np.full((count, 3), 0.1),
                "albedo": np.linspace(0, 1, count, dtype=np.float32),
                "sun": np.full((4, 2), np.nan),
                "something_new": np.zeros((count, 3, 3)),
            },
        ),
    )
    camera = scene.views.cameras[0]
    depth = np.full((-(-camera.height // 4), -(-camera.width // 4)), 6e5)
    depth[2:5, 3] = np.nan
    yield "surroundings", replace(scene, surroundings=Surroundings(depth=depth, stride=4))


@pytest.mark.parametrize("number", range(6))
def test_reading_gives_back_every_field_exactly(tmp_path, scene, number):
    _, written = list(variants(scene))[number]
    write_scene(tmp_path / "scene.h5", written)
    assert_same(written, read_scene(tmp_path / "scene.h5"))


def test_the_frame_is_told_and_files_that_do_not_know_of_it_are_read(tmp_path, scene):
    """A body-fixed scene's lengths are metres. Files of before say nothing, others nonsense."""
    path = tmp_path / "scene.h5"
    write_scene(path, replace(scene, frame=BODY_FIXED))
    with h5py.File(path, "r+") as file:
        assert file["landmarks/position"].attrs["unit"] == "m"
        assert file["views/translation"].attrs["unit"] == "m"
        del file.attrs["frame"]
    assert read_scene(path).frame == OWN
    with h5py.File(path, "r+") as file:
        file.attrs["frame"] = "galactic"
    with pytest.raises(RunFolderError, match=r"contradicts itself \(its frame is 'galactic'\)"):
        read_scene(path)


def test_the_stride_comes_back_and_files_that_do_not_know_of_it_have_every_pixel(tmp_path, scene):
    path, thin = tmp_path / "scene.h5", thinned(scene, 2)
    write_scene(path, thin)
    assert_same(thin, read_scene(path))
    with h5py.File(path, "r+") as file:
        del file["region"].attrs["stride"]
    assert read_scene(path).region == replace(thin.region, stride=1)
    for stride in (0, 3):
        with h5py.File(path, "r+") as file:
            file["region"].attrs["stride"] = stride
        with pytest.raises(RunFolderError, match="off the map's grid"):
            read_scene(path)


def test_surroundings_of_another_image_contradict_the_scene(tmp_path, scene):
    path = tmp_path / "scene.h5"
    write_scene(path, replace(scene, surroundings=Surroundings(depth=np.ones((5, 5)), stride=4)))
    with pytest.raises(RunFolderError, match="surroundings have not the size of the reference image"):
        read_scene(path)


def test_every_dataset_says_its_unit_frame_and_meaning(tmp_path, scene):
    write_scene(tmp_path / "scene.h5", list(variants(scene))[4][1])
    found = []
    with h5py.File(tmp_path / "scene.h5") as file:
        file.visititems(lambda name, item: found.append((name, item)) if hasattr(item, "shape") else None)
        assert len(found) > 20
        for name, dataset in found:
            assert {"unit", "frame", "description"} <= dataset.attrs.keys(), name
        assert file["landmarks/position"].attrs["frame"] == "B"
        assert file["landmarks/albedo"].attrs["unit"] == "I/F"
        assert file["views/sun_sigma"].attrs["unit"] == "rad"


def test_covariances_have_the_square_of_the_unit(tmp_path, scene):
    stated = {"normal": np.zeros((len(scene.landmarks), 2, 2)), "albedo": np.ones(len(scene.landmarks))}
    write_scene(tmp_path / "scene.h5", replace(scene, uncertainty=stated))
    with h5py.File(tmp_path / "scene.h5") as file:
        assert file["uncertainty/normal"].attrs["unit"] == "rad squared"
        assert file["uncertainty/normal"].attrs["description"] == "covariance of normal"
        assert file["uncertainty/albedo"].attrs["unit"] == "I/F"


def test_another_version_is_refused_by_name(tmp_path, scene):
    path = tmp_path / "scene.h5"
    write_scene(path, scene)
    with h5py.File(path, "r+") as file:
        file.attrs["version"] = 99
    with pytest.raises(RunFolderError, match=r"scene\.h5: is a scene of format version 99 .* run the site again"):
        read_scene(path)


def test_other_files_are_refused(tmp_path, scene):
    path = tmp_path / "other.h5"
    with pytest.raises(RunFolderError, match="there is no such file"):
        read_scene(path)
    path.write_text("not HDF5")
    with pytest.raises(RunFolderError, match=r"other\.h5: is not a scene file"):
        read_scene(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(RunFolderError, match="not a photoclinometry scene"):
        read_scene(path)


def test_a_scene_whose_indices_point_outside_is_refused(tmp_path, scene):
    path = tmp_path / "scene.h5"
    for broken, fault in (
        (replace(scene, reference=7), "reference view"),
        (replace(scene, tracks=replace(scene.tracks, view=scene.tracks.view + 1)), "a track names a view"),
        (replace(scene, tracks=replace(scene.tracks, start=scene.tracks.start[:-1])), "different lengths"),
        (replace(scene, region=replace(scene.region, height=3)), "outside the region"),
    ):
        write_scene(path, broken)
        with pytest.raises(RunFolderError, match=fault):
            read_scene(path)


def test_files_written_before_parameters_had_names_are_read(tmp_path):
    """They have the disk function's name, two weights, and the coefficients of the phase function."""
    scene = synthetic_scene(size=6, views=4)
    path = tmp_path / "scene.h5"
    write_scene(path, scene)
    with h5py.File(path, "r+") as file:
        model = file["reflectance"]
        values = model["parameters"][()]
        del model["parameters"], model.attrs["name"]
        model.attrs["disk"], model["weight"], model["phase_coefficients"] = "lunar-lambert", values[:2], values[2:]
    assert read_scene(path).reflectance == scene.reflectance
