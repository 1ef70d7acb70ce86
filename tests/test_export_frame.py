"""In which frame a scene is exported: what is said must hold together, and a wrong place is refused, not mapped."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.io.similarity import read_similarity, write_similarity
from photoclinometry.io.site import Site, SiteView, write_site
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.output.export import ExportOptions
from photoclinometry.output.export.frame import framed
from photoclinometry.registration.alignment import transform_scene
from places import IAU_RADIUS, RADIUS, cratered_place

pytest.importorskip("rasterio")


@pytest.fixture(scope="module")
def place():
    return cratered_place(size=16)


def write(path, similarity):
    write_similarity(path, similarity)
    return path


def test_a_transform_puts_the_scene_on_the_body(place, tmp_path):
    path = write(tmp_path / "body_from_scene.toml", place.body_from_scene)
    found = framed(place.scene, ExportOptions(transform=path, body="vesta"))
    distance = np.linalg.norm(found.scene.landmarks.position, axis=-1)
    np.testing.assert_allclose(distance, RADIUS, atol=121.0)
    assert found.globe.radii_m == (IAU_RADIUS, IAU_RADIUS)
    assert "body-fixed" in found.words
    assert found.unit == "m"


def write_site_with_priors(path, place, count):
    """site.toml of the scene's views, the first `count` of which have their true poses as priors."""
    views, moved = place.scene.views, transform_scene(place.body_from_scene, place.scene).views
    cam_from_body = moved.body_from_cam.inverse()
    write_site(
        path,
        Site(
            name="bumps",
            body="vesta",
            brightness="iof",
            views=tuple(
                SiteView(
                    name=name,
                    image=path.parent / name,
                    camera=views.cameras[k],
                    sun=views.sun_measured[k],
                    pose_prior=PosePrior(cam_from_body[k], 1e-4, 10.0) if k < count else None,
                )
                for k, name in enumerate(views.name)
            ),
            region=None,
            path=path,
        ),
    )
    return path


def test_pose_priors_put_the_scene_on_the_body(place, tmp_path):
    path = write_site_with_priors(tmp_path / "site.toml", place, 3)
    found = framed(place.scene, ExportOptions(site=path, body="vesta"))
    expected = place.body_from_scene(place.scene.landmarks.position)
    np.testing.assert_allclose(found.scene.landmarks.position, expected, atol=1e-3)
    assert "by the pose priors of 3 views, off by" in found.words
    with pytest.raises(InputError, match="2 of the 3 views have a pose prior"):
        framed(place.scene, ExportOptions(site=write_site_with_priors(path, place, 2), body="vesta"))
    with pytest.raises(InputError, match="--transform and --site both give"):
        framed(place.scene, ExportOptions(site=path, transform=path))


def test_a_body_fixed_scene_in_kilometres_becomes_metres(place):
    in_km = transform_scene(Similarity(1e-3, np.eye(3), np.zeros(3)) @ place.body_from_scene, place.scene)
    found = framed(in_km, ExportOptions(body_fixed=True, unit_m=1000.0, body="bennu", radii_m=(260e3,)))
    expected = place.body_from_scene(place.scene.landmarks.position)
    np.testing.assert_allclose(found.scene.landmarks.position, expected, rtol=1e-12)
    assert found.globe.name == "Bennu, sphere of 260000 m"


def test_a_run_in_the_frame_of_pose_priors_is_on_the_body_already(place):
    moved = replace(transform_scene(place.body_from_scene, place.scene), frame=BODY_FIXED)
    found = framed(moved, ExportOptions(body="vesta"))
    np.testing.assert_array_equal(found.scene.landmarks.position, moved.landmarks.position)
    assert (found.globe.name, found.metric) == (
        framed(moved, ExportOptions(body="vesta", body_fixed=True)).globe.name,
        True,
    )
    assert "by the pose priors of its run" in found.words
    in_own = framed(moved, ExportOptions(unit_m=1.0))
    assert (in_own.globe, in_own.metric) == (None, True)


def test_a_run_whose_priors_were_not_body_fixed_is_not_put_on_the_body(place):
    local = replace(place.scene, frame=BODY_FIXED)
    with pytest.raises(InputError, match=r"pose priors of its site are not body-fixed.*--unit-m 1"):
        framed(local, ExportOptions(body="vesta"))


def test_a_scene_of_its_own_keeps_its_frame(place):
    assert framed(place.scene, ExportOptions()).scene is place.scene
    found = framed(place.scene, ExportOptions(unit_m=60.0))
    np.testing.assert_allclose(found.scene.landmarks.position, 60.0 * place.scene.landmarks.position)
    assert found.metric
    assert found.globe is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"body_fixed": True, "body": "vesta"}, "--unit-m"),
        ({"body_fixed": True, "unit_m": 60.0, "body": "vesta"}, "m from the centre of Vesta.*not the body-fixed frame"),
        ({"body_fixed": True, "unit_m": 60.0}, "no IAU_2015 reference system is known for body None"),
        ({"unit_m": -1.0}, "unit_m is -1; give above 0"),
        ({"unit_m": float("nan")}, "unit_m is nan; give above 0"),
        ({"projection": "orthographic"}, "--projection is for maps of a body.*--transform"),
        ({"radii_m": (250e3,)}, "--radii-m is for maps of a body"),
        ({"center_deg": (1.0, 2.0), "unit_m": 60.0}, "--center-deg is for maps of a body"),
    ],
)
def test_options_that_contradict_themselves_or_the_scene_are_refused(place, options, message):
    with pytest.raises(InputError, match=message):
        framed(place.scene, ExportOptions(**options))


def test_a_unit_that_is_wrong_by_a_thousand_and_a_frame_inside_out_are_refused(place, tmp_path):
    right = place.body_from_scene
    tiny = Similarity(right.scale / 1e3, right.rotation, right.translation / 1e3)
    below = Similarity(right.scale, right.rotation, right.translation - 2.0 * right(np.zeros(3)))
    for wrong, message in ((tiny, "unit is wrong"), (below, "point into")):
        path = write(tmp_path / "wrong.toml", wrong)
        with pytest.raises(InputError, match=message):
            framed(place.scene, ExportOptions(transform=path, body="vesta"))
    with pytest.raises(InputError, match="already gives"):
        framed(place.scene, ExportOptions(transform=path, body="vesta", unit_m=1.0))


def test_a_scene_of_nothing_or_of_no_numbers_is_refused(place):
    marks = place.scene.landmarks
    names = ("position", "normal", "albedo", "pixel")
    none = replace(marks, **{name: getattr(marks, name)[:0] for name in names})
    broken = replace(marks, position=np.where(np.arange(len(marks))[:, None] == 7, np.nan, marks.position))
    for landmarks in (none, broken):
        with pytest.raises(InputError, match="run the site again"):
            framed(replace(place.scene, landmarks=landmarks), ExportOptions())


def test_a_similarity_file_reads_back(place, tmp_path):
    found = read_similarity(write(tmp_path / "a.toml", place.body_from_scene))
    assert found.scale == place.body_from_scene.scale
    np.testing.assert_array_equal(found.rotation, place.body_from_scene.rotation)
    np.testing.assert_array_equal(found.translation, place.body_from_scene.translation)


GOOD = "scale = 2.0\nrotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\ntranslation = [0, 0, 1]\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD.replace("2.0", "-2.0"), "scale: expected a positive number"),
        (GOOD.replace("[0, 0, 1]]", "[0, 0, -1]]"), "mirrored"),
        (GOOD.replace("[1, 0, 0]", "[1, 0.1, 0]"), "not a rotation"),
        (GOOD.replace("[[1, 0, 0], ", "["), "rotation: expected 3 rows of 3"),
        (GOOD.replace("[[1, 0, 0]", "[[1, 0, inf]"), "rotation: expected 3 rows of 3"),
        (GOOD.replace("[[1, 0, 0]", "[5"), "rotation: expected 3 rows of 3"),
        (GOOD.replace("translation", "translate"), "translation: is missing.*'translate'"),
        (GOOD + "scales = 1\n", "scales: unknown key"),
        ("scale =", "is not valid TOML"),
    ],
)
def test_files_that_hold_no_similarity_are_refused(tmp_path, text, message):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=f"a.toml.*{message}"):
        read_similarity(tmp_path / "a.toml")


def test_a_similarity_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: there is no such file"):
        read_similarity(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"scale = \xff")
    with pytest.raises(InputError, match=r"b\.toml: is not UTF-8"):
        read_similarity(tmp_path / "b.toml")
