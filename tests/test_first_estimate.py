"""Large maps are first estimated by a quarter of their landmarks, and all landmarks follow."""

from dataclasses import replace

import numpy as np
import pytest

from adjustments import not_adjusted
from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.model.scene import Surroundings
from photoclinometry.pipeline import first_estimate as module
from photoclinometry.pipeline.first_estimate import first_estimate, interpolated_estimate
from photoclinometry.registration.alignment import transform_scene
from scenes import synthetic_scene, with_landmarks
from truths import TURNED_FRAME

NOISE_GSD = 0.1


@pytest.fixture(scope="module")
def true():
    return synthetic_scene(size=40, views=8)


def away_from(scene):
    return unit(scene.landmarks.position - scene.views.body_from_cam.translation[scene.reference])


def rough(true, seed=0):
    """The map with noise of its depths, level normals and one albedo, as it is before an estimate."""
    noise = NOISE_GSD * true.gsd * np.random.default_rng(seed).normal(size=(len(true.landmarks), 1))
    landmarks = replace(
        true.landmarks,
        position=true.landmarks.position + noise * away_from(true),
        normal=np.tile([0.0, 0.0, 1.0], (len(noise), 1)),
        albedo=np.full(len(noise), 0.3),
    )
    return replace(true, landmarks=landmarks)


def off_gsd(found, true):
    """(J,) along the reference's rays."""
    return np.abs(np.sum((found.landmarks.position - true.landmarks.position) * away_from(true), -1)) / true.gsd


@pytest.fixture
def large(monkeypatch):
    """Maps of a thousand landmarks are large."""
    monkeypatch.setattr(module, "LARGE", 1000)


def test_landmarks_between_those_estimated_lie_on_their_surface_with_its_normals_and_albedos(true, large):
    """Between every other landmark of waves of 8 to 25 landmarks; the noise of the start is gone but at the edges."""
    found = first_estimate(rough(true), lambda _: not_adjusted(true.of_every(2))).scene
    off = off_gsd(found, true)
    row, col = true.cells
    inner = (row < 39) & (col < 39)
    assert off[inner].max() < 0.5 * NOISE_GSD
    assert off[inner].mean() < 0.05 * NOISE_GSD
    assert np.mean(off[~inner]) == pytest.approx(NOISE_GSD * np.sqrt(2.0 * 2.0 / np.pi), rel=0.3)
    assert np.degrees(angle_between(found.landmarks.normal, true.landmarks.normal)).max() < 0.1
    np.testing.assert_allclose(found.landmarks.albedo, true.landmarks.albedo, rtol=1e-3)
    np.testing.assert_array_equal(found.tracks.keypoint, true.tracks.keypoint)


def test_beside_a_hole_landmarks_keep_their_depth_but_for_what_the_nearest_has_changed_by(true, large):
    row, col = true.cells
    holed = with_landmarks(true, (np.abs(row - 20) > 4) | (np.abs(col - 20) > 4))
    start = rough(holed)
    found = first_estimate(start, lambda _: not_adjusted(holed.of_every(2))).scene
    row, col = holed.cells
    beside = (np.abs(row - 20) <= 6) & (np.abs(col - 20) <= 6)
    assert off_gsd(found, holed)[beside].max() < 6.0 * NOISE_GSD
    assert off_gsd(found, holed)[~beside & (row < 39) & (col < 39)].max() < 0.5 * NOISE_GSD


def test_they_follow_into_the_frame_that_the_estimate_is_in(true):
    """As with pose priors: another origin, orientation and unit of length."""
    start = rough(true)
    part = start.of_every(2)
    here, there = (
        interpolated_estimate(found, part, start)
        for found in (true.of_every(2), transform_scene(TURNED_FRAME, true.of_every(2)))
    )
    expected = transform_scene(TURNED_FRAME, here)
    np.testing.assert_allclose(there.landmarks.position, expected.landmarks.position, atol=1e-6 * expected.gsd)
    np.testing.assert_allclose(there.landmarks.normal, expected.landmarks.normal, atol=1e-6)


def test_the_ground_around_the_map_is_that_of_the_estimate(true, large):
    """Its depths are in the unit of the estimate's frame, and have followed the map."""
    camera = true.views.cameras[true.reference]
    shape = (-(-camera.height // 4), -(-camera.width // 4))
    start = replace(rough(true), surroundings=Surroundings(depth=np.full(shape, 50.0), stride=4))
    estimated = transform_scene(TURNED_FRAME, start.of_every(2))
    found = first_estimate(start, lambda _: not_adjusted(estimated)).scene
    np.testing.assert_allclose(found.surroundings.depth, 50.0 * TURNED_FRAME.scale)


def test_smaller_maps_are_estimated_whole(true):
    start, seen, found = rough(true), [], not_adjusted(true)

    def estimate(scene):
        seen.append(scene)
        return found

    assert first_estimate(start, estimate) is found
    assert seen == [start]


def test_geometry_alone_has_no_shading_to_sharpen_it(true, large):
    quarter = not_adjusted(replace(true, reflectance=None).of_every(2))
    found = first_estimate(replace(rough(true), reflectance=None), lambda _: quarter).scene
    assert found.reflectance is None
    assert np.median(off_gsd(found, true)) < 0.1 * NOISE_GSD
