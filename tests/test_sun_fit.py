"""The Sun of an image from its own brightness: exact without noise, with the right sigma, whatever the exposure."""

import numpy as np
import pytest

from photoclinometry.model.geometry import angle_between, so3_exp
from photoclinometry.photometry.sun_fit import SeenGround, fit_sun
from scenes import synthetic_scene


def seen(view, **options):
    """Ground, exact brightness, the true Sun and the model of one view of the synthetic scene."""
    scene = synthetic_scene(**options)
    marks, tracks = scene.landmarks, scene.tracks
    ground = SeenGround(
        position=marks.position,
        normal=marks.normal,
        albedo=marks.albedo,
        camera_center=scene.views.body_from_cam.translation[view],
    )
    return ground, tracks.brightness[tracks.view == view], scene.views.sun[view], scene.reflectance


@pytest.mark.parametrize("turn", [0.0, 0.2, np.pi / 2, np.pi])
def test_the_sun_is_found_from_any_stated_direction(turn):
    """Brightness is doubled: the exposure does not matter."""
    ground, brightness, sun, model = seen(2, size=24)
    stated = so3_exp(turn * np.array([0.6, 0.8, 0.0])) @ sun
    fit = fit_sun(ground, 2.0 * brightness, stated, model, bias_sigma=1e-3)
    assert angle_between(fit.sun, sun) < 1e-4
    assert fit.off == pytest.approx(angle_between(stated, sun), abs=1e-4)
    assert fit.explained > 0.99999


def test_an_offset_within_its_prior_does_not_move_the_sun():
    ground, brightness, sun, model = seen(1, size=24)
    fit = fit_sun(ground, brightness + 0.05 * np.median(brightness), sun, model, bias_sigma=1.0)
    assert fit.off < 1e-3


def test_the_stated_spread_is_that_of_the_errors():
    """Mean square error over stated variance, two axes, 25 draws: 1 within 3 standard deviations."""
    ground, brightness, sun, model = seen(3, size=24)
    rng = np.random.default_rng(0)
    squares = []
    for _ in range(25):
        noisy = brightness * (1.0 + 0.02 * rng.normal(size=brightness.shape))
        fit = fit_sun(ground, noisy, sun, model, bias_sigma=1e-3)
        squares.append(fit.off**2 / (2.0 * fit.sigma**2))
    assert np.mean(squares) == pytest.approx(1.0, abs=3.0 / np.sqrt(25))


def test_a_tenth_of_outliers_moves_the_sun_by_less_than_a_degree():
    ground, brightness, sun, model = seen(1, size=24)
    rng = np.random.default_rng(1)
    bad = rng.random(brightness.shape) < 0.1
    spoilt = np.where(bad, rng.uniform(0.2, 3.0, brightness.shape) * brightness, brightness)
    assert fit_sun(ground, spoilt, sun, model, bias_sigma=1e-3).off < np.radians(1.0)


def test_no_sun_explains_the_brightness_of_other_ground():
    ground, brightness, sun, model = seen(1, size=24)
    other = seen(1, size=24, seed=1)[1][::-1]
    assert fit_sun(ground, other, sun, model, bias_sigma=1e-3).explained < 0.4
    assert fit_sun(ground, np.ones_like(brightness), sun, model, bias_sigma=1e-3).explained == 0.0
