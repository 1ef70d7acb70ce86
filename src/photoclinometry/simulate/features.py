"""The main landform of a preset: a fresh crater, a dome, or ridges.

`large_crater` and `dome` return the relief [m] over a grid, and the share of the older relief that survives there (0 to
1). The numbers are chosen by eye, so that images look like Dawn's; nothing in the estimate depends on them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.simulate.terrain import Grid, fractal_noise, fresh_profile


def periodic_noise(rng: np.random.Generator, angle: np.ndarray, lowest: int, highest: int) -> np.ndarray:
    """Noise of about unit variance along a circle; angle [rad]; amplitudes fall as order^-0.75."""
    order = np.arange(lowest, highest + 1)
    amplitude = order**-0.75 * rng.standard_normal(len(order))
    phase = rng.uniform(0.0, 2.0 * np.pi, len(order))
    table_angle = np.linspace(-np.pi, np.pi, 16 * highest + 1)
    table = np.sum(amplitude[:, None] * np.cos(order[:, None] * table_angle + phase[:, None]), 0)
    table /= np.std(table[:-1])
    return np.interp(angle, table_angle, table).astype(np.float32)


def smooth_step(x: np.ndarray, low: float, high: float) -> np.ndarray:
    """0 below `low`, 1 above `high`, with continuous derivative."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def polar(grid: Grid, center: tuple[float, float], stretch: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and direction [rad] of the samples from a centre; `stretch` > 1 elongates along y."""
    x, y = np.meshgrid(grid.axis - center[0], (grid.axis - center[1]) / stretch)
    x, y = x.astype(np.float32), y.astype(np.float32)
    return np.hypot(x, y), np.arctan2(y, x)


@dataclass(frozen=True, kw_only=True)
class CraterShape:
    """The dimensions of a large crater."""

    diameter: float
    """[m]."""
    center: tuple[float, float] = (0.0, 0.0)
    """(x, y) [m]."""
    depth: float = 0.2
    """From rim to floor [diameters]."""
    floor: float = 0.25
    """Radius of the flat floor [crater radii]."""
    gullies: float = 0.012
    """Depth of the gullies in the wall [diameters]."""
    terraces: float = 0.0
    """Height of slumped terraces parallel to the rim [diameters]."""
    peak: float = 0.0
    """Height of the central ridge [diameters]."""
    rim_softness: float = 0.03
    """Radius by which the rim's crest is rounded [crater radii]."""


def large_crater(grid: Grid, rng: np.random.Generator, crater: CraterShape) -> tuple[np.ndarray, np.ndarray]:
    """A crater with an angular outline, gullied walls, and optionally terraces and a central ridge."""
    diameter, radius, floor = crater.diameter, 0.5 * crater.diameter, crater.floor
    distance, angle = polar(grid, crater.center)
    outline = 1.0 + 0.035 * periodic_noise(rng, angle, 2, 9)
    r = distance / (radius * outline)
    soft = np.sqrt((r - 1.0) ** 2 + crater.rim_softness**2) - crater.rim_softness
    r_soft = np.where(r < 1.0, 1.0 - soft, 1.0 + soft)
    shape = np.linspace(0.0, 3.5, 1401)
    relief = np.interp(r_soft, shape, fresh_profile(shape, 2.0 * crater.depth, 0.4 * crater.depth, floor)) * radius

    # Walls: gullies that run down, hummocky debris, slumped terraces parallel to the rim.
    wall = smooth_step(r, floor, floor + 0.3) * (1.0 - smooth_step(r, 0.93, 1.03))
    hummocks = fractal_noise(grid, rng, 0.8, 0.15 * diameter, 3.0 * grid.spacing)
    incised = wall * (0.6 + 0.5 * np.tanh(hummocks))
    bent = angle + 0.03 * np.sin(9.0 * r) + 0.005 * hummocks
    relief += crater.gullies * diameter * incised * periodic_noise(rng, bent, 9, 120)
    relief += 0.0025 * diameter * wall * hummocks
    if crater.terraces:
        wave = 2.0 * np.pi * (4.5 * r + 0.35 * periodic_noise(rng, angle, 1, 7))
        relief += crater.terraces * diameter * wall * (np.sin(wave) + 0.35 * np.sin(2.0 * wave + 0.9))
    if crater.peak:
        along, across = polar_axes(distance, angle, rng.uniform(0.0, np.pi))
        ridge = np.exp(-((along / (0.28 * radius)) ** 2) - (across / (0.09 * radius)) ** 2)
        relief += crater.peak * diameter * ridge * (1.0 + 0.25 * hummocks)

    # Ejecta: hummocks and faint radial ridges that fade outwards.
    apron = smooth_step(r, 1.0, 1.3) * np.exp(-np.maximum(r - 1.0, 0.0) / 0.5)
    rays = periodic_noise(rng, bent + 0.15 * r, 8, 60)
    relief += 0.003 * diameter * apron * (hummocks + 0.4 * rays)
    survives = 0.25 + 0.75 * smooth_step(r, 0.9, 1.9)
    return relief.astype(np.float32), survives.astype(np.float32)


def polar_axes(distance: np.ndarray, angle: np.ndarray, azimuth: float) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates along and across a direction [rad] of the plane."""
    return distance * np.cos(angle - azimuth), distance * np.sin(angle - azimuth)


def dome(
    grid: Grid,
    rng: np.random.Generator,
    *,
    height: float,
    base: float,
    center: tuple[float, float] = (0.0, 0.0),
    stretch: float = 1.25,
) -> tuple[np.ndarray, np.ndarray]:
    """A steep dome of the given height and base diameter [m]: rough top, straight gullied flanks, a toe."""
    distance, angle = polar(grid, center, stretch)
    r = distance / (0.5 * base * (1.0 + 0.05 * periodic_noise(rng, angle, 2, 8)))
    flank = np.clip((1.0 - r) / 0.72, 0.0, 1.0)
    shape = np.where(flank < 0.12, flank**2 / 0.24, flank - 0.06) / 0.94
    shape = np.where(shape > 0.86, 0.86 + 0.14 * (1.0 - np.exp(-(shape - 0.86) / 0.14)), shape)
    on_flank = smooth_step(r, 0.2, 0.4) * (1.0 - smooth_step(r, 0.85, 1.0))
    relief = height * shape / shape.max()
    relief += 0.008 * height * on_flank * periodic_noise(rng, angle + 0.05 * np.sin(8.0 * r), 10, 80)
    relief += 0.003 * height * on_flank * periodic_noise(rng, angle, 60, 300)
    survives = 0.35 + 0.65 * smooth_step(r, 0.85, 1.1)
    return relief.astype(np.float32), survives.astype(np.float32)


def ridges(
    grid: Grid,
    rng: np.random.Generator,
    *,
    height: float,
    wavelength: float,
    azimuth: float,
    within: np.ndarray,
    undulation: np.ndarray,
) -> np.ndarray:
    """Sub-parallel ridges [m] perpendicular to `azimuth` [rad], weighted by `within` (0 to 1).

    undulation: a field of unit variance that bends the ridges and makes them end.
    """
    x, y = np.meshgrid(grid.axis, grid.axis)
    across = np.cos(azimuth) * x + np.sin(azimuth) * y
    phase = 2.0 * np.pi * across / wavelength + 2.0 * undulation + rng.uniform(0.0, 2.0 * np.pi)
    crest = (0.5 + 0.5 * np.sin(phase)) ** 2
    strength = smooth_step(undulation, -1.2, 0.6)
    return (height * crest * strength * within).astype(np.float32)
