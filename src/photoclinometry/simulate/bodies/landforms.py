"""Craters and boulders on a closed mesh: heights along the normals of its smooth shape.

Craters have the profiles of `terrain.py`, from fresh to degraded. Boulders are convex polyhedra half buried.
Ground that faces away from a landform's axis is not touched, so that a crater on one side of a neck leaves the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from photoclinometry.model.geometry import tangent_basis, unit
from photoclinometry.simulate.terrain import (
    BRIGHT_REACH2,
    FADED,
    PROFILE_REACH,
    SATURATION,
    power_law_sizes,
    profiles,
)

_OUTLINE = 0.05
"""Standard deviation of the harmonics of a crater's outline [radii]."""
_OUTLINE_REACH = 1.15
"""Factor by which an outline may enlarge the reach of a crater."""
_DARK_SHARE = 0.3
"""Share of the craters that darken the ground instead of brightening it."""
_FACES = 7
"""Steep faces of a boulder."""
_BOULDER_REACH = 1.3
"""Radii beyond which a boulder ends."""
_CELLS = 160
"""Cells of the search grid along the longest side of a body, at most."""
_FACING = 0.45
"""Cosine between a landform's axis and the ground from which on it is whole; it fades out to 0."""


class VertexGrid:
    """The vertices of a mesh sorted into cubic cells, to find those near a point."""

    def __init__(self, vertices: np.ndarray, spacing: float):
        low = vertices.min(0)
        extent = np.ptp(vertices, axis=0)
        self.cell = max(4.0 * spacing, float(extent.max()) / _CELLS)
        self.origin = low
        self.shape = (extent / self.cell).astype(np.int64) + 1
        index = ((vertices - low) / self.cell).astype(np.int64)
        flat = (index[:, 0] * self.shape[1] + index[:, 1]) * self.shape[2] + index[:, 2]
        self.order = np.argsort(flat, kind="stable")
        self.start = np.r_[0, np.cumsum(np.bincount(flat, minlength=int(self.shape.prod())))]


@dataclass(frozen=True)
class Craters:
    """n craters."""

    vertex: np.ndarray
    """(n,) vertex of the mesh that each is centred on."""
    radius: np.ndarray
    """(n,) in units of the mesh."""
    profile: np.ndarray
    """(n,) int64 row of `terrain.profiles`."""
    brightening: np.ndarray
    """(n,) change of log albedo at the centre."""
    outline: np.ndarray
    """(n, 4) cosine and sine amplitudes of the radius' second and third harmonic."""


@dataclass(frozen=True)
class Boulders:
    """n boulders."""

    vertex: np.ndarray
    """(n,) vertex of the mesh that each is centred on."""
    radius: np.ndarray
    """(n,) in units of the mesh."""
    brightening: np.ndarray
    """(n,) change of log albedo."""
    planes: np.ndarray
    """(n, 1 + faces, 3): height at the centre [radii] and slopes along both tangent axes; the least counts."""


def crater_population(
    rng: np.random.Generator,
    weight: np.ndarray,
    *,
    density: float,
    smallest: float,
    largest: float,
    freshest: float,
    brightening: float,
) -> Craters:
    """Craters of diameters `smallest` to `largest`, N(> D) = density SATURATION D^-2 per area.

    weight: (V,) area around each vertex, times the local share of craters. Ages are as in `terrain.crater_population`.
    """
    per_area = density * SATURATION * (smallest**-2.0 - largest**-2.0)
    count = rng.poisson(per_area * weight.sum())
    age = freshest + (1.0 - freshest) * rng.random(count)
    sign = np.where(rng.random(count) < _DARK_SHARE, -1.0, 1.0)
    return Craters(
        vertex=_places(rng, weight, count),
        radius=0.5 * power_law_sizes(rng, smallest, largest, 2.0, count),
        profile=1 + (age * (len(profiles()) - 1 - 1e-9)).astype(np.int64),
        brightening=brightening * sign * np.maximum(1.0 - age / FADED, 0.0),
        outline=_OUTLINE * rng.standard_normal((count, 4)),
    )


def boulder_population(
    rng: np.random.Generator,
    weight: np.ndarray,
    *,
    cover: float,
    smallest: float,
    largest: float,
    slope: float = 2.7,
    contrast: float = 0.12,
) -> Boulders:
    """Boulders of diameters `smallest` to `largest` with cumulative slope -`slope` that cover a share of the ground.

    weight: (V,) area around each vertex, times the local share of boulders; contrast: standard deviation of log albedo.
    """
    power = 2.0 - slope
    mean_square = slope / power * (largest**power - smallest**power) / (smallest**-slope - largest**-slope)
    count = rng.poisson(cover * weight.sum() / (0.25 * math.pi * mean_square))
    azimuth = (np.arange(_FACES) + rng.uniform(-0.35, 0.35, (count, _FACES))) * (2.0 * math.pi / _FACES)
    steep = rng.uniform(1.0, 2.6, (count, _FACES))
    away = rng.uniform(0.7, 1.05, (count, _FACES))
    sides = np.stack([steep * away, -steep * np.cos(azimuth), -steep * np.sin(azimuth)], -1)
    top = np.column_stack([rng.uniform(0.3, 0.8, count), rng.normal(0.0, 0.22, (count, 2))])
    return Boulders(
        vertex=_places(rng, weight, count),
        radius=0.5 * power_law_sizes(rng, smallest, largest, slope, count),
        brightening=contrast * rng.standard_normal(count),
        planes=np.concatenate([top[:, None], sides], 1),
    )


def _places(rng: np.random.Generator, weight: np.ndarray, count: int) -> np.ndarray:
    """(count,) vertices, each as likely as its weight (V,)."""
    total = np.cumsum(weight)
    return np.minimum(np.searchsorted(total, rng.random(count) * total[-1]), len(weight) - 1)


def add_craters(
    height: np.ndarray,
    log_albedo: np.ndarray,
    vertices: np.ndarray,
    normals: np.ndarray,
    grid: VertexGrid,
    craters: Craters,
    depth: float,
) -> None:
    """Adds the relief of craters to `height` (V,) and their brightening to `log_albedo` (V,), in place.

    depth: factor of the profiles' heights.
    """
    chosen = normals[craters.vertex]
    _craters(
        height,
        log_albedo,
        vertices,
        normals,
        *(grid.origin, grid.cell, grid.shape, grid.start, grid.order),
        profiles(),
        vertices[craters.vertex],
        np.concatenate([tangent_basis(chosen), chosen[..., None]], -1),
        *(craters.radius, craters.profile, craters.brightening, craters.outline),
        depth,
    )


def add_boulders(
    height: np.ndarray,
    log_albedo: np.ndarray,
    vertices: np.ndarray,
    normals: np.ndarray,
    grid: VertexGrid,
    boulders: Boulders,
) -> None:
    """Adds boulders to `height` (V,), where several overlap the highest, and to `log_albedo` (V,), in place."""
    top, tone = np.zeros(len(height)), np.zeros(len(height))
    chosen = unit(normals[boulders.vertex])
    _boulders(
        top,
        tone,
        vertices,
        normals,
        *(grid.origin, grid.cell, grid.shape, grid.start, grid.order),
        vertices[boulders.vertex],
        np.concatenate([tangent_basis(chosen), chosen[..., None]], -1),
        *(boulders.radius, boulders.brightening, boulders.planes),
    )
    height += top
    log_albedo += tone


@njit(cache=True, inline="always")
def _facing(normal, axes):
    """0 to 1: how far the ground belongs to a landform with the axis axes[:, 2]."""
    t = (normal[0] * axes[0, 2] + normal[1] * axes[1, 2] + normal[2] * axes[2, 2]) / _FACING
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@njit(cache=True, inline="always")
def _cell_range(center, reach, origin, cell, shape, low, high):
    """Writes the first (3,) and last (3,) cells that a ball touches."""
    for d in range(3):
        low[d] = max(int((center[d] - reach - origin[d]) / cell), 0)
        high[d] = min(int((center[d] + reach - origin[d]) / cell), shape[d] - 1)


@njit(cache=True)
def _craters(
    height,
    log_albedo,
    vertices,
    normals,
    origin,
    cell,
    shape,
    start,
    order,
    table,
    center,
    axes,
    radius,
    profile,
    brightening,
    outline,
    depth,
):
    """`add_craters` into height (V,) and log_albedo (V,): each crater visits the vertices in the cells that it reaches.

    origin: (3,); cell: side of a cell; shape: (3,) cells; start, order: vertices by cell. table: (P, S) profiles of
    height over radius, to PROFILE_REACH radii. center: (n, 3); axes: (n, 3, 3), columns two tangents and the normal;
    radius, profile (a row of the table), brightening: (n,); outline: (n, 4) amplitudes of cos and sin of twice and
    three times the azimuth.
    """
    per_radius = (table.shape[1] - 1) / PROFILE_REACH
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for n in range(len(radius)):
        size, a, o = radius[n], axes[n], outline[n]
        _cell_range(center[n], _OUTLINE_REACH * PROFILE_REACH * size, origin, cell, shape, low, high)
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                first = (i * shape[1] + j) * shape[2]
                for m in range(start[first + low[2]], start[first + high[2] + 1]):
                    v = order[m]
                    d0, d1, d2 = (
                        (vertices[v, 0] - center[n, 0]) / size,
                        (vertices[v, 1] - center[n, 1]) / size,
                        (vertices[v, 2] - center[n, 2]) / size,
                    )
                    r = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
                    if r > _OUTLINE_REACH * PROFILE_REACH:
                        continue
                    share = _facing(normals[v], a)
                    if share == 0.0:
                        continue
                    angle = math.atan2(
                        d0 * a[0, 1] + d1 * a[1, 1] + d2 * a[2, 1], d0 * a[0, 0] + d1 * a[1, 0] + d2 * a[2, 0]
                    )
                    bent = o[0] * math.cos(2.0 * angle) + o[1] * math.sin(2.0 * angle)
                    bent += o[2] * math.cos(3.0 * angle) + o[3] * math.sin(3.0 * angle)
                    at = r * (1.0 + bent) * per_radius
                    k = int(at)
                    if k >= table.shape[1] - 1:
                        continue
                    f = at - k
                    z = (1.0 - f) * table[profile[n], k] + f * table[profile[n], k + 1]
                    height[v] += share * depth * size * z
                    if brightening[n] != 0.0:
                        log_albedo[v] += share * brightening[n] * math.exp(-r * r / BRIGHT_REACH2)


@njit(cache=True)
def _boulders(
    top, tone, vertices, normals, origin, cell, shape, start, order, center, axes, radius, brightening, planes
):
    """The highest boulder at each vertex: its height into top (V,) and its brightening into tone (V,), both 0 before.

    Arguments as of `_craters`; planes: (n, P, 3) heights of a boulder's faces above its centre, and their slopes along
    its two tangents [radii]. A boulder is as high as the lowest of its planes.
    """
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for n in range(len(radius)):
        size, a = radius[n], axes[n]
        _cell_range(center[n], _BOULDER_REACH * size, origin, cell, shape, low, high)
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                first = (i * shape[1] + j) * shape[2]
                for m in range(start[first + low[2]], start[first + high[2] + 1]):
                    v = order[m]
                    d0, d1, d2 = (
                        (vertices[v, 0] - center[n, 0]) / size,
                        (vertices[v, 1] - center[n, 1]) / size,
                        (vertices[v, 2] - center[n, 2]) / size,
                    )
                    if d0 * d0 + d1 * d1 + d2 * d2 > _BOULDER_REACH * _BOULDER_REACH:
                        continue
                    x = d0 * a[0, 0] + d1 * a[1, 0] + d2 * a[2, 0]
                    y = d0 * a[0, 1] + d1 * a[1, 1] + d2 * a[2, 1]
                    z = math.inf
                    for k in range(planes.shape[1]):
                        z = min(z, planes[n, k, 0] + planes[n, k, 1] * x + planes[n, k, 2] * y)
                    z *= size * _facing(normals[v], a)
                    if z > top[v]:
                        top[v], tone[v] = z, brightening[n]
