"""Splines between pixels: SciPy's values, and the derivatives of these."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from photoclinometry.model.splines import Spline

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("shape", [(40, 60), (3, 2), (1, 1)])
def test_values_are_those_of_scipy_inside_at_the_pixels_and_beyond_the_edges(shape):
    picture = RNG.normal(size=shape)
    xy = RNG.uniform(-6.0, 6.0 + max(shape), (500, 2))
    xy[:20] = np.floor(xy[:20]) + 0.5
    expected = map_coordinates(picture, xy[:, ::-1].T - 0.5, order=3, mode="nearest")
    np.testing.assert_allclose(Spline.through(picture).value(xy), expected, atol=1e-5)
    inside = np.all((xy > 0.5) & (xy < np.array(shape[::-1]) - 0.5), axis=-1)
    np.testing.assert_allclose(Spline.through(picture).value(xy[inside]), expected[inside], atol=1e-12)


def test_pixels_keep_their_values():
    picture = RNG.normal(size=(7, 9)).astype(np.float32)
    row, col = np.indices(picture.shape)
    xy = np.stack([col.ravel() + 0.5, row.ravel() + 0.5], -1)
    np.testing.assert_allclose(Spline.through(picture).value(xy), picture.ravel(), atol=1e-12)


def test_gradients_are_the_derivatives_of_the_values():
    spline, step = Spline.through(RNG.normal(size=(30, 40))), 1e-5
    xy = RNG.uniform([1.0, 1.0], [39.0, 29.0], (300, 2))
    value, gradient = spline.value_and_gradient(xy)
    np.testing.assert_array_equal(value, spline.value(xy))
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        numeric = (spline.value(xy + shift) - spline.value(xy - shift)) / (2 * step)
        np.testing.assert_allclose(gradient[:, axis], numeric, atol=1e-8)


def test_the_gradient_of_a_wave_is_the_waves():
    """Of eight pixels, to 1 per cent of the steepest."""
    col = np.indices((40, 60))[1]
    xy = RNG.uniform([15.0, 15.0], [45.0, 25.0], (200, 2))
    turn = 2 * np.pi / 8.0
    found = Spline.through(np.sin(turn * (col + 0.5))).value_and_gradient(xy)[1]
    np.testing.assert_allclose(found[:, 0], turn * np.cos(turn * xy[:, 0]), atol=0.01 * turn)
    np.testing.assert_allclose(found[:, 1], 0.0, atol=1e-6)
