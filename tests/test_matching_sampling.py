"""Values between pixels: exact for what a spline of the order represents, by hand where linear."""

import numpy as np
import pytest

from photoclinometry.matching.sampling import sample
from photoclinometry.scene import Region

CENTERS = Region(row=0, col=0, height=40, width=60).pixel_centers()
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
