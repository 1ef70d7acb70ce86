"""Albedos that no image tells are those of the landmarks beside."""

from dataclasses import replace

import numpy as np

from photoclinometry.pipeline.checks.unknown_albedos import with_neighbours_albedos
from scenes import synthetic_scene


def stating(scene, share):
    return replace(scene, uncertainty={"albedo_relative": share * scene.landmarks.albedo})


def test_an_albedo_that_is_not_known_is_that_of_a_neighbour_and_says_so():
    true = synthetic_scene(size=12, views=4)
    row, col = true.cells
    at = int(np.flatnonzero((row == 5) & (col == 7))[0])
    beside = np.flatnonzero(np.abs(row - 5) + np.abs(col - 7) == 1)
    albedo, share = true.landmarks.albedo.copy(), np.full(len(true.landmarks), 0.01)
    albedo[at], share[at] = 2.5, np.inf
    scene = stating(replace(true, landmarks=replace(true.landmarks, albedo=albedo)), share)
    found = with_neighbours_albedos(scene)
    assert found.landmarks.albedo[at] in true.landmarks.albedo[beside]
    others = np.arange(len(albedo)) != at
    np.testing.assert_array_equal(found.landmarks.albedo[others], albedo[others])
    assert np.isinf(found.uncertainty["albedo_relative"][at])


def test_albedos_stay_where_all_none_or_nothing_is_known():
    true = synthetic_scene(size=6, views=3)
    count = len(true.landmarks)
    for scene in (stating(true, np.full(count, 0.02)), stating(true, np.full(count, np.inf)), true):
        assert with_neighbours_albedos(scene) is scene
