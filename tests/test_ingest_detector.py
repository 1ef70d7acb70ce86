"""Detectors: every way to mount one sees the same scene; distortions are undone; windows keep directions."""

import numpy as np
import pytest

from photoclinometry.ingest.detector import (
    Detector,
    detector_of_matrix,
    displacement,
    seen_pixels,
    turned_about,
    upright,
    windowed,
)
from photoclinometry.ingest.distortion import BrownConrady, InverseRadial, Mirrored, Radial
from photoclinometry.ingest.undistort import undistorted
from photoclinometry.io.archives.product import Window
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image

MOUNTS = [
    ((1, 0), (0, 1)),
    ((1, 0), (0, -1)),
    ((0, 1), (1, 0)),
    ((0, 1), (-1, 0)),
    ((-1, 0), (0, -1)),
    ((-1, 0), (0, 1)),
]
DISTORTIONS = [
    None,
    Radial((1e-3, -2e-3, 3e-3), (0.1, -0.2)),
    InverseRadial((1e-2, 0.0, 2.8e-3)),
    BrownConrady(20.0, (-0.3, 0.2, -0.1, 0.0, 0.01, 0.0), (1e-3, -2e-3), (1.001, 0.999)),
]


def detector(axes=((1.0, 0.0), (0.0, 1.0)), distortion=None, **changes):
    figures = {"width": 90, "height": 60, "focal_mm": 20.0, "pitch_mm": (0.05, 0.06), "center": (44.0, 31.5)}
    return Detector(axes=axes, distortion=distortion, **{**figures, **changes})


def file_pixel(d, direction):
    """The pixel of the file that a direction of the instrument's frame falls on, without distortion: by definition."""
    x, y, z = np.array(d.frame) @ direction
    on_plane = d.focal_mm * np.array([x, y]) / z
    return np.array(d.center) + np.array(d.axes) @ on_plane / d.pitch_mm


@pytest.mark.parametrize("axes", MOUNTS)
def test_the_upright_camera_sees_what_the_detector_sees(axes):
    """A direction's pixel through the upright camera is its pixel in the file, its line counted from the other end if
    the file is a mirror image."""
    d = detector(axes)
    camera, cam_from_instrument, flip = upright(d)
    assert np.linalg.det(cam_from_instrument) == pytest.approx(1.0)
    assert flip == (np.linalg.det(np.array(axes, float)) < 0)
    for direction in ([0.1, -0.2, 1.0], [-0.05, 0.02, 1.0], [0.0, 0.0, 1.0]):
        expected = file_pixel(d, np.array(direction))
        if flip:
            expected[1] = d.height - expected[1]
        np.testing.assert_allclose(camera.pixel_from_cam(cam_from_instrument @ direction), expected, atol=1e-12)


def test_a_boresight_along_another_axis_is_turned_to_z():
    d = detector(frame=((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)))
    camera, cam_from_instrument, flip = upright(d)
    assert not flip
    np.testing.assert_allclose(cam_from_instrument @ [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(camera.pixel_from_cam(cam_from_instrument @ [1.0, 0.0, 0.1]), [44.0 + 40.0, 31.5])


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_a_file_turned_about_sees_the_same_ideal_points(distortion):
    d = detector(distortion=distortion)
    t = turned_about(d, lines=True, samples=True)
    ideal = np.random.default_rng(0).uniform([0, 0], [90, 60], (50, 2))
    across = np.array([d.width, d.height])
    np.testing.assert_allclose(seen_pixels(t, across - ideal), across - seen_pixels(d, ideal), atol=1e-9)


@pytest.mark.parametrize("distortion", DISTORTIONS[1:])
def test_windows_and_binning_keep_directions(distortion):
    d = detector(distortion=distortion)
    w = windowed(d, Window((10.0, 6.0), (2.0, 3.0)), 30, 10)
    inside = np.random.default_rng(0).uniform([0, 0], [30, 10], (50, 2))
    np.testing.assert_allclose(
        seen_pixels(w, inside) * [2.0, 3.0] + [10.0, 6.0], seen_pixels(d, inside * [2.0, 3.0] + [10.0, 6.0]), atol=1e-9
    )
    whole, part = upright(d)[0], upright(w)[0]
    np.testing.assert_allclose(part.ray_in_cam(inside), whole.ray_in_cam(inside * [2.0, 3.0] + [10.0, 6.0]), atol=1e-12)


def test_opencv_s_distortion_is_opencv_s():
    import cv2

    k, p, focal, center = (-0.3, 0.2, -0.1, 0.01, 0.02, 0.03), (1e-3, -2e-3), (400.0, 333.0), (44.0, 31.5)
    model = BrownConrady(20.0, k, p)
    points = np.random.default_rng(0).uniform(-0.15, 0.15, (40, 2))
    matrix = np.array([[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1.0]])
    rays = np.concatenate([points, np.ones((40, 1))], -1)
    coefficients = np.array([k[0], k[1], *p, k[2], *k[3:]])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, coefficients)
    ours = model.distort(points * 20.0) / 20.0 * focal + center
    np.testing.assert_allclose(ours, expected.reshape(-1, 2), atol=1e-9)


def test_a_distortion_written_the_other_way_is_inverted():
    model = InverseRadial((1e-3, 0.0, 2.8e-5), (0.2, 0.1))
    seen = np.random.default_rng(0).uniform(-6, 6, (100, 2))
    np.testing.assert_allclose(model.distort(model.undistort(seen)), seen, atol=1e-8)


def test_a_distortion_without_inverse_is_refused():
    with pytest.raises(InputError, match="cannot be inverted"):
        InverseRadial((0.0, 0.0, 0.5)).distort(np.array([[6.0, 6.0]]))


def test_mirroring_twice_is_nothing():
    inner = DISTORTIONS[3]
    points = np.random.default_rng(0).uniform(-2, 2, (20, 2))
    twice = Mirrored(Mirrored(inner, (-1.0, 1.0)), (-1.0, 1.0))
    np.testing.assert_array_equal(twice.distort(points), inner.distort(points))


def test_a_matrix_is_split_into_axes_and_pitch():
    d = detector_of_matrix(np.array([[0.0, 20.0], [-25.0, 0.0]]), width=4, height=4, focal_mm=1.0, center=(2.0, 2.0))
    assert d.axes == ((0.0, 1.0), (-1.0, 0.0))
    assert d.pitch_mm == (0.05, 0.04)
    for bad in ([[1.0, 0.2], [0.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]], [[np.nan, 0.0], [0.0, 1.0]]):
        with pytest.raises(InputError, match="correct the camera"):
            detector_of_matrix(np.array(bad), width=4, height=4, focal_mm=1.0, center=(2.0, 2.0))


def wave(pixels):
    """Brightness as a smooth function of pixels (..., 2): what a perfect image of it would hold."""
    x, y = np.moveaxis(pixels, -1, 0)
    return 1.0 + 0.3 * np.sin(0.25 * x + 0.1 * y) + 0.2 * np.cos(0.2 * y - 0.07 * x)


@pytest.mark.parametrize("axes", [MOUNTS[0], MOUNTS[1]])
@pytest.mark.parametrize("distortion", [Radial((0.0, 0.0, 4e-3)), *DISTORTIONS[1:]])
def test_an_undistorted_image_shows_the_scene_where_the_pinhole_sees_it(axes, distortion):
    """The scene is a wave over ideal pixels; the file holds it displaced; the difference is the spline's, < 0.1 %."""
    d = detector(axes, distortion)
    x, y = np.meshgrid(np.arange(d.width) + 0.5, np.arange(d.height) + 0.5)
    # What the file's pixels show: the ideal pixel that is displaced onto each, found by fixed-point iteration.
    ideal = np.stack([x, y], -1)
    for _ in range(200):
        ideal = ideal + (np.stack([x, y], -1) - seen_pixels(d, ideal))
    image = Image("a", wave(ideal).astype(np.float32), np.ones((d.height, d.width), bool))
    result = undistorted(image, d)
    expected = wave(np.stack([x, y], -1))
    expected = expected[::-1] if d.mirrored else expected
    inner = result.valid.copy()
    inner[:6] = inner[-6:] = inner[:, :6] = inner[:, -6:] = False
    assert inner.sum() > 2000
    assert displacement(d)[1] > 0.1
    np.testing.assert_allclose(result.brightness[inner], expected[inner], atol=1e-3)


def test_without_distortion_pixels_stay_as_they_are():
    image = Image("a", np.random.default_rng(0).random((60, 90), np.float32), np.ones((60, 90), bool))
    for distortion in (None, Radial((0.0, 0.0, 1e-7))):
        np.testing.assert_array_equal(undistorted(image, detector(distortion=distortion)).brightness, image.brightness)
        flipped = undistorted(image, detector(MOUNTS[1], distortion))
        np.testing.assert_array_equal(flipped.brightness, image.brightness[::-1])


def test_whatever_draws_on_a_hole_is_a_hole():
    """Whatever value lies under the mask, the result is the same to the last bit."""
    d = detector(distortion=Radial((0.0, 0.0, 4e-3)))
    valid = np.ones((60, 90), bool)
    valid[30, 40] = False
    brightness = np.ones((60, 90), np.float32)
    results = []
    for hole in (0.0, 1e6):
        brightness[30, 40] = hole
        results.append(undistorted(Image("a", brightness.copy(), valid), d))
    np.testing.assert_array_equal(results[0].valid, results[1].valid)
    np.testing.assert_array_equal(results[0].brightness, results[1].brightness)
    around = ~results[0].valid[5:-5, 5:-5]
    assert 9 <= around.sum() <= 25
