"""Brightness that cosmic rays raise is found by what the map predicts, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.photometry.cosmic_rays import is_struck
from photoclinometry.photometry.predict import observation_brightness
from scenes import synthetic_scene

NOISE = 0.002


@pytest.fixture(scope="module")
def noisy():
    """A map whose brightness is as predicted, but for noise of NOISE."""
    scene = synthetic_scene(size=32, views=5)
    predicted = observation_brightness(scene)
    brightness = predicted + NOISE * np.random.default_rng(0).normal(size=len(predicted))
    return replace(scene, tracks=replace(scene.tracks, brightness=brightness, lit=np.ones(len(predicted), bool)))


def with_spikes(scene, size, count=20, seed=1):
    """The scene with `count` observations brighter by `size`, and which."""
    which = np.random.default_rng(seed).choice(len(scene.tracks), count, replace=False)
    brightness = scene.tracks.brightness.copy()
    brightness[which] += size
    return replace(scene, tracks=replace(scene.tracks, brightness=brightness)), which


def test_noise_is_not_taken_for_cosmic_rays(noisy):
    assert not is_struck(noisy).any()


def test_struck_observations_and_their_neighbours_are_found(noisy):
    scene, which = with_spikes(noisy, 30 * NOISE)
    found = is_struck(scene)
    assert found[which].all()
    assert found.sum() <= 9 * len(which)


def test_other_views_of_the_same_ground_stay(noisy):
    scene, which = with_spikes(noisy, 30 * NOISE, count=5)
    found = is_struck(scene)
    of_view = np.bincount(scene.tracks.view[which], minlength=5)
    assert (np.bincount(scene.tracks.view[found], minlength=5) <= 9 * of_view).all()
    assert (of_view == 0).any()
    assert found.any()


def test_what_most_views_do_not_have_is_no_particle(noisy):
    scene, which = with_spikes(noisy, 30 * NOISE, count=60)
    of_two = which[scene.tracks.view[which] < 2]
    brightness = noisy.tracks.brightness.copy()
    brightness[of_two] = scene.tracks.brightness[of_two]
    assert not is_struck(replace(noisy, tracks=replace(noisy.tracks, brightness=brightness))).any()
    assert is_struck(scene)[of_two].all()


def test_ground_that_a_map_does_not_fit_stays(noisy):
    """As many observations darker as brighter: edges, not particles. Those brighter than all darker ones may go."""
    brighter, _ = with_spikes(noisy, 30 * NOISE, count=100, seed=1)
    both, _ = with_spikes(brighter, -30 * NOISE, count=100, seed=2)
    assert is_struck(both).sum() < 0.1 * is_struck(brighter).sum()


def test_a_line_is_an_edge_of_the_ground(noisy):
    """Of a map that has not found it; spots beside it are still found."""
    spots, which = with_spikes(noisy, 30 * NOISE, count=10)
    tracks, (row, col) = spots.tracks, noisy.cells
    beside = (np.abs(row[tracks.landmark] - 8) <= 3) & (tracks.view == 2)
    line = (row == 8)[tracks.landmark] & (col > 3)[tracks.landmark] & (tracks.view == 2)
    found = is_struck(replace(spots, tracks=replace(tracks, brightness=tracks.brightness + 30 * NOISE * line)))
    assert not found[line].any()
    assert found[which[~beside[which]]].all()


def test_what_is_not_lit_does_not_count(noisy):
    scene, which = with_spikes(noisy, 30 * NOISE)
    lit = np.ones(len(scene.tracks), bool)
    lit[which] = False
    assert not is_struck(replace(scene, tracks=replace(scene.tracks, lit=lit))).any()
