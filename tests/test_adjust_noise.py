"""How the errors of measurements are found from residuals: their size, and over how much ground they are alike."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.adjust.correlation import correlation_px
from photoclinometry.adjust.noise import (
    Noise,
    brightness_noise,
    fitted_sigma,
    keypoint_factor,
    local_noise,
    scale_scatter,
    view_prior_factor,
)
from photoclinometry.model.projection import (
    keypoint_residuals,
)
from photoclinometry.model.warning import collected_warnings
from photoclinometry.photometry.predict import (
    brightness_residuals,
)
from scenes import synthetic_scene, with_landmarks

SIZE = 160


def fields(sigma_px: float, views: int = 4, seed: int = 0):
    """Residuals of `views` views on a grid, smoothed by a Gaussian of `sigma_px`; view and pixel of each."""
    noise = np.random.default_rng(seed).normal(size=(views, SIZE, SIZE))
    smooth = np.stack([gaussian_filter(f, sigma_px, mode="wrap") for f in noise]) if sigma_px else noise
    pixel = np.stack(np.divmod(np.arange(SIZE**2), SIZE), -1)
    return smooth.ravel(), np.repeat(np.arange(views), SIZE**2), np.tile(pixel, (views, 1))


@pytest.mark.parametrize("sigma_px", [1.5, 3.0])
def test_correlation_is_that_of_smoothed_noise(sigma_px):
    """White noise smoothed by a Gaussian has the autocorrelation exp(-d^2 / 4 sigma^2), whose integral is 4 pi sigma^2;
    cut off where it falls below 0.05, a twentieth of it is missing."""
    assert correlation_px(*fields(sigma_px)) == pytest.approx(np.sqrt(4 * np.pi * 0.95) * sigma_px, rel=0.1)


def test_independent_errors_share_nothing():
    assert correlation_px(*fields(0.0)) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("smooth", [0.5, 1.0])
def test_what_is_left_of_smooth_errors_is_not_counted(smooth):
    """Errors alike over some landmarks beside others that are alike over ten times as many, and `smooth` as large."""
    values, view, pixel = fields(0.8)
    alike, _, _ = fields(12.0, seed=1)
    both = values / values.std() + smooth * alike / alike.std()
    short = correlation_px(values, view, pixel)
    assert correlation_px(both, view, pixel) > 3.0 * short
    assert correlation_px(both, view, pixel, smooth_over=2.0) == pytest.approx(short, rel=0.15)
    assert correlation_px(values, view, pixel, smooth_over=2.0) == pytest.approx(short, rel=0.05)


def test_fewer_landmarks_share_an_error_where_some_are_missing():
    """What counts is the number of landmarks, not the area: of every second landmark, half as many share an error."""
    values, view, pixel = fields(3.0)
    kept = np.random.default_rng(1).uniform(size=len(values)) < 0.5
    whole, half = correlation_px(values, view, pixel), correlation_px(values[kept], view[kept], pixel[kept])
    assert half == pytest.approx(whole * np.sqrt(0.5), rel=0.1)


def test_a_few_outliers_do_not_hide_the_correlation():
    values, view, pixel = fields(3.0)
    spoilt = values.copy()
    spoilt[np.random.default_rng(2).choice(len(values), len(values) // 100)] = 100.0
    assert correlation_px(spoilt, view, pixel) == pytest.approx(correlation_px(values, view, pixel), rel=0.1)


def test_too_few_residuals_are_taken_for_independent():
    values, view, pixel = fields(3.0)
    assert correlation_px(values[:50], view[:50], pixel[:50]) == 1.0


def test_noise_of_a_true_scene_is_what_was_drawn():
    """At the truth nothing was fitted: the residuals are the noise itself, whitened by the keypoints' own sigma."""
    scene = synthetic_scene(size=30, views=6, keypoint_noise_px=0.2, brightness_noise=0.01)
    whitened = keypoint_residuals(scene) / scene.tracks.keypoint_sigma[:, None]
    assert fitted_sigma(whitened, parameters=0) == pytest.approx(1.0, rel=0.03)
    lit = np.ones(len(scene.tracks), bool)
    drawn = 0.01 * synthetic_scene(size=30, views=6).tracks.brightness.mean()
    assert fitted_sigma(brightness_residuals(scene), parameters=0) == pytest.approx(drawn, rel=0.03)
    # as if three had been fitted to a landmark's twelve coordinates and three to its six brightnesses
    everyone = np.ones(len(scene.landmarks), bool)
    assert keypoint_factor(scene, keypoint_residuals(scene), everyone) == pytest.approx(np.sqrt(12 / 9), rel=0.03)
    assert brightness_noise(scene, brightness_residuals(scene), lit) == pytest.approx(drawn * np.sqrt(2), rel=0.03)


def test_noise_that_hardly_changed_is_close():
    noise = Noise(
        keypoint_factor=0.5,
        keypoint_correlation_px=20.0,
        pose_only_keypoint_factor=1.0,
        sparse_keypoint_factor=1.0,
        brightness_sigma=0.0,
        brightness_correlation_px=3.0,
    )
    from dataclasses import replace

    assert noise.close_to(noise)
    assert replace(noise, keypoint_correlation_px=23.0, keypoint_factor=0.54).close_to(noise)
    assert not replace(noise, keypoint_correlation_px=25.0).close_to(noise)
    assert not replace(noise, sparse_keypoint_factor=1.2).close_to(noise)
    assert not replace(noise, scale_scatter=0.002).close_to(noise)
    assert not noise.close_to(replace(noise, scale_scatter=0.002))


def test_views_follow_chance_and_are_held_against_more():
    """Differences of up to a sigma and a half are left alone; under the factor found, as they fall by its square, they
    are a sigma."""
    assert view_prior_factor(1.0, 1.0) == 1.0
    assert view_prior_factor(0.5, 2.0) == pytest.approx(2.0 * np.sqrt(0.5))
    factor = view_prior_factor(4.0, 1.5)
    assert 4.0 * (1.5 / factor) ** 2 == pytest.approx(1.0)
    assert view_prior_factor(1e6, 1.0) == 5.0


def test_scales_scatter_by_their_distance_from_one_and_by_a_thousandth_at_least():
    assert scale_scatter(np.array([1.01, 0.98, 1.0])) == pytest.approx(np.sqrt(5e-4 / 3))
    assert scale_scatter(np.array([1.0001, 0.9999])) == 1e-3
    assert scale_scatter(np.ones(3)) == np.inf


def test_what_follows_the_phase_is_no_scatter_of_scales():
    """A parabola of 4 % with noise of half a per cent: the noise, for the degrees of freedom left; of six views all."""
    rng = np.random.default_rng(0)
    phase = rng.uniform(0.3, 1.3, 400)
    curved = 1.0 - 0.16 * (phase - 0.8) ** 2
    scale = curved + 0.005 * rng.normal(size=400)
    assert scale_scatter(scale, phase) == pytest.approx(0.005, rel=0.1)
    assert scale_scatter(scale) > 0.015
    assert scale_scatter(scale[:6], phase[:6]) == scale_scatter(scale[:6])
    few = [scale_scatter(1.0 + 0.005 * rng.normal(size=7), phase[:7]) ** 2 for _ in range(400)]
    assert np.mean(few) == pytest.approx(0.005**2, rel=0.15)


def test_where_brightness_is_twice_as_noisy_landmarks_are_twice_as_uncertain():
    """The residuals at the truth have all of their freedom, of which local_noise takes three for each landmark."""
    scene, sigma = synthetic_scene(size=40, views=10), 1e-3
    tracks, (row, _) = scene.tracks, scene.cells
    noise = sigma * np.where(row < 20, 1.0, 2.0)[tracks.landmark] * np.random.default_rng(0).normal(size=len(tracks))
    noisy = replace(scene, tracks=replace(tracks, brightness=tracks.brightness + noise))
    found = local_noise(noisy, tracks.lit, sigma, np.ones(len(scene.landmarks), bool)) * 7.0 / 10.0
    assert np.mean(found[row < 16]) == pytest.approx(1.0, rel=0.05)
    assert np.mean(found[row > 23]) == pytest.approx(4.0, rel=0.05)
    assert np.std(found[row < 16]) < 0.2


def test_a_landmark_that_stands_alone_is_not_certain_because_it_fits_by_chance():
    """Four views leave it one degree of freedom; it fits exactly here, as do all others."""
    whole = synthetic_scene(size=12, views=4)
    row, col = whole.cells
    scene = with_landmarks(whole, (row < 4) | ((row == 11) & (col == 11)))
    found = local_noise(scene, scene.tracks.lit, 1e-3, np.ones(len(scene.landmarks), bool))
    assert found[-1] == pytest.approx(0.5, abs=0.05)
    assert found[:-1].max() < 0.4


def test_where_no_brightness_counts_noise_is_as_everywhere():
    scene = synthetic_scene(size=12, views=6)
    everywhere = np.ones(len(scene.landmarks), bool)
    dark = np.zeros(len(scene.tracks), bool)
    np.testing.assert_array_equal(local_noise(scene, dark, 1e-3, everywhere), 1.0)
    row, _ = scene.cells
    lit = (row < 4)[scene.tracks.landmark]
    assert np.all(local_noise(scene, lit, 1e-3, everywhere)[row == 11] == 1.0)


@pytest.mark.parametrize(("views", "told"), [(3, False), (4, True)])
def test_three_brightnesses_do_not_tell_their_noise(views, told):
    """A normal and an albedo fit three brightnesses exactly: sigmas are then those of brightness that is good to 2 per
    cent, which is said. Of four views the noise of 1 per cent is found."""
    scene = synthetic_scene(size=16, views=views, keypoint_noise_px=0.1, brightness_noise=0.01)
    level = float(np.median(scene.tracks.brightness))
    with collected_warnings() as warned:
        found = adjust(scene, AdjustOptions(brightness_correlation_px=1.0, reflectance_sigma=0.0))
    assert ("noise-unknown" in [one.code for one in warned]) is not told
    assert found.noise.brightness_sigma == pytest.approx((0.01 if told else 0.02) * level, rel=0.3)
    assert np.degrees(np.sqrt(np.median(np.trace(found.scene.uncertainty["normal"], axis1=1, axis2=2)))) > 0.5
