"""The ground that a plan assumes: natural relief of a stated RMS slope over the place's tangent plane."""

from __future__ import annotations

import math

import numpy as np

from photoclinometry.simulate import albedo
from photoclinometry.simulate.presets import background, young_landforms
from photoclinometry.simulate.surface import Surface
from photoclinometry.simulate.terrain import Grid, rms_slope

SAMPLES_PER_PX = 2
"""Samples of the ground per pixel of the finest view, along each side: relief finer than pixels is noise of a map."""

_FRACTAL_SLOPE_DEG = 3.5
"""Slope between samples of the fractal part, before all is scaled: that of the simulator's old ground."""

_LARGEST_CRATER, _LARGEST_YOUNG = 0.5, 0.1
"""Diameters of the largest craters, worn and young, as shares of half the ground's side: they fit into it whole."""


def representative_ground(
    half_extent: float, gsd: float, finest_gsd: float, slope_deg: float, mean_albedo: float, seed: int
) -> Surface:
    """Fractal relief, craters and boulders over the square [-half_extent, half_extent]^2 [m], in the local frame.

    The recipe is the simulator's (`simulate/presets.py`), all heights scaled by one factor so that the RMS slope, of
    the gradient's length between points one gsd [m] apart, is the stated one. finest_gsd: of the finest view [m].
    """
    grid = Grid(finest_gsd / SAMPLES_PER_PX, math.ceil(half_extent * SAMPLES_PER_PX / finest_gsd))
    rng = np.random.default_rng([seed, 1])
    relief, log_albedo = background(
        grid, rng, slope_deg=_FRACTAL_SLOPE_DEG, longest=half_extent, largest_crater=_LARGEST_CRATER * half_extent
    )
    young_landforms(relief, log_albedo, grid, rng, _LARGEST_YOUNG * half_extent, half_extent)
    step = max(1, round(gsd / grid.spacing))
    along_axis = rms_slope(relief[::step, ::step], step * grid.spacing)
    relief *= np.float32(math.tan(math.radians(slope_deg)) / (math.sqrt(2.0) * along_axis))
    return Surface(
        relief, albedo.from_log(log_albedo, mean_albedo), grid.spacing, (float(grid.axis[0]), float(grid.axis[0]))
    )
