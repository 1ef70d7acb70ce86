"""Values between pixels: exact for what a spline of the order represents, by hand where linear."""

import numpy as np
import pytest

from photoclinometry.model.image import Image
from photoclinometry.model.region import Region
from photoclinometry.model.sampling import gaussian, masked_filter, sample, sample_image

CENTERS = Region.of_image(40, 60).pixel_centers()
INNER = np.random.default_rng(0).uniform(12.0, 28.0, (200, 2))


@pytest.mark.parametrize("order", [1, 3])
def test_a_ramp_stays_one(order):
    def ramp(xy):
        return np.stack([xy @ [0.3, -0.7] + 2.0, xy @ [1.0, 0.0]], axis=-1)

    np.testing.assert_allclose(sample(ramp(CENTERS), INNER, order=order), ramp(INNER), atol=1e-6)


def test_a_cubic_stays_one():
    def cubic(xy):
        x, y = np.moveaxis(xy / 30.0, -1, 0)
        return x**3 - 2.0 * x * x * y + y * y

    np.testing.assert_allclose(sample(cubic(CENTERS), INNER), cubic(INNER), atol=1e-5)


def test_linear_by_hand_and_edges_repeat():
    values = np.array([[0.0, 10.0], [20.0, 30.0]])
    at = np.array([[1.0, 0.5], [1.0, 1.0], [-5.0, 0.5], [1.5, 9.0]])
    np.testing.assert_allclose(sample(values, at, order=1), [5.0, 15.0, 0.0, 30.0])


def test_brightness_between_pixels_is_that_of_the_optics():
    """A wave of six pixels, blurred by a point-spread function of 0.7 px: splines interpolate it to 1 %."""
    col = np.indices((60, 80))[1]
    wave = Image("wave", np.cos((col + 0.5) / 6.0 * 2 * np.pi).astype(np.float32), np.ones((60, 80), bool))
    xy = np.random.default_rng(0).uniform([20.0, 20.0], [60.0, 40.0], (300, 2))
    value, valid = sample_image(wave, xy)
    assert valid.all()
    true = np.cos(xy[:, 0] / 6.0 * 2 * np.pi)
    np.testing.assert_allclose(value, true, atol=0.01)
    assert np.abs(sample(wave.brightness, xy, order=1) - true).max() > 0.1


def test_a_window_of_the_image_gives_the_same_values_as_the_whole():
    rng = np.random.default_rng(1)
    image = Image("noise", rng.normal(size=(120, 150)).astype(np.float32), np.ones((120, 150), bool))
    xy = rng.uniform([60.0, 50.0], [70.0, 60.0], (50, 2))
    np.testing.assert_allclose(sample_image(image, xy)[0], sample(image.brightness, xy), atol=1e-6)


def test_invalid_pixels_change_only_positions_beside_them():
    row, col = np.indices((50, 50))
    brightness = (0.1 + 0.002 * col + 0.001 * row).astype(np.float32)
    valid = np.ones((50, 50), bool)
    valid[25, 20] = False
    brightness[25, 20] = np.nan
    xy = np.array([[20.4, 25.5], [21.4, 26.4], [22.1, 25.5], [30.2, 25.5], [0.3, 10.0], [49.6, 10.0], [25.0, 49.9]])
    value, known = sample_image(Image("a", brightness, valid), xy)
    assert known.tolist() == [False, False, True, True, False, False, False]
    x, y = xy[known].T
    np.testing.assert_allclose(value[known], 0.1 + 0.002 * (x - 0.5) + 0.001 * (y - 0.5), atol=3e-4)
    assert np.all(value[~known] == 0.0)
    assert not sample_image(Image("b", brightness, np.zeros_like(valid)), xy)[1].any()


def test_a_masked_filter_leaves_a_constant_as_it_is_wherever_any_of_it_is_near():
    """And the share is the filter's own answer to the mask."""
    there = np.zeros((20, 30), bool)
    there[4:12, 5:9] = True
    smooth = gaussian(2.0)
    field = np.where(there[..., None], [3.0, -1.0], np.nan)
    average, share = masked_filter(field, smooth)
    near = share > 0.0
    np.testing.assert_allclose(average[near], np.broadcast_to([3.0, -1.0], average.shape)[near], rtol=1e-12)
    assert np.isnan(average[~near]).all()
    assert 0 < near.sum() < near.size
    np.testing.assert_array_equal(share, smooth(there.astype(float)))


def test_a_masked_filter_takes_no_cell_where_any_layer_lacks():
    field = np.ones((9, 9, 2))
    field[4, 4] = np.nan, 1e6
    average, _ = masked_filter(field, gaussian(1.0))
    np.testing.assert_allclose(average, 1.0, rtol=1e-12)
