"""The true surface: heights and albedo on a regular grid, smooth between the samples.

Local tangent frame, which is the body-fixed frame B of a simulated site: x east, y north, z up [m]. Row i
of a grid lies at y = origin[1] + i spacing, column j at x = origin[0] + j spacing; rows go north. The
sphere's curvature is part of the heights.

Between the samples the height is the Catmull-Rom bicubic: it passes through the samples and its slope is
continuous, so that rays, normals and distances use one surface. Albedo is bilinear, so that it keeps its
range and its edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

import photoclinometry.model.kernel_cache  # noqa: F401
from photoclinometry.model.errors import InputError

_WIDEST_SPHERE = 0.9
"""Distance from the origin, in radii, to which a sphere is a height field of usable slope (64 degrees)."""


@dataclass(frozen=True)
class Surface:
    """A height field with an albedo."""

    height: np.ndarray
    """(n, m) float32 or float64, z in B [m]."""
    albedo: np.ndarray
    """(n, m) normal albedo: I/F at zero incidence, emission and phase."""
    spacing: float
    """Distance between neighbouring samples, in x and y [m]."""
    origin: tuple[float, float]
    """(x, y) of sample [0, 0] in B [m]."""

    def __post_init__(self):
        if self.height.shape != self.albedo.shape or self.height.ndim != 2 or min(self.height.shape) < 4:
            raise InputError(
                f"height {self.height.shape} and albedo {self.albedo.shape} must be equal grids of 4 x 4 or more"
            )
        if not self.spacing > 0:
            raise InputError(f"grid spacing must be positive, got {self.spacing}")

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(x_min, x_max, y_min, y_max) [m]."""
        (rows, cols), (x, y) = self.height.shape, self.origin
        return x, x + (cols - 1) * self.spacing, y, y + (rows - 1) * self.spacing

    def grid_coordinates(self, xy: np.ndarray) -> np.ndarray:
        """Fractional (column, row) of points (..., 2) in B."""
        return (np.asarray(xy, float) - self.origin) / self.spacing

    def height_at(self, xy: np.ndarray) -> np.ndarray:
        """Heights (...) at points (..., 2); points beyond the grid take the height of its edge."""
        return self._sample(xy)[..., 0]

    def normal_at(self, xy: np.ndarray) -> np.ndarray:
        """Outward unit normals (..., 3) at points (..., 2)."""
        slope = self._sample(xy)[..., 1:]
        normal = np.concatenate([-slope, np.ones_like(slope[..., :1])], -1)
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def albedo_at(self, xy: np.ndarray) -> np.ndarray:
        """Normal albedo (...) at points (..., 2)."""
        uv = self.grid_coordinates(xy)
        flat = np.ascontiguousarray(uv.reshape(-1, 2))
        out = np.empty(len(flat))
        _bilinear_many(self.albedo, flat, out)
        return out.reshape(uv.shape[:-1])

    def _sample(self, xy: np.ndarray) -> np.ndarray:
        """(..., 3): height, dz/dx, dz/dy."""
        uv = self.grid_coordinates(xy)
        flat = np.ascontiguousarray(uv.reshape(-1, 2))
        out = np.empty((len(flat), 3))
        _bicubic_many(self.height, flat, out)
        out[:, 1:] /= self.spacing
        return out.reshape(*uv.shape[:-1], 3)


def sphere_drop(x: np.ndarray, y: np.ndarray, radius: float) -> np.ndarray:
    """Height (<= 0) of a sphere that touches the plane z = 0 at the origin from below, in the unit of the arguments.

    Raises InputError beyond _WIDEST_SPHERE radii from the origin.
    """
    across2 = x * x + y * y
    if np.max(across2) > (_WIDEST_SPHERE * radius) ** 2:
        raise InputError(
            f"the terrain reaches {math.sqrt(np.max(across2)):.3g} m from its centre on a body of radius "
            f"{radius:.3g} m; choose smaller images or a finer ground sample distance"
        )
    return -across2 / (radius + np.sqrt(radius * radius - across2))


@njit(cache=True, nogil=True, inline="always")
def cubic_weights(f):
    """Catmull-Rom weights of samples -1, 0, 1, 2 at f in [0, 1]."""
    g = 1.0 - f
    return (
        -0.5 * f * g * g,
        1.0 + f * f * (1.5 * f - 2.5),
        1.0 + g * g * (1.5 * g - 2.5),
        -0.5 * g * f * f,
    )


@njit(cache=True, nogil=True, inline="always")
def cubic_slopes(f):
    """Derivatives of `cubic_weights` by f."""
    return (
        -0.5 + f * (2.0 - 1.5 * f),
        f * (4.5 * f - 5.0),
        0.5 + f * (4.0 - 4.5 * f),
        f * (1.5 * f - 1.0),
    )


@njit(cache=True, nogil=True, inline="always")
def _weighted_row(grid, i, a, b, c, d, w):
    return w[0] * grid[i, a] + w[1] * grid[i, b] + w[2] * grid[i, c] + w[3] * grid[i, d]


@njit(cache=True, nogil=True)
def cell_height(height, i, j, u, v):
    """Bicubic height at grid coordinates (u, v) by the polynomial of cell [i, j] (row, column)."""
    rows, cols = height.shape
    wu, wv = cubic_weights(u - j), cubic_weights(v - i)
    a, c, d = max(j - 1, 0), j + 1, min(j + 2, cols - 1)
    return (
        wv[0] * _weighted_row(height, max(i - 1, 0), a, j, c, d, wu)
        + wv[1] * _weighted_row(height, i, a, j, c, d, wu)
        + wv[2] * _weighted_row(height, i + 1, a, j, c, d, wu)
        + wv[3] * _weighted_row(height, min(i + 2, rows - 1), a, j, c, d, wu)
    )


@njit(cache=True, nogil=True)
def height_and_slopes(height, u, v):
    """Bicubic height and its derivatives by u and v [m per sample] at grid coordinates (column, row).

    Coordinates beyond the grid are moved to its edge.
    """
    rows, cols = height.shape
    u, v = min(max(u, 0.0), cols - 1.0), min(max(v, 0.0), rows - 1.0)
    j, i = min(int(u), cols - 2), min(int(v), rows - 2)
    wu, wv = cubic_weights(u - j), cubic_weights(v - i)
    su, sv = cubic_slopes(u - j), cubic_slopes(v - i)
    a, c, d = max(j - 1, 0), j + 1, min(j + 2, cols - 1)
    z, z_u, z_v = 0.0, 0.0, 0.0
    for k in range(4):
        row = min(max(i - 1 + k, 0), rows - 1)
        value = _weighted_row(height, row, a, j, c, d, wu)
        z += wv[k] * value
        z_u += wv[k] * _weighted_row(height, row, a, j, c, d, su)
        z_v += sv[k] * value
    return z, z_u, z_v


@njit(cache=True, nogil=True)
def bilinear(grid, u, v):
    """Bilinear value at grid coordinates (column, row), moved to the edge if beyond it."""
    rows, cols = grid.shape
    u, v = min(max(u, 0.0), cols - 1.0), min(max(v, 0.0), rows - 1.0)
    j, i = min(int(u), cols - 2), min(int(v), rows - 2)
    f, g = u - j, v - i
    return (1 - g) * ((1 - f) * grid[i, j] + f * grid[i, j + 1]) + g * (
        (1 - f) * grid[i + 1, j] + f * grid[i + 1, j + 1]
    )


@njit(cache=True, nogil=True)
def _bicubic_many(height, uv, out):
    for n in range(len(uv)):
        out[n, 0], out[n, 1], out[n, 2] = height_and_slopes(height, uv[n, 0], uv[n, 1])


@njit(cache=True, nogil=True)
def _bilinear_many(grid, uv, out):
    for n in range(len(uv)):
        out[n] = bilinear(grid, uv[n, 0], uv[n, 1])
