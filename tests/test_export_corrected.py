"""Reflectance at one geometry, and standard deviations along directions: against what is known by hand."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import published
from photoclinometry.output.export.corrected import corrected_reflectance
from scenes import LUNAR_LAMBERT, synthetic_scene


@pytest.mark.parametrize("model", [LUNAR_LAMBERT, published("mcewen")], ids=["absolute", "relative"])
def test_exact_brightness_gives_the_albedo_at_the_standard_geometry(model):
    scene = synthetic_scene(size=10, views=5, reflectance=model)
    np.testing.assert_allclose(corrected_reflectance(scene, (0.0, 0.0, 0.0)), scene.landmarks.albedo, rtol=1e-9)
    rho = float(model(np.cos(np.radians(30.0)), 1.0, np.radians(30.0)))
    found = corrected_reflectance(scene, (30.0, 0.0, 30.0))
    np.testing.assert_allclose(found, rho * scene.landmarks.albedo, rtol=1e-9)


def test_it_is_of_what_was_measured_not_of_the_albedo_map():
    scene = synthetic_scene(size=10, views=5)
    tracks = replace(scene.tracks, brightness=1.1 * scene.tracks.brightness)
    dull = replace(scene.landmarks, albedo=0.5 * scene.landmarks.albedo)
    found = corrected_reflectance(replace(scene, tracks=tracks, landmarks=dull), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(found, 1.1 * scene.landmarks.albedo, rtol=1e-9)


def test_shadows_do_not_count_and_who_was_never_lit_has_no_value():
    scene = synthetic_scene(size=10, views=5)
    lit, level = scene.tracks.lit.copy(), scene.tracks.brightness.copy()
    level[3::5], lit[3::5] = 1e6, False
    lit[:5] = False
    found = corrected_reflectance(replace(scene, tracks=replace(scene.tracks, lit=lit, brightness=level)), (0, 0, 0))
    assert np.isnan(found[0])
    np.testing.assert_allclose(found[1:], scene.landmarks.albedo[1:], rtol=1e-9)


@pytest.mark.parametrize("geometry", [(90.0, 0.0, 90.0), (30.0, 0.0, 20.0), (30.0, 10.0, 41.0), (-1.0, 0.0, 1.0)])
def test_a_geometry_that_cannot_be_is_refused(geometry):
    with pytest.raises(InputError, match="--standard-geometry-deg"):
        corrected_reflectance(synthetic_scene(size=4, views=3), geometry)


def test_geometry_alone_has_no_reflectance():
    with pytest.raises(InputError, match="geometry alone"):
        corrected_reflectance(synthetic_scene(size=4, views=3, reflectance=None), (30, 0, 30))
