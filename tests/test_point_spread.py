"""The width of the point-spread function from images of rough ground."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.image import Image
from photoclinometry.photometry.point_spread import (
    SMOOTH_GROUND_PX,
    USUAL_PX,
    WIDEST_PX,
    psf_sigma_px,
    reference_psf_sigma_px,
)
from scenes import synthetic_scene

FINE = 4
"""Samples a pixel, along each side."""


def ground(size, *, exponent, sigma_px, noise, seed, ground_sigma_px=0.0):
    """An image (size, size) of ground whose power falls with the wave number, through a Gaussian and pixels."""
    rng = np.random.default_rng(seed)
    along = 2.0 * np.pi * np.fft.fftfreq(size * FINE) * FINE
    number = np.hypot(along[:, None], along)
    number[0, 0] = np.inf
    wave = np.fft.fft2(rng.standard_normal((size * FINE, size * FINE))) * number ** (-exponent / 2.0)
    wave *= np.exp(-0.5 * (sigma_px**2 + ground_sigma_px**2) * np.where(np.isinf(number), 0.0, number) ** 2)
    fine = np.fft.ifft2(wave).real
    pixels = fine.reshape(size, FINE, size, FINE).mean((1, 3))
    pixels = 0.1 * (1.0 + 0.1 * pixels / pixels.std())
    return pixels + noise * rng.standard_normal(pixels.shape)


def images(count=3, size=160, valid=None, **about):
    arrays = [ground(size, seed=seed, **about) for seed in range(count)]
    return [Image(f"{k}", a, np.ones(a.shape, bool) if valid is None else valid) for k, a in enumerate(arrays)]


@pytest.mark.parametrize("sigma_px", [0.4, 0.6, 0.7, 0.85])
@pytest.mark.parametrize("exponent", [1.5, 2.5])
def test_what_simulated_images_are_blurred_by_is_found(sigma_px, exponent):
    """But for what may be smooth ground; less than the usual width only where they are sharper even so."""
    found = psf_sigma_px(images(exponent=exponent, sigma_px=sigma_px, noise=2e-5))
    expected = np.sqrt(max(sigma_px**2 - SMOOTH_GROUND_PX**2, 0.0))
    assert found == pytest.approx(max(expected, min(sigma_px, USUAL_PX)), abs=0.06)


def test_images_without_room_for_a_window_have_the_usual_width():
    assert psf_sigma_px([Image("a", np.full((40, 400), 0.1), np.ones((40, 400), bool))]) == USUAL_PX


def test_smooth_ground_is_not_taken_for_a_blurred_camera():
    about = dict(exponent=2.0, sigma_px=USUAL_PX, noise=2e-5)
    assert psf_sigma_px(images(ground_sigma_px=SMOOTH_GROUND_PX, **about)) == pytest.approx(USUAL_PX, abs=0.05)
    assert psf_sigma_px(images(ground_sigma_px=1.2, **about)) == WIDEST_PX


def test_only_images_of_the_reference_views_camera_tell_its_width():
    scene = synthetic_scene(size=6, views=6)
    other = replace(scene.views.cameras[0], params=(5000.0, 5000.0, 80.0, 80.0))
    cameras = (*scene.views.cameras[:3], other, other, other)
    scene = replace(scene, views=replace(scene.views, cameras=cameras), reference=0)
    sharp = images(exponent=2.0, sigma_px=0.6, noise=2e-5)
    blurred = images(exponent=2.0, sigma_px=1.0, noise=2e-5)
    assert reference_psf_sigma_px(scene, [*sharp, *blurred]) == psf_sigma_px(sharp)
    assert reference_psf_sigma_px(replace(scene, reference=4), [*sharp, *blurred]) == psf_sigma_px(blurred)


def test_noise_hides_the_shortest_waves_and_not_the_width():
    found = [psf_sigma_px(images(exponent=2.0, sigma_px=0.8, noise=noise)) for noise in (0.0, 5e-4)]
    assert found[1] == pytest.approx(found[0], abs=0.1)


def test_sky_and_deep_shadows_do_not_count(caplog):
    """Their edges are as sharp as the camera shows them, and those of the ground are not."""
    caplog.set_level("INFO")
    plain = images(exponent=2.0, sigma_px=0.8, noise=2e-5)
    expected = psf_sigma_px(plain)
    for image in plain:
        image.brightness[:60] = 0.0
        image.brightness[90:120, 100:] *= 0.05
    assert psf_sigma_px(plain) == pytest.approx(expected, abs=0.06)


def test_images_that_do_not_tell_it_have_the_usual_width(caplog):
    caplog.set_level("INFO")
    assert psf_sigma_px(images(1, 60, exponent=2.0, sigma_px=0.8, noise=0.0)) == USUAL_PX
    assert "too few to tell" in caplog.text
    dark = [Image("0", np.zeros((160, 160)), np.ones((160, 160), bool))]
    assert psf_sigma_px(dark) == USUAL_PX
    stripes = np.tile(1.0 + 0.5 * np.sin(2.0 * np.pi * np.arange(160) / 5.0), (160, 1))
    assert psf_sigma_px([Image("0", stripes, np.ones((160, 160), bool))]) == USUAL_PX
    assert "follows no power law" in caplog.text
    noise = [Image("0", 1.0 + 0.1 * np.random.default_rng(0).standard_normal((320, 320)), np.ones((320, 320), bool))]
    assert psf_sigma_px(noise) == USUAL_PX
    assert "noise hides its width" in caplog.text
    nothing = images(valid=np.zeros((160, 160), bool), exponent=2.0, sigma_px=0.8, noise=0.0)
    assert psf_sigma_px(nothing) == USUAL_PX
