"""Which brightness counts, and how much: footprints of pixels, and the components of its variance."""

from dataclasses import replace

import numpy as np
import pytest

from graphs import gradients_of
from photoclinometry.adjust import AdjustOptions, ImageGradients, adjust, groups
from photoclinometry.adjust.brightness_weights import footprint_of, relative_sigma, some_of, variance_components
from photoclinometry.adjust.graph.observations import Brightness
from photoclinometry.adjust.groups import factor_groups, setup_of
from photoclinometry.adjust.measured_noise import measured_noise, starting_noise
from photoclinometry.adjust.stated_uncertainty import in_solver_order
from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.model.reflectance import published
from photoclinometry.photometry.predict import brightness_by_slope, observation_brightness
from scenes import synthetic_scene, with_coarse_view


def test_pixels_that_cover_more_ground_tell_less_of_each_landmark():
    """By the square root of the landmarks that one covers: twice as coarse by 2, seen from 60 degrees by 2 again over
    the root of 2; and as they are where brightness was sampled at matches."""
    scene = with_coarse_view(synthetic_scene(size=12, views=4), 2)
    gradients = gradients_of(scene)
    given = in_solver_order(scene, gradients)
    setup = setup_of(given.scene, given.members, AdjustOptions(), gradients=given.gradients)
    tracks, views, landmarks = given.scene.tracks, scene.views, given.scene.landmarks
    towards = views.body_from_cam.translation[tracks.view] - landmarks.position[tracks.landmark]
    cosine = np.sum(unit(towards) * landmarks.normal[tracks.landmark], -1)
    finer = np.array(
        [views.gsd(0, scene.landmarks.position) / views.gsd(k, scene.landmarks.position) for k in range(4)]
    )
    assert finer[2] == pytest.approx(0.5, rel=0.15)
    expected = np.maximum(1.0 / finer, 1.0)[tracks.view] / np.sqrt(cosine)
    np.testing.assert_allclose(setup.relative_sigma, expected, rtol=1e-12)
    noise = starting_noise(setup, tracks.lit)
    light = next(group for group in factor_groups(setup, tracks.lit, noise, None) if isinstance(group, Brightness))
    shared = setup.correlation(noise.brightness_correlation_px)
    np.testing.assert_allclose(light.sigma, noise.brightness_sigma * shared * expected)
    plain = setup_of(given.scene, given.members, AdjustOptions())
    assert (plain.relative_sigma == 1.0).all()


def test_noise_of_brightness_is_that_of_a_pixel_from_above():
    """Errors that grow with the ground that a pixel covers are found as what they would be without it."""
    scene = with_coarse_view(synthetic_scene(size=40, views=6), 2)
    given = in_solver_order(scene, gradients_of(scene))
    setup = setup_of(given.scene, given.members, AdjustOptions(), gradients=given.gradients)
    tracks, rng, sigma = given.scene.tracks, np.random.default_rng(3), 0.02 * float(np.median(scene.tracks.brightness))
    noisy = tracks.brightness + sigma * setup.relative_sigma * rng.normal(size=len(tracks))
    measured = replace(given.scene, tracks=replace(tracks, brightness=noisy))
    lit = tracks.lit
    before = starting_noise(setup, lit)
    found = measured_noise(setup, measured, lit, before).brightness_sigma
    # The scene is not fitted to this noise, which counts as if three of six numbers per landmark had been.
    assert found == pytest.approx(sigma * np.sqrt(6.0 / 3.0), rel=0.1)


@pytest.mark.parametrize("name", ["lunar-lambert", "hapke"])
def test_brightness_by_slope_is_its_steepest_change_with_the_normal(name):
    """Against differences as the normal turns in 720 directions."""
    scene = synthetic_scene(size=5, views=4, reflectance=published(name, "ceres"))
    scene = replace(scene, views=replace(scene.views, scale=np.array([1.0, 0.5, 2.0, 1.3])))
    normal, step = scene.landmarks.normal, 1e-5
    one = unit(np.cross(normal, [1.0, 0.2, 0.1]))
    other = np.cross(normal, one)
    steepest = np.zeros(len(scene.tracks))
    for angle in np.linspace(0.0, np.pi, 720, endpoint=False):
        along = np.cos(angle) * one + np.sin(angle) * other
        after, before = (
            observation_brightness(
                replace(scene, landmarks=replace(scene.landmarks, normal=unit(normal + side * along)))
            )
            for side in (step, -step)
        )
        steepest = np.maximum(steepest, np.abs(after - before) / (2.0 * step))
    np.testing.assert_allclose(brightness_by_slope(scene), steepest, rtol=1e-4)


def test_components_of_variance_are_found_beside_outliers():
    rng, count = np.random.default_rng(4), 100_000
    gradient, by_slope = rng.gamma(1.0, 0.01, count), rng.uniform(0.0, 0.1, count)
    sigma = np.sqrt(1e-3**2 + (0.1 * gradient) ** 2 + (0.02 * by_slope) ** 2)
    residual = sigma * rng.normal(size=count)
    residual[rng.choice(count, 2_000, replace=False)] = 1.0
    found = variance_components(residual, gradient, by_slope)
    assert found is not None
    np.testing.assert_allclose(found, [1e-3, 0.1, 0.02], rtol=0.08)
    np.testing.assert_allclose(found.sigma(gradient, by_slope), sigma, rtol=0.08)


def test_noise_that_is_alike_everywhere_has_no_other_component():
    rng, count = np.random.default_rng(5), 100_000
    gradient, by_slope = rng.gamma(1.0, 0.01, count), rng.uniform(0.0, 0.1, count)
    found = variance_components(1e-3 * rng.normal(size=count), gradient, by_slope)
    assert found is not None
    np.testing.assert_allclose(found.sigma(gradient, by_slope), 1e-3, rtol=0.03)


def test_too_few_observations_tell_no_components():
    few = np.linspace(0.1, 1.0, 400)
    assert variance_components(few, few, few) is None
    assert variance_components(np.zeros(10_000), np.ones(10_000), np.ones(10_000)) is None


def test_the_observations_that_tell_the_variances_are_of_all_views():
    """Every eighth of those of a map in eight views would be of one."""
    tracks = synthetic_scene(size=40, views=8).tracks
    found = some_of(np.arange(len(tracks)), len(tracks) // 8)
    assert len(found) == len(set(found)) == len(tracks) // 8
    share = np.bincount(tracks.view[found], minlength=8) / len(found)
    np.testing.assert_allclose(share, 1.0 / 8.0, atol=0.04)
    np.testing.assert_array_equal(some_of(found, len(found)), found)


def misplaced(scene, by_px, seed=6):
    """The scene with brightness taken beside the landmarks, and the gradients there: steep at every fourth one."""
    rng = np.random.default_rng(seed)
    steep = np.where(rng.permutation(len(scene.tracks)) % 4 == 0, 0.02, 0.001)[:, None]
    gradient = steep * unit(rng.normal(size=(len(scene.tracks), 2)))
    brightness = scene.tracks.brightness + np.sum(gradient * by_px * rng.normal(size=gradient.shape), -1)
    at_keypoints = ImageGradients(scene.tracks.keypoint, gradient)
    return replace(scene, tracks=replace(scene.tracks, brightness=brightness)), at_keypoints


def test_brightness_counts_less_where_the_image_is_steep():
    """By as much as its gradient says, if all errors are of place."""
    scene, gradients = misplaced(synthetic_scene(size=40, views=8), 0.1)
    found = relative_sigma(scene, gradients, scene.tracks.lit, len(scene.landmarks))
    found /= footprint_of(scene, len(scene.landmarks))
    size = np.linalg.norm(gradients.gradient, axis=-1)
    assert np.median(found) == pytest.approx(1.0, rel=0.05)
    np.testing.assert_allclose(found[size > 0.01], 20.0, rtol=0.1)


def test_normals_are_nearer_the_truth_where_errors_grow_with_the_gradient(monkeypatch):
    truth = synthetic_scene(size=24, views=8)
    scene, gradients = misplaced(truth, 0.1)
    options = AdjustOptions(uncertainty=False)

    def error():
        found = adjust(scene, options, gradients=gradients).scene
        return float(np.mean(angle_between(found.landmarks.normal, truth.landmarks.normal)))

    by_components = error()
    monkeypatch.setattr(groups, "relative_sigma", lambda scene, gradients, lit, mapped: footprint_of(scene, mapped))
    assert by_components < 0.7 * error()
