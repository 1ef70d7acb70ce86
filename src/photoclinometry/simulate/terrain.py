"""Natural relief: fractal roughness, craters from fresh to degraded, boulders, slides.

All act on a square grid of the tangent frame of `surface.py` and add to an array of heights. Numbers without a source
are chosen by eye; nothing in the estimate depends on them.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

import photoclinometry.model.kernel_cache  # noqa: F401

SATURATION = 1.54
"""N(> D) D^2 of craters packed as closely as they can be (Gault 1970, Radio Science 5, 273-291)."""
PROFILE_REACH = 3.5
"""Profiles end at this distance from the centre [crater radii]."""
_PROFILE_SAMPLES = 225
"""64 samples per crater radius."""
BOULDER = 0
"""Row of `profiles` that holds the boulder; the other rows hold craters, fresh first."""
_AGES = np.geomspace(3e-3, 0.3, 24)
"""Diffusion ages kappa t / R^2 of the craters in `profiles`."""
_DIFFUSION_STEP = 0.2
"""kappa dt / dr^2 of a step; explicit diffusion is unstable above 0.5."""
FADED = 0.25
"""Age, as a share of all, from which craters neither brighten nor darken the ground."""
_DARK_SHARE = 0.25
"""Share of the craters that darken the ground instead of brightening it."""
_CRATER_OUTLINE, _BOULDER_OUTLINE = 0.04, 0.1
"""Standard deviation of the harmonics of the outline [radii]."""
BRIGHT_REACH2 = 1.6
"""Square of the distance at which brightening falls to 1/e [radii^2]."""
_OUTLINE_REACH = 1.1
"""Factor by which an outline may enlarge the reach of a landform."""
_REACH2 = 13.5
"""Square of the distance beyond which a landform adds nothing [radii^2]."""
_SLIDE = 0.2
"""Share of the excess height that moves to a neighbour in one pass."""


@dataclass(frozen=True)
class Grid:
    """Regular samples of the tangent plane: sample [i, j] is at (x[j], y[i])."""

    spacing: float
    """[m]."""
    half: int
    """Samples on each side of the centre."""

    @property
    def shape(self) -> tuple[int, int]:
        return 2 * self.half + 1, 2 * self.half + 1

    @property
    def half_extent(self) -> float:
        """[m]."""
        return self.half * self.spacing

    @property
    def axis(self) -> np.ndarray:
        """(2 half + 1,) x of the columns, and y of the rows [m]."""
        return (np.arange(2 * self.half + 1) - self.half) * self.spacing


def fractal_noise(
    grid: Grid,
    rng: np.random.Generator,
    hurst: float,
    longest: float,
    shortest: float,
) -> np.ndarray:
    """Gaussian field (n, m) float32 of unit variance whose power falls as k^-(2 hurst + 2).

    longest, shortest [m]: wavelengths above which the spectrum is flat, and below which it fades out.
    """
    from scipy import fft as scipy_fft

    fft: Any = scipy_fft
    n = fft.next_fast_len(grid.shape[0], real=True)
    spectrum = fft.rfft2(rng.standard_normal((n, n), dtype=np.float32), overwrite_x=True)
    rows, cols = fft.fftfreq(n, grid.spacing), fft.rfftfreq(n, grid.spacing)
    k2 = (rows[:, None] ** 2 + cols**2).astype(np.float32)
    spectrum *= np.exp(-0.5 * (hurst + 1.0) * np.log(k2 + longest**-2.0) - (k2 * shortest**2) ** 2)
    spectrum[0, 0] = 0.0
    field = fft.irfft2(spectrum, s=(n, n), overwrite_x=True)[: grid.shape[0], : grid.shape[1]]
    return np.ascontiguousarray(field / field.std(dtype=np.float64), np.float32)


def rms_slope(height: np.ndarray, spacing: float) -> float:
    """Root mean square slope [-] along one axis, between neighbouring samples."""
    return float(np.sqrt(np.mean(np.diff(height, axis=1).astype(np.float64) ** 2)) / spacing)


def fresh_profile(r: np.ndarray, depth: float = 0.4, rim: float = 0.08, floor: float = 0.1) -> np.ndarray:
    """Height [crater radii] of a fresh simple crater at distance r [crater radii] from its centre.

    A paraboloid bowl, flat inside `floor`, `depth` from rim to floor (0.4 R is depth / diameter 0.2:
    Pike 1977), a rim that stands `rim` above the surroundings, and ejecta that thin as r^-3
    (McGetchin et al. 1973), fading out at 3 radii.
    """
    r = np.asarray(r, float)
    bowl = rim - depth + depth * np.clip((r - floor) / (1.0 - floor), 0.0, 1.0) ** 2
    taper = np.clip((3.0 - r) / 2.0, 0.0, 1.0)
    ejecta = rim * np.maximum(r, 1.0) ** -3.0 * taper * taper * (3.0 - 2.0 * taper)
    return np.where(r < 1.0, bowl, ejecta)


def diffused_profiles(ages: np.ndarray) -> np.ndarray:
    """(n, m) `fresh_profile` after downslope creep, dz/dt = kappa laplacian z (Culling 1960), on [0, 3.5].

    ages: (n,) ascending kappa t / R^2.
    """
    r = np.linspace(0.0, PROFILE_REACH, _PROFILE_SAMPLES)
    dr = r[1]
    z, now, out = fresh_profile(r), 0.0, []
    between = r[:-1] + 0.5 * dr
    for age in ages:
        steps = max(math.ceil((age - now) / (_DIFFUSION_STEP * dr * dr)), 1)
        dt = (age - now) / steps
        for _ in range(steps):
            flux = between * np.diff(z) / dr
            change = np.empty_like(z)
            change[1:-1] = np.diff(flux) / (r[1:-1] * dr)
            change[0] = 4.0 * (z[1] - z[0]) / (dr * dr)
            change[-1] = 0.0
            z = z + dt * change
        now = age
        out.append(z.copy())
    return np.array(out)


@functools.cache
def profiles() -> np.ndarray:
    """(25, m) float32 heights [radii] at [0, 3.5] radii: a boulder, then craters from fresh to degraded."""
    r = np.linspace(0.0, PROFILE_REACH, _PROFILE_SAMPLES)
    boulder = np.exp(-2.0 * r**2)
    return np.vstack([boulder, diffused_profiles(_AGES)]).astype(np.float32)


@dataclass(frozen=True)
class Landforms:
    """n roughly circular landforms: craters and boulders."""

    xy: np.ndarray
    """(n, 2) centres [m]."""
    radius: np.ndarray
    """(n,) [m]."""
    profile: np.ndarray
    """(n,) int64 row of `profiles`."""
    brightening: np.ndarray
    """(n,) change of log albedo at the centre."""
    outline: np.ndarray
    """(n, 4) cosine and sine amplitudes of the radius' second and third harmonic."""

    def __len__(self) -> int:
        return len(self.radius)

    def __getitem__(self, index: np.ndarray) -> Landforms:
        return Landforms(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def power_law_sizes(rng: np.random.Generator, smallest: float, largest: float, slope: float, count: int) -> np.ndarray:
    """(count,) sizes between two limits whose cumulative number falls as size^-slope, large ones first."""
    share = rng.random(count)
    low, high = smallest**-slope, largest**-slope
    return np.sort((low - share * (low - high)) ** (-1.0 / slope))[::-1]


def crater_population(
    grid: Grid,
    rng: np.random.Generator,
    *,
    density: float,
    smallest: float,
    largest: float,
    slope: float = 2.0,
    freshest: float = 0.0,
    fresh_brightening: float = 0.25,
) -> Landforms:
    """Craters of diameters `smallest` to `largest` [m] anywhere on the grid.

    N(> D) = density SATURATION D^-slope per m^2 for slope 2, scaled to agree at `smallest` otherwise: old
    surfaces carry a few percent of saturation with slope 2 (Gault 1970). Ages are uniform in their logarithm (as if
    creep and formation balanced); `freshest` in [0, 1) omits this share of the range at its fresh end. The freshest
    craters brighten their surroundings, one in four darkens them.
    """
    area = (2.0 * grid.half_extent) ** 2
    per_area = density * SATURATION * smallest**-2.0 * (1.0 - (largest / smallest) ** -slope)
    count = rng.poisson(per_area * area)
    age = freshest + (1.0 - freshest) * rng.random(count)
    sign = np.where(rng.random(count) < _DARK_SHARE, -1.0, 1.0)
    return Landforms(
        xy=rng.uniform(-grid.half_extent, grid.half_extent, (count, 2)),
        radius=0.5 * power_law_sizes(rng, smallest, largest, slope, count),
        profile=1 + (age * (len(_AGES) - 1e-9)).astype(np.int64),
        brightening=fresh_brightening * sign * np.maximum(1.0 - age / FADED, 0.0),
        outline=_CRATER_OUTLINE * rng.standard_normal((count, 4)),
    )


def boulder_field(rng: np.random.Generator, *, count: int, spread: float, smallest: float, largest: float) -> Landforms:
    """Boulders about the centre, Gaussian of width `spread` [m]; diameters [m] with cumulative slope 3."""
    return Landforms(
        xy=spread * rng.standard_normal((count, 2)),
        radius=0.5 * power_law_sizes(rng, smallest, largest, 3.0, count),
        profile=np.full(count, BOULDER, np.int64),
        brightening=np.zeros(count),
        outline=_BOULDER_OUTLINE * rng.standard_normal((count, 4)),
    )


def stamp(height: np.ndarray, log_albedo: np.ndarray, grid: Grid, landforms: Landforms) -> None:
    """Adds the relief of landforms to `height` and their brightening to `log_albedo`, in place."""
    _stamp(
        height,
        log_albedo,
        grid.spacing,
        grid.half,
        profiles(),
        landforms.xy,
        landforms.radius,
        landforms.profile,
        landforms.brightening,
        landforms.outline,
    )


def settle(height: np.ndarray, spacing: float, repose_deg: float = 36.0, passes: int = 24) -> None:
    """Lets ground steeper than the angle of repose slide to its neighbours, in place, in `passes` passes.

    Where crater walls overlap, the sum of their slopes would otherwise exceed that of loose ground.
    """
    limit = math.tan(math.radians(repose_deg)) * spacing
    for _ in range(passes):
        _slide(height, height.copy(), limit)


@njit(cache=True)
def _slide(height, before, limit):
    """Moves a share _SLIDE of each height difference beyond `limit` between neighbours."""
    rows, cols = height.shape
    for i in range(rows):
        for j in range(cols):
            z = before[i, j]
            if j + 1 < cols:
                drop = z - before[i, j + 1]
                if abs(drop) > limit:
                    moved = np.float32(_SLIDE * (drop - math.copysign(limit, drop)))
                    height[i, j] -= moved
                    height[i, j + 1] += moved
            if i + 1 < rows:
                drop = z - before[i + 1, j]
                if abs(drop) > limit:
                    moved = np.float32(_SLIDE * (drop - math.copysign(limit, drop)))
                    height[i, j] -= moved
                    height[i + 1, j] += moved


@njit(cache=True)
def _stamp(height, log_albedo, spacing, half, table, xy, radius, profile, brightening, outline):
    """`stamp` into height and log_albedo (rows, cols). spacing [m]; half: samples from the grid's edge to its middle.

    table: (P, S) profiles of height over radius, to PROFILE_REACH radii. xy: (n, 2) [m] from the middle; radius [m],
    profile (a row of the table), brightening: (n,); outline: (n, 4) amplitudes of cos and sin of twice and three times
    the azimuth.
    """
    rows, cols = height.shape
    per_radius = (table.shape[1] - 1) / PROFILE_REACH
    for n in range(len(radius)):
        size = radius[n] / spacing
        u, v = xy[n, 0] / spacing + half, xy[n, 1] / spacing + half
        reach = PROFILE_REACH * size * _OUTLINE_REACH
        for i in range(max(math.ceil(v - reach), 0), min(int(v + reach) + 1, rows)):
            for j in range(max(math.ceil(u - reach), 0), min(int(u + reach) + 1, cols)):
                x, y = (j - u) / size, (i - v) / size
                r2 = max(x * x + y * y, 1e-12)
                if r2 > _REACH2:
                    continue
                r = math.sqrt(r2)
                c2, s2 = (x * x - y * y) / r2, 2.0 * x * y / r2
                c3, s3 = (c2 * x - s2 * y) / r, (s2 * x + c2 * y) / r
                o = outline[n]
                r *= 1.0 + o[0] * c2 + o[1] * s2 + o[2] * c3 + o[3] * s3
                at = r * per_radius
                k = int(at)
                if k >= table.shape[1] - 1:
                    continue
                f = at - k
                height[i, j] += radius[n] * ((1.0 - f) * table[profile[n], k] + f * table[profile[n], k + 1])
                if brightening[n] != 0.0:
                    log_albedo[i, j] += brightening[n] * math.exp(-r2 / BRIGHT_REACH2)
