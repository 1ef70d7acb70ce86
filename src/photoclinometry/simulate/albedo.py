"""Normal albedo of simulated ground: smooth mottling, patches with sharp edges, streaks down the slopes.

The numbers are chosen by eye, so that images look like Dawn's; nothing in the estimate depends on them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from photoclinometry.simulate.features import smooth_step
from photoclinometry.simulate.terrain import Grid, fractal_noise

_STREAK_SLOPES = (0.27, 0.55)
"""Slopes [-] where streaks begin (15 degrees) and are full (29 degrees)."""


def mottling(grid: Grid, rng: np.random.Generator, amplitude: float, longest: float) -> np.ndarray:
    """Smooth variation of log albedo (n, m) with standard deviation `amplitude`. longest: longest wavelength [m]."""
    return np.float32(amplitude) * fractal_noise(grid, rng, 0.6, longest, 4.0 * grid.spacing)


def deposits(
    grid: Grid,
    rng: np.random.Generator,
    amplitude: float,
    size: float,
    cover: float,
    edge: float,
    near: np.ndarray,
) -> np.ndarray:
    """Patches (n, m) that change log albedo by `amplitude`, about `size` [m] across.

    cover: share of the area where near = 1; edge: width of the margins in standard deviations of the underlying
    field (0.05 is sharp, 1 is diffuse); near: (n, m) 0 to 1, the weight of the deposits at each place.
    """
    field = fractal_noise(grid, rng, 1.1, size, 3.0 * grid.spacing)
    threshold = float(np.quantile(field[::7, ::7], 1.0 - cover))
    inside = smooth_step(field - threshold * (2.0 - near) + 0.5 * (near - 1.0), -0.5 * edge, 0.5 * edge)
    return (amplitude * inside * smooth_step(near, 0.0, 0.5)).astype(np.float32)


def slope_streaks(
    height: np.ndarray, grid: Grid, rng: np.random.Generator, amplitude: float, length: float
) -> np.ndarray:
    """Streaks (n, m) of log albedo along the lines of steepest descent, where slopes exceed about 15 degrees.

    White noise is averaged upslope over `length` [m], like material that came from there (line integral convolution:
    Cabral & Leedom 1993).
    """
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(height, 2.0)
    noise = gaussian_filter(rng.standard_normal(height.shape, dtype=np.float32), 1.2)
    noise /= noise.std()
    steps = max(round(length / grid.spacing), 4)
    out = np.zeros(height.shape, np.float32)
    _average_upslope(smooth, noise, grid.spacing, steps, *_STREAK_SLOPES, out)
    return np.float32(amplitude) * out


@njit(cache=True)
def _average_upslope(height, noise, spacing, steps, gentle, steep, out):
    """Mean of `noise` upslope, scaled to unit variance; fades in between slopes `gentle` and `steep` [-]."""
    rows, cols = height.shape
    for i in range(1, rows - 1):
        for j in range(1, cols - 1):
            gx, gy = height[i, j + 1] - height[i, j - 1], height[i + 1, j] - height[i - 1, j]
            slope = math.sqrt(gx * gx + gy * gy) / (2.0 * spacing)
            if slope <= gentle:
                continue
            u, v, total, count = float(j), float(i), 0.0, 0
            for _ in range(steps):
                a, b = int(u + 0.5), int(v + 0.5)
                if a < 1 or b < 1 or a >= cols - 1 or b >= rows - 1:
                    break
                gx, gy = height[b, a + 1] - height[b, a - 1], height[b + 1, a] - height[b - 1, a]
                length = math.sqrt(gx * gx + gy * gy)
                if length < 0.4 * gentle * spacing:
                    break
                total += noise[b, a]
                count += 1
                u += gx / length
                v += gy / length
            if count:
                fade = min((slope - gentle) / (steep - gentle), 1.0)
                out[i, j] = fade * total / math.sqrt(count * 3.0)


def from_log(log_albedo: np.ndarray, mean: float, spread: float = 0.45) -> np.ndarray:
    """(n, m) float32 normal albedo with the given mean, from log albedo with any mean.

    Departures are compressed (tanh) to stay within a factor of exp(spread) of the mean.
    """
    centred = log_albedo - log_albedo.mean(dtype=np.float64)
    albedo = np.exp(spread * np.tanh(centred / spread))
    return (albedo * (mean / albedo.mean(dtype=np.float64))).astype(np.float32)
