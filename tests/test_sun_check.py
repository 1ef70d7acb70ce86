"""The coarse map of the sparse points: projections, blur, albedos by medians, and Suns from the other views."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import angle_between, so3_exp
from photoclinometry.model.image import Image
from photoclinometry.model.sampling import blurred
from photoclinometry.photometry.sun_check import (
    MIN_POINTS,
    _albedo_and_gains,
    coarse_scene,
    ground_from_views,
    sun_from_other_views,
)
from scenes import sparse_model_of, synthetic_images, synthetic_scene


def test_points_are_observed_in_every_registered_view_where_they_project():
    scene = synthetic_scene(size=24)
    registered = [True, False, True, True, True, True]
    found = coarse_scene(
        sparse_model_of(scene, registered, 3), synthetic_images(scene), scene.views, scene.reflectance, "iof"
    )
    assert found.views.name == tuple(n for n, there in zip(scene.views.name, registered, strict=True) if there)
    tracks = found.tracks
    np.testing.assert_array_equal(tracks.start, np.arange(0, len(tracks) + 1, 5))
    for k in range(5):
        mine = tracks.view == k
        expected = found.views.project(k, found.landmarks.position[tracks.landmark[mine]])
        np.testing.assert_allclose(tracks.keypoint[mine], expected, atol=1e-9)
    assert tracks.lit.all()


def test_a_blur_takes_the_mean_of_what_is_valid():
    """Constant brightness stays, however many pixels are missing; where most are missing nothing is valid."""
    valid = np.random.default_rng(0).random((40, 40)) < 0.8
    valid[:, 25:] = False
    found = blurred(Image("a", np.where(valid, 3.0, np.nan).astype(np.float32), valid), 2.0)
    np.testing.assert_allclose(found.brightness[found.valid], 3.0, rtol=1e-5)
    np.testing.assert_array_equal(found.valid[10:30, 8:16], valid[10:30, 8:16])
    assert not found.valid[:, 30:].any()


def test_albedos_and_gains_are_those_of_the_majority():
    """Five views, two of them with random brightness: the product of albedo and gain is that of the others."""
    rng = np.random.default_rng(0)
    albedo, gain = rng.uniform(0.1, 0.5, 200), rng.uniform(0.5, 2.0, 5)
    landmark, view = np.repeat(np.arange(200), 5), np.tile(np.arange(5), 200)
    seen = albedo[landmark] * gain[view]
    wrong = view >= 3
    seen[wrong] *= rng.uniform(0.2, 5.0, wrong.sum())
    found, gains = _albedo_and_gains(seen, landmark, view, 201, 5)
    ratio = found[:200] / albedo
    assert np.std(np.log(ratio)) < 0.15
    assert np.isnan(found[200])
    np.testing.assert_allclose(gains[:3] / gains[0], gain[:3] / gain[0], rtol=0.15)


def test_views_out_of_use_do_not_change_the_ground():
    """The wrong Sun of a view out of use changes nothing; in use it turns normals by degrees."""
    scene = synthetic_scene(size=24, views=8, brightness_noise=0.01)
    sun = scene.views.sun.copy()
    sun[2] = so3_exp(np.array([1.5, 0.0, 0.0])) @ sun[2]
    wrong = replace(scene, views=replace(scene.views, sun=sun))
    rest = np.arange(8) != 2
    found, known = ground_from_views(wrong, rest)
    assert known.all()
    np.testing.assert_array_equal(found.landmarks.normal, ground_from_views(scene, rest)[0].landmarks.normal)
    bent = ground_from_views(wrong, np.ones(8, bool))[0]
    off, more = (np.median(angle_between(g.landmarks.normal, scene.landmarks.normal)) for g in (found, bent))
    assert np.degrees(off) < 1.0
    assert 2.0 < np.degrees(more) < 6.0


def test_a_view_takes_no_part_in_its_own_check_and_few_points_give_none():
    scene = synthetic_scene(size=24)
    everyone = np.ones(6, bool)
    assert sun_from_other_views(scene, everyone, 1).off == sun_from_other_views(scene, np.arange(6) != 1, 1).off
    assert sun_from_other_views(scene, everyone, 1).off < np.radians(0.5)
    few = synthetic_scene(size=7)
    assert len(few.landmarks) < MIN_POINTS
    assert sun_from_other_views(few, everyone, 1) is None


@pytest.mark.parametrize("views", [4, 8])
def test_brightness_is_blurred_as_the_planes_blur_the_ground(views):
    """A view's Sun from planes and blurred images of the true ground: within a degree or two."""
    scene = synthetic_scene(size=40, views=views)
    coarse = coarse_scene(
        sparse_model_of(scene, every=2), synthetic_images(scene), scene.views, scene.reflectance, "iof"
    )
    off = [sun_from_other_views(coarse, np.ones(views, bool), k).off for k in range(views)]
    assert np.degrees(max(off)) < 3.0
