"""Fractal noise in space: sums of gradient noise (Perlin 1985, doi:10.1145/325165.325247) of halving wavelengths."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

import photoclinometry.model.kernel_cache  # noqa: F401
from photoclinometry.model.geometry import unit

_TABLE = 256
"""Entries of the table of gradients, a power of two."""
_CELLS_PER_WAVE = 1.6
"""Cells of the lattice to a wavelength at which gradient noise has most of its power."""


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """(3, 3) a rotation, all equally likely."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(unit(rng.standard_normal(4))).as_matrix()


def fractal_noise(
    points: np.ndarray, rng: np.random.Generator, hurst: float, longest: float, shortest: float
) -> np.ndarray:
    """(n,) noise of unit variance at points (n, 3), with octaves from `longest` to `shortest` wavelength.

    Amplitudes fall as wavelength^hurst. Every octave has a lattice turned and shifted at random.
    """
    octaves = max(math.floor(math.log2(longest / shortest)) + 1, 1)
    out = np.zeros(len(points))
    for n in range(octaves):
        wavelength = longest * 0.5**n
        turn = random_rotation(rng) * (_CELLS_PER_WAVE / wavelength)
        shift = rng.uniform(0.0, _TABLE, 3)
        order = rng.permutation(_TABLE)
        gradients = unit(rng.standard_normal((_TABLE, 3)))
        _add_noise(points, turn, shift, order, gradients, (wavelength / longest) ** hurst, out)
    return (out - out.mean()) / out.std()


@njit(cache=True, inline="always")
def _fade(t):
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@njit(cache=True, nogil=True)
def _add_noise(points, turn, shift, order, gradients, amplitude, out):
    """Adds one octave: at each corner of a cell a gradient chosen by hash, mixed by smooth weights."""
    last = order.size - 1
    for n in range(len(points)):
        p = points[n]
        x = turn[0, 0] * p[0] + turn[0, 1] * p[1] + turn[0, 2] * p[2] + shift[0]
        y = turn[1, 0] * p[0] + turn[1, 1] * p[1] + turn[1, 2] * p[2] + shift[1]
        z = turn[2, 0] * p[0] + turn[2, 1] * p[1] + turn[2, 2] * p[2] + shift[2]
        i, j, k = math.floor(x), math.floor(y), math.floor(z)
        x, y, z = x - i, y - j, z - k
        u, v, w = _fade(x), _fade(y), _fade(z)
        total = 0.0
        for a in range(2):
            row = order[(i + a) & last]
            for b in range(2):
                column = order[(row + j + b) & last]
                for c in range(2):
                    g = gradients[order[(column + k + c) & last]]
                    weight = (u if a else 1.0 - u) * (v if b else 1.0 - v) * (w if c else 1.0 - w)
                    total += weight * (g[0] * (x - a) + g[1] * (y - b) + g[2] * (z - c))
        out[n] += amplitude * total
