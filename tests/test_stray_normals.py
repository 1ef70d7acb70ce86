"""Normals that have strayed are fitted again from their neighbours', where that explains the images."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.pipeline.checks.stray_normals import with_strays_fitted_again
from scenes import synthetic_scene

STRAYS = [33, 150, 151]


@pytest.fixture(scope="module")
def true():
    return synthetic_scene(size=20, views=6, brightness_noise=0.003)


@pytest.fixture(scope="module")
def astray(true):
    """Three normals, two of them side by side, point away from most Suns, with twice their albedo."""
    normal, albedo = true.landmarks.normal.copy(), true.landmarks.albedo.copy()
    normal[STRAYS] = unit(normal[STRAYS] - 1.6 * true.views.sun[0])
    albedo[STRAYS] *= 2.0
    return replace(true, landmarks=replace(true.landmarks, normal=normal, albedo=albedo))


def test_strayed_normals_and_albedos_come_back_to_the_truth(true, astray):
    found = with_strays_fitted_again(astray)
    off = np.degrees(angle_between(found.landmarks.normal, true.landmarks.normal))
    assert np.degrees(angle_between(astray.landmarks.normal, true.landmarks.normal))[STRAYS].min() > 60.0
    assert off[STRAYS].max() < 1.0
    np.testing.assert_allclose(found.landmarks.albedo[STRAYS], true.landmarks.albedo[STRAYS], rtol=0.02)


def test_all_others_stay_and_so_do_positions(astray):
    found = with_strays_fitted_again(astray)
    others = np.setdiff1d(np.arange(len(astray.landmarks)), STRAYS)
    np.testing.assert_array_equal(found.landmarks.normal[others], astray.landmarks.normal[others])
    np.testing.assert_array_equal(found.landmarks.albedo[others], astray.landmarks.albedo[others])
    assert found.landmarks.position is astray.landmarks.position


def test_what_no_normal_explains_stays(true):
    """Brightness of one landmark in two of six views as at the edge of a shadow."""
    tracks = true.tracks
    spoiled = np.flatnonzero(tracks.landmark == STRAYS[0])[:2]
    brightness = tracks.brightness.copy()
    brightness[spoiled] *= (0.3, 3.0)
    scene = replace(true, tracks=replace(tracks, brightness=brightness))
    found = with_strays_fitted_again(scene)
    np.testing.assert_array_equal(found.landmarks.normal, scene.landmarks.normal)


def test_explained_maps_and_those_of_geometry_alone_stay(true):
    assert with_strays_fitted_again(true) is true
    alone = synthetic_scene(size=6, views=3, reflectance=None)
    assert with_strays_fitted_again(alone) is alone
