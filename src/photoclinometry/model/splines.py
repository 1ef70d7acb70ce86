"""Cubic splines through the pixels of an image, with their gradients.

Cubic B-splines (Thevenaz, Blu and Unser 2000, doi:10.1109/42.875199). SciPy makes the coefficients; its
`map_coordinates` has the same values, which tests compare, five times as slowly and without the gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

_BORDER_PX = 12
"""Width of the border by which edges repeat [px]: farther pixels have weights below 1e-6."""


@dataclass(frozen=True)
class Spline:
    """A picture between its pixels. Edges repeat."""

    coefficients: np.ndarray
    """(h, w) float64, of the B-splines about the pixels, with a border of _BORDER_PX."""

    @classmethod
    def through(cls, values: np.ndarray) -> Spline:
        """The spline that has values (h, w) at the centres of the pixels."""
        from scipy.ndimage import spline_filter

        return cls(spline_filter(np.pad(values, _BORDER_PX, mode="edge"), 3, np.float64, mode="mirror"))

    def value(self, xy: np.ndarray) -> np.ndarray:
        """(n,) at positions (n, 2) [px], (0.5, 0.5) the first pixel's centre."""
        return self._evaluated(xy)[0]

    def value_and_gradient(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value (n,) and gradient (n, 2) along x and y [per px] at positions (n, 2) [px]."""
        found = self._evaluated(xy)
        return found[0], found[1:].T

    def _evaluated(self, xy: np.ndarray) -> np.ndarray:
        out = np.empty((3, len(xy)))
        _evaluate(self.coefficients, np.asarray(xy, float) + (_BORDER_PX - 0.5), out)
        return out


@njit(cache=True, nogil=True)
def _weights(u):
    """Of the four B-splines about a position the share u of a pixel past the second of them."""
    left = 1.0 - u
    first, last = left * left * left / 6.0, u * u * u / 6.0
    second = 2.0 / 3.0 - u * u * (1.0 - 0.5 * u)
    return first, second, 1.0 - first - second - last, last


@njit(cache=True, nogil=True)
def _slopes(u):
    """Derivatives of `_weights`."""
    left = 1.0 - u
    first, last = -0.5 * left * left, 0.5 * u * u
    second = u * (1.5 * u - 2.0)
    return first, second, -first - second - last, last


@njit(cache=True, nogil=True)
def _evaluate(coefficients, xy, out):
    """Value, and derivatives along x and y, into out (3, n), at positions xy (n, 2) from the first coefficient."""
    height, width = coefficients.shape
    for n in range(len(xy)):
        x, y = min(max(xy[n, 0], 0.0), width - 1.0), min(max(xy[n, 1], 0.0), height - 1.0)
        col, row = min(max(math.floor(x), 1), width - 3), min(max(math.floor(y), 1), height - 3)
        across, across_slope = _weights(x - col), _slopes(x - col)
        down, down_slope = _weights(y - row), _slopes(y - row)
        value = by_x = by_y = 0.0
        for i in range(4):
            line = coefficients[row - 1 + i, col - 1 : col + 3]
            along = across[0] * line[0] + across[1] * line[1] + across[2] * line[2] + across[3] * line[3]
            slope = (
                across_slope[0] * line[0]
                + across_slope[1] * line[1]
                + across_slope[2] * line[2]
                + across_slope[3] * line[3]
            )
            value += down[i] * along
            by_x += down[i] * slope
            by_y += down_slope[i] * along
        out[0, n], out[1, n], out[2, n] = value, by_x, by_y
