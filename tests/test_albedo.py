"""First albedos and scales: recovery of an exact scene, and what happens without light."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import published
from photoclinometry.photometry.albedo import initial_albedo
from scenes import synthetic_scene


def initial(scene, **options):
    landmarks = scene.landmarks
    return initial_albedo(
        landmarks.position, landmarks.normal, scene.tracks, scene.views, scene.reflectance, 0, **options
    )


def test_albedo_of_an_exact_scene_is_exact():
    scene = synthetic_scene(size=20)
    albedo, scale, known = initial(scene)
    np.testing.assert_allclose(albedo, scene.landmarks.albedo, rtol=1e-12)
    np.testing.assert_array_equal(scale, scene.views.scale)
    assert known.all()


def test_scales_of_uncalibrated_views_are_found_relative_to_the_reference():
    scene = synthetic_scene(size=20, reflectance=published("mcewen"))
    start = replace(scene, views=replace(scene.views, scale=np.ones(len(scene.views))))
    albedo, scale, _ = initial(start, estimate_scale=True)
    np.testing.assert_allclose(scale, scene.views.scale / scene.views.scale[0], rtol=1e-9)
    np.testing.assert_allclose(albedo, scene.landmarks.albedo * scene.views.scale[0], rtol=1e-9)


def test_a_landmark_without_light_gets_the_median_albedo_and_is_marked_unknown():
    scene = synthetic_scene(size=20)
    lit = scene.tracks.lit.copy()
    lit[: scene.tracks.start[1]] = False
    albedo, _, known = initial(replace(scene, tracks=replace(scene.tracks, lit=lit)))
    assert not known[0]
    assert known[1:].all()
    assert albedo[0] == np.median(albedo[1:])


def test_light_from_below_is_refused():
    scene = synthetic_scene(size=20)
    with pytest.raises(InputError, match=r"no observation is lit: .* `sun` points from the body towards the Sun"):
        initial(replace(scene, views=replace(scene.views, sun=-scene.views.sun)))
