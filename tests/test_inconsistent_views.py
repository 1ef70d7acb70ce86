"""Views that contradict the others are named and left out; sound ones are kept, and undecided ones too."""

import re
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import so3_exp, unit
from photoclinometry.model.reflectance import published
from photoclinometry.model.warning import collected_warnings
from photoclinometry.photometry.inconsistent_views import _SunChecks, find_inconsistent_views, inconsistent_views
from scenes import sparse_model_of, synthetic_images, synthetic_scene


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=20, views=8, brightness_noise=0.01)


def turned(scene, view, degrees, axis=(0.3, 1.0, 0.0)):
    """The scene with one Sun turned about an axis square to it."""
    sun = scene.views.sun.copy()
    about = unit(np.cross(sun[view], axis))
    sun[view] = so3_exp(np.radians(degrees) * about) @ sun[view]
    return replace(scene, views=replace(scene.views, sun=sun))


def only(scene, count):
    """The first `count` views of the scene."""
    tracks = scene.tracks
    kept = tracks.view < count
    per = ("view", "keypoint", "keypoint_sigma", "brightness", "lit")
    fewer = replace(
        tracks,
        start=np.arange(len(scene.landmarks) + 1, dtype=np.int64) * count,
        **{name: getattr(tracks, name)[kept] for name in per},
    )
    return replace(scene, views=scene.views[:count], tracks=fewer)


@pytest.mark.parametrize("reflectance", [published("lunar-lambert", "vesta"), published("mcewen")], ids=["iof", "dn"])
def test_sound_views_are_kept(reflectance):
    assert (
        inconsistent_views(synthetic_scene(size=20, views=7, reflectance=reflectance, brightness_noise=0.02)).left_out
        == ()
    )


@pytest.mark.parametrize("degrees", [10, 30, 90, 180])
def test_a_view_with_a_wrong_sun_is_left_out_and_no_other(scene, degrees):
    ((view, why),) = inconsistent_views(turned(scene, 3, degrees)).left_out
    assert view == 3
    assert f"its Sun is {degrees} degrees off" in why


def test_a_sun_within_its_stated_sigma_is_right(scene):
    """Ten degrees off at a sigma of ten degrees: nothing is wrong."""
    off = turned(scene, 3, 10)
    assert (
        inconsistent_views(replace(off, views=replace(off.views, sun_sigma=np.full(8, np.radians(10.0))))).left_out
        == ()
    )


def with_other_ground(scene, views):
    """The scene with some views' brightness taken from another place."""
    other = synthetic_scene(size=20, views=8, seed=1).tracks.brightness.reshape(400, 8)[::-1].ravel()
    tracks = scene.tracks
    return replace(
        scene, tracks=replace(tracks, brightness=np.where(np.isin(tracks.view, views), other, tracks.brightness))
    )


@pytest.mark.parametrize("view", [1, 6])
def test_a_view_of_other_ground_is_left_out(scene, view):
    ((found, why),) = inconsistent_views(with_other_ground(scene, [view])).left_out
    assert found == view
    assert "shows another place" in why


@pytest.mark.parametrize("factor", [5.0, 0.25])
def test_a_view_of_another_exposure_is_left_out(scene, factor):
    tracks = scene.tracks
    brightness = np.where(tracks.view == 3, factor, 1.0) * tracks.brightness
    ((view, why),) = inconsistent_views(replace(scene, tracks=replace(tracks, brightness=brightness))).left_out
    assert view == 3
    said = re.fullmatch(r"it is (\S+) times as bright .*: check its exposure and its unit", why)
    assert said is not None
    assert float(said[1]) == pytest.approx(factor, rel=0.02)


def test_a_view_with_hardly_a_lit_point_is_not_judged_by_its_exposure(scene):
    """Of its ten lit points, which are five times as bright as they should be."""
    tracks = scene.tracks
    of_view = np.flatnonzero(tracks.view == 3)
    lit, brightness = tracks.lit.copy(), tracks.brightness.copy()
    lit[of_view[10:]] = False
    brightness[of_view] *= 5.0
    assert inconsistent_views(replace(scene, tracks=replace(tracks, lit=lit, brightness=brightness))).left_out == ()


def test_exposures_of_uncalibrated_views_and_of_few_are_free(scene):
    dn = synthetic_scene(size=20, views=8, reflectance=published("mcewen"), brightness_noise=0.01)
    for one in (dn, only(scene, 4)):
        brightness = np.where(one.tracks.view == 3, 5.0, 1.0) * one.tracks.brightness
        assert inconsistent_views(replace(one, tracks=replace(one.tracks, brightness=brightness))).left_out == ()


def test_another_reflectance_model_is_no_reason(scene):
    """Ground of Lunar-Lambert taken for McEwen's."""
    assert inconsistent_views(replace(scene, reflectance=published("mcewen"))).left_out == ()


@pytest.mark.parametrize("count", [3, 4])
def test_of_few_views_none_is_left_out(scene, count):
    found = inconsistent_views(turned(only(scene, count), 1, 90))
    assert found.left_out == ()
    assert 1 in found.doubtful


@pytest.mark.parametrize("degrees", [0, 90])
def test_few_views_do_not_say_that_the_suns_as_a_whole_are_wrong(degrees):
    """The ground from three others is off by itself: sound views are up to 35 degrees beside it. Such a map is made."""
    four = only(synthetic_scene(size=20, views=8, brightness_noise=0.01, seed=5), 4)
    with collected_warnings() as warnings:
        found = inconsistent_views(turned(four, 1, degrees))
    assert found.left_out == ()
    assert bool(found.doubtful) == bool(degrees)
    assert warnings == []


def test_of_six_views_the_wrong_one_is_left_out(scene):
    assert [view for view, _ in inconsistent_views(turned(only(scene, 6), 1, 90)).left_out] == [1]


def test_where_a_contradiction_is_undecided_some_views_are_doubtful_and_all_are_kept(scene):
    """Two views of eight agree with each other against the rest, whose ground they distort."""
    found = inconsistent_views(with_other_ground(scene, [1, 6]))
    assert found.left_out == ()
    assert found.doubtful


@pytest.mark.parametrize(("degrees", "codes"), [(8.0, []), (18.0, ["most-suns-contradict"])])
def test_suns_as_a_whole_are_wrong_only_where_the_typical_one_is_far_off(scene, monkeypatch, degrees, codes):
    """8 degrees, 6.8 per axis, are those of a sound site whose sparse ground is coarse, whatever the fits' sigmas: its
    views are doubtful, and the map decides."""
    count = len(scene.views)
    found = _SunChecks(
        off=np.full(count, np.radians(degrees)), sigma=np.full(count, np.radians(1.3)), explained=np.ones(count)
    )
    monkeypatch.setattr("photoclinometry.photometry.inconsistent_views._check_suns", lambda *_: found)
    with collected_warnings() as warnings:
        found = inconsistent_views(scene)
    assert found.left_out == ()
    assert found.doubtful == (() if codes else tuple(range(count)))
    assert [warned.code for warned in warnings] == codes


def test_reversed_suns_of_all_views_are_refused_with_the_convention():
    scene = synthetic_scene(size=20)
    images, flipped = synthetic_images(scene), replace(scene.views, sun=-scene.views.sun)
    with pytest.raises(InputError, match=r"lights 0 % .* in 6 of 6 views; `sun` points from the body"):
        find_inconsistent_views(sparse_model_of(scene), images, flipped, scene.reflectance, "iof")


def test_inconsistent_views_are_numbered_among_all_views():
    """View 1 is not registered; the wrong one keeps its number."""
    scene = turned(synthetic_scene(size=30, views=8), 4, 90)
    images = synthetic_images(synthetic_scene(size=30, views=8))
    registered = np.arange(8) != 1
    found = find_inconsistent_views(sparse_model_of(scene, registered), images, scene.views, scene.reflectance, "iof")
    assert np.flatnonzero(found.left_out).tolist() == [4]
    assert "degrees off" in found.reason[4]
    assert not "".join(np.delete(found.reason, 4))


def test_with_too_few_points_no_view_is_left_out():
    scene = turned(synthetic_scene(size=7), 2, 90)
    found = find_inconsistent_views(
        sparse_model_of(scene), synthetic_images(scene), scene.views, scene.reflectance, "iof"
    )
    assert not found.left_out.any()
