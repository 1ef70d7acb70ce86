"""Lens distortion: against OpenCV, by hand, and taken out of images as they are read."""

import cv2
import numpy as np
import pytest

from photoclinometry.io.images import write_fits
from photoclinometry.io.site import read_site, write_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import SiteError
from photoclinometry.model.lens import NO_DISTORTION, Lens, displacement_terms, folds, observed_pixels
from sites import write_small_site

CAMERA = Camera("PINHOLE", 400, 300, (900.0, 950.0, 190.0, 160.0))
LENS = Lens(k1=-0.3, k2=0.8, p1=0.004, p2=-0.006)
SMALL = 'model = "PINHOLE"\nwidth = 64\nheight = 64\nparams = [640.0, 640.0, 32.0, 32.0]'


def with_camera(path, text):
    path.write_text(path.read_text().replace(SMALL, text))
    return path


def test_observed_pixels_are_those_of_opencv():
    """cv2.projectPoints has the same model, written by others."""
    pixels = np.random.default_rng(0).uniform((0, 0), (400, 300), (50, 2))
    fx, fy, cx, cy = CAMERA.intrinsics
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    coefficients = np.array([LENS.k1, LENS.k2, LENS.p1, LENS.p2])
    expected, _ = cv2.projectPoints(CAMERA.ray_in_cam(pixels), np.zeros(3), np.zeros(3), matrix, coefficients)
    np.testing.assert_allclose(pixels + LENS.displacement(pixels, CAMERA), expected[:, 0], atol=1e-9)


def test_a_coefficient_of_one_pixel_moves_the_corner_by_one_pixel():
    camera = Camera("SIMPLE_PINHOLE", 600, 800, (5000.0, 300.0, 400.0))  # half diagonal 500 px
    corner = np.array([600.0, 800.0])
    for k, direction in ((0, (0.6, 0.8)), (1, (0.6, 0.8))):
        lens = Lens.of_corner_px(np.eye(4)[k], camera)
        np.testing.assert_allclose(lens.displacement(corner, camera), direction, atol=1e-12)
    decentred = Lens.of_corner_px(np.array([0.0, 0.0, 0.0, 1.0]), camera)
    np.testing.assert_allclose(decentred.displacement(corner, camera), (1 + 2 * 0.36, 2 * 0.48), atol=1e-12)


def test_corner_pixels_and_coefficients_say_the_same():
    np.testing.assert_allclose(
        Lens.of_corner_px(LENS.corner_px(CAMERA), CAMERA).corner_px(CAMERA), LENS.corner_px(CAMERA)
    )
    pixels = np.array([[10.0, 20.0], [333.0, 250.0]])
    terms = displacement_terms(pixels, CAMERA)
    np.testing.assert_allclose(terms @ LENS.corner_px(CAMERA), LENS.displacement(pixels, CAMERA))


def test_a_strong_barrel_folds_and_a_mild_one_does_not():
    """r (1 + k1 r^2) turns back where 3 k1 r^2 < -1: at the corner, whose r^2 is 0.077, for k1 < -4.3."""
    camera = Camera("PINHOLE", 400, 300, (900.0, 900.0, 200.0, 150.0))
    assert not folds(camera, Lens(k1=-4.0))
    assert folds(camera, Lens(k1=-4.7))
    assert not folds(camera, NO_DISTORTION)


def test_the_largest_displacement_is_that_of_the_image():
    seen, farthest = observed_pixels(CAMERA, LENS)
    assert seen.shape == (300, 400, 2)
    np.testing.assert_allclose(
        seen[10, 20], np.array([20.5, 10.5]) + LENS.displacement(np.array([20.5, 10.5]), CAMERA), atol=1e-12
    )
    corners = np.array([[0.5, 0.5], [399.5, 0.5], [0.5, 299.5], [399.5, 299.5]])
    assert farthest == pytest.approx(np.linalg.norm(LENS.displacement(corners, CAMERA), axis=-1).max(), rel=1e-6)


@pytest.mark.parametrize(
    ("model", "params", "lens"),
    [
        ("SIMPLE_RADIAL", [640.0, 32.0, 32.0, -0.5], Lens(k1=-0.5)),
        ("RADIAL", [640.0, 32.0, 32.0, -0.5, 2.0], Lens(k1=-0.5, k2=2.0)),
        ("OPENCV", [640.0, 640.0, 32.0, 32.0, -0.5, 2.0, 1e-3, 2e-3], Lens(-0.5, 2.0, 1e-3, 2e-3)),
    ],
)
def test_a_site_may_have_colmaps_cameras_and_writes_them_back(tmp_path, model, params, lens):
    path = with_camera(write_small_site(tmp_path), f'model = "{model}"\nwidth = 64\nheight = 64\nparams = {params}')
    site = read_site(path)
    assert {view.lens for view in site.views} == {lens}
    assert site.views[0].camera.intrinsics == (640.0, 640.0, 32.0, 32.0)
    write_site(tmp_path / "again.toml", site)
    assert {view.lens for view in read_site(tmp_path / "again.toml").views} == {lens}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[640.0, 640.0, 32.0, 32.0]", "params"),
        ("[640.0, 640.0, 32.0, 32.0, -400.0, 0.0, 0.0, 0.0]", "folds .* fx, fy, cx, cy, k1, k2, p1, p2"),
    ],
)
def test_wrong_coefficients_are_errors_that_say_the_order(tmp_path, text, says):
    path = with_camera(write_small_site(tmp_path), f'model = "OPENCV"\nwidth = 64\nheight = 64\nparams = {text}')
    with pytest.raises(SiteError, match=says):
        read_site(path)


def test_images_are_read_without_their_distortion(tmp_path):
    """Files hold a wave seen through the lens, and are read as the pinhole shows it; what lies outside is invalid."""
    path = with_camera(
        write_small_site(tmp_path),
        'model = "RADIAL"\nwidth = 64\nheight = 64\nparams = [640.0, 32.0, 32.0, 25.0, 0.0]',
    )
    site = read_site(path)
    camera, lens = site.views[0].camera, site.views[0].lens
    x, y = np.meshgrid(np.arange(64) + 0.5, np.arange(64) + 0.5)
    observed = np.stack([x, y], -1)
    ideal = observed.copy()
    for _ in range(100):
        ideal = observed - lens.displacement(ideal, camera)
    for number in range(4):
        wave = 0.1 + 0.03 * np.sin(ideal[..., 0] / 6 + number) * np.cos(ideal[..., 1] / 7)
        write_fits(tmp_path / "images" / f"{number}.fits", wave.astype(np.float32))
    assert np.abs(lens.displacement(observed, camera)).max() > 1.5
    for number, image in enumerate(load_images(site)):
        expected = 0.1 + 0.03 * np.sin(x / 6 + number) * np.cos(y / 7)
        assert not image.valid[0, 0]  # seen outside of the file
        inner = image.valid.copy()
        inner[:6] = inner[-6:] = inner[:, :6] = inner[:, -6:] = False
        assert inner.sum() > 2000
        np.testing.assert_allclose(image.brightness[inner], expected[inner], atol=1e-4)
