"""Holes of a map: filled within reach with the ground around them, and closed by the next matches."""

import numpy as np
import pytest

from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.matching.flow import FlowMatcher
from photoclinometry.matching.hole_filling import fill_holes
from photoclinometry.model.geometry import angle_between
from photoclinometry.pipeline.relighting import rematch
from scenes import synthetic_images, synthetic_scene, thinned, with_landmarks


def holed(size, hole, stride=1):
    """A scene, the same without the landmarks of a square in its middle, and (J,) bool: the landmarks left out."""
    scene = thinned(synthetic_scene(size=size, views=7), stride)
    row, col = stride * np.array(scene.cells)
    low, high = (size - hole) // 2, (size + hole) // 2
    inside = (row >= low) & (row < high) & (col >= low) & (col < high)
    return scene, with_landmarks(scene, ~inside), inside


@pytest.mark.parametrize("stride", [1, 2])
def test_holes_are_filled_with_the_ground_around_them(stride):
    whole, without, _ = holed(40, 8, stride)
    known = len(without.landmarks)
    filled = fill_holes(without)
    assert len(filled.landmarks) == len(whole.landmarks)
    np.testing.assert_array_equal(filled.landmarks.position[:known], without.landmarks.position)
    np.testing.assert_array_equal(filled.tracks.start[known:], len(without.tracks))
    new = filled.landmarks[known:]
    true = whole.landmarks[whole.grid(np.arange(len(whole.landmarks)))[whole.region.cells(new.pixel)].astype(int)]
    away = np.linalg.norm(new.position - true.position, axis=-1) / whole.gsd
    assert away.max() < 1.0
    assert np.degrees(angle_between(new.normal, true.normal).max()) < 20.0


def test_holes_are_not_filled_far_from_landmarks():
    _, without, _ = holed(40, 20)
    filled = fill_holes(without, reach_px=4.0)
    missing = ~np.isfinite(filled.grid(filled.landmarks.albedo))
    assert missing.sum() == 12 * 12
    assert missing[14:26, 14:26].all()


def test_small_holes_are_left():
    """Of 5 x 5 pixels; one of 8 x 8 (above) is filled."""
    _, without, _ = holed(41, 5)
    assert fill_holes(without) is without


def test_a_whole_map_stays_as_it_is():
    scene = synthetic_scene(size=20)
    assert fill_holes(scene) is scene


def test_the_next_matches_close_a_hole():
    scene, without, inside = holed(48, 8)
    found = rematch(without, synthetic_images(scene), FlowMatcher(), DensifyOptions())
    index = scene.grid(np.arange(len(scene.landmarks)))[found.cells].astype(int)
    assert inside[index].sum() > 0.95 * inside.sum()
    away = np.linalg.norm(found.landmarks.position - scene.landmarks.position[index], axis=-1) / scene.gsd
    assert np.median(away[inside[index]]) < 0.2
