"""COLMAP models that we write are what pycolmap reads, and the other way round."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from photoclinometry.io.models.colmap import read_colmap, write_colmap
from photoclinometry.model.errors import InputError
from scenes import synthetic_scene

PUBLISHED = Path(__file__).parents[2] / "shared" / "data" / "vesta-opnav022" / "published"


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=12, views=4)


@pytest.fixture
def folder(tmp_path, scene):
    write_colmap(tmp_path / "sparse", scene)
    return tmp_path / "sparse"


def test_pycolmap_reads_the_same_poses_and_cameras(folder, scene):
    model = pycolmap.Reconstruction(folder)
    for k, name in enumerate(scene.views.name):
        image = model.find_image_with_name(name)
        cam_from_body = scene.views.body_from_cam[k].inverse()
        found = image.cam_from_world()
        np.testing.assert_allclose(found.rotation.matrix(), cam_from_body.rotation, atol=1e-12)
        np.testing.assert_allclose(found.translation, cam_from_body.translation, rtol=1e-12, atol=1e-9)
        assert image.camera.model_name == scene.views.cameras[k].model
        np.testing.assert_array_equal(image.camera.params, scene.views.cameras[k].params)
        assert (image.camera.width, image.camera.height) == (
            scene.views.cameras[k].width,
            scene.views.cameras[k].height,
        )


def test_pycolmap_reads_tracks_that_project_onto_their_keypoints(folder, scene):
    model = pycolmap.Reconstruction(folder)
    assert model.is_valid()
    assert model.num_points3D() == len(scene.landmarks)
    assert model.compute_num_observations() == len(scene.tracks)
    for point in model.points3D.values():
        assert point.error < 1e-6
        for element in point.track.elements:
            image = model.images[element.image_id]
            keypoint = image.points2D[element.point2D_idx]
            np.testing.assert_allclose(image.project_point(point.xyz), keypoint.xy, atol=1e-7)


def test_our_reader_returns_what_was_written(folder, scene):
    names, cameras, body_from_cam, points = read_colmap(folder)
    assert names == scene.views.name
    assert cameras == scene.views.cameras
    np.testing.assert_allclose(body_from_cam.rotation, scene.views.body_from_cam.rotation, atol=1e-12)
    np.testing.assert_allclose(body_from_cam.translation, scene.views.body_from_cam.translation, rtol=1e-12)
    np.testing.assert_array_equal(points, scene.landmarks.position)


def test_our_reader_agrees_with_pycolmap_on_its_own_files(tmp_path, folder, scene):
    pycolmap.Reconstruction(folder).write(tmp_path)
    names, _, body_from_cam, points = read_colmap(tmp_path)
    assert names == scene.views.name
    np.testing.assert_allclose(body_from_cam.translation, scene.views.body_from_cam.translation, rtol=1e-12)
    assert len(points) == len(scene.landmarks)


def test_large_scenes_are_thinned_evenly(tmp_path, scene):
    write_colmap(tmp_path / "sparse", scene, max_points=10)
    model = pycolmap.Reconstruction(tmp_path / "sparse")
    assert model.is_valid()
    assert model.num_points3D() == 10
    assert model.compute_mean_reprojection_error() < 1e-6


def test_brighter_albedo_is_a_brighter_point(folder, scene):
    model = pycolmap.Reconstruction(folder)
    grey = np.array([model.points3D[1 + j].color[0] for j in range(len(scene.landmarks))])
    order = np.argsort(scene.landmarks.albedo)
    assert (np.diff(grey[order].astype(int)) >= 0).all()
    assert grey.max() == 255


def test_writing_again_replaces_the_folder(folder, scene):
    (folder / "stale").touch()
    write_colmap(folder, scene)
    assert sorted(p.name for p in folder.iterdir()) == ["cameras.bin", "images.bin", "points3D.bin"]
    assert [p.name for p in folder.parent.iterdir()] == ["sparse"]


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_model_cut_short_anywhere_is_refused(folder, name):
    whole = (folder / name).read_bytes()
    for size in np.unique(np.linspace(0, len(whole) - 1, 40).astype(int)):
        (folder / name).write_bytes(whole[:size])
        with pytest.raises(InputError, match=name):
            read_colmap(folder)


def test_a_missing_file_is_named(folder):
    (folder / "images.bin").unlink()
    with pytest.raises(InputError, match=r"images\.bin: there is no such file"):
        read_colmap(folder)


def test_distorted_cameras_are_refused_with_the_cure(folder):
    model = pycolmap.Reconstruction(folder)
    for camera in model.cameras.values():
        camera.model = pycolmap.CameraModelId.SIMPLE_RADIAL
        camera.params = [1000.0, 50.0, 50.0, 0.1]
    model.write(folder)
    with pytest.raises(InputError, match="undistort"):
        read_colmap(folder)


@pytest.mark.data
def test_the_published_vesta_model_is_read_as_pycolmap_reads_it():
    if not PUBLISHED.exists():
        pytest.skip(f"the published Vesta model is not at {PUBLISHED}")
    names, cameras, body_from_cam, points = read_colmap(PUBLISHED)
    model = pycolmap.Reconstruction(PUBLISHED)
    assert names == ("00000000.png", "00000001.png", "00000002.png", "00000004.png")
    assert {c.model for c in cameras} == {"PINHOLE"}
    for k, name in enumerate(names):
        center = model.find_image_with_name(name).projection_center()
        np.testing.assert_allclose(body_from_cam.translation[k], center, rtol=1e-12)
    expected = sorted(tuple(p.xyz) for p in model.points3D.values())
    np.testing.assert_array_equal(sorted(map(tuple, points)), expected)
