"""Intersection of rays with the height field: the surface seen by a camera, and its cast shadows.

A ray descends through a pyramid of upper bounds of the height. It passes over a block of cells in one step if it
stays above the block's bound; otherwise the block's quarters are tested; in a single cell the crossing with the
bicubic surface is solved for (Tevs, Ihrke, Seidel 2008, "Maximum Mipmaps for Fast, Accurate, and
Scalable Dynamic Height Field Rendering", doi:10.1145/1342250.1342279). The bounds are those of the cells' Bezier
control points, so that no cell that a ray could touch is skipped. A ray that enters and leaves the
surface within one cell, at grazing incidence, may be missed.

The Sun is a point: shadows have no penumbra. Light from other parts of the surface is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from photoclinometry.simulate.surface import Surface, bilinear, cell_height, height_and_slopes

_NUDGE = 1e-7
"""Distance beyond a cell's edge to which a ray is moved, so that it is inside the next cell [samples]."""
_TOLERANCE = 1e-7
"""Crossings are solved to this height above the surface [samples]."""
_ENTRY_LEVEL = 2
"""Level of the pyramid at which camera rays begin, since they come in steeply and near the ground."""
_SHADOW_OFFSET = 1e-3
"""A ray towards the Sun starts this far above the surface, along the normal [samples]."""
_BOUND_MARGIN = 1e-6
"""Relative increase of a bound, above the rounding of single precision."""
_EDGE_MARGIN = 1e-9
"""A ray that enters at the grid's far edge is moved inside by this [samples]."""
_MAX_STEPS = 60
"""Bound on the steps of the Illinois method in a cell, which converges superlinearly."""


@dataclass(frozen=True)
class Hits:
    """The surface where n rays meet it. All fields but `hit` are defined only where `hit`."""

    hit: np.ndarray
    """(n,) bool."""
    distance: np.ndarray
    """(n,) along the ray, in lengths of the direction vector."""
    normal: np.ndarray
    """(n, 3) outward unit vectors."""
    albedo: np.ndarray
    """(n,)."""
    lit: np.ndarray
    """(n,) bool: the surface faces the Sun and nothing stands between."""


class Raycaster:
    """A surface with the pyramid of its bounds; its methods may be called from several threads."""

    def __init__(self, surface: Surface):
        self.surface = surface
        self._bound, self._levels = bound_pyramid(surface.height)

    def trace(self, origin: np.ndarray, directions: np.ndarray, sun: np.ndarray) -> Hits:
        """First hits of rays origin + t directions, t > 0, and whether the Sun lights them.

        origin: (3,); directions: (n, 3), any length; sun: (3,) unit vector towards the Sun; all in B.
        A ray that comes in beneath the edge of the grid hits nothing.
        """
        n = len(directions)
        hits = Hits(np.empty(n, bool), np.empty(n), np.empty((n, 3)), np.empty(n), np.empty(n, bool))
        surface = self.surface
        _trace(
            surface.height,
            surface.albedo,
            self._bound,
            self._levels,
            np.array([*surface.origin, surface.spacing], float),
            np.asarray(origin, float),
            np.ascontiguousarray(directions, float),
            np.asarray(sun, float),
            hits.hit,
            hits.distance,
            hits.normal,
            hits.albedo,
            hits.lit,
        )
        return hits


def bound_pyramid(height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Upper bounds of the bicubic surface over blocks of 2^l x 2^l cells, one level after the other.

    Returns the bounds (flat float32) and the levels (L, 3) int64: offset, rows, columns; the last is 1 x 1.
    """
    level = np.empty((height.shape[0] - 1, height.shape[1] - 1), np.float32)
    _cell_bounds(height, level)
    parts, table, offset = [], [], 0
    while True:
        parts.append(level.ravel())
        table.append((offset, *level.shape))
        offset += level.size
        if level.size == 1:
            return np.concatenate(parts), np.array(table, np.int64)
        rows, cols = level.shape
        padded = np.pad(level, ((0, rows % 2), (0, cols % 2)), mode="edge")
        level = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2).max((1, 3))


@njit(cache=True, nogil=True)
def _cell_bounds(height, out):
    """The highest of each cell's 16 Bezier control points, rounded up to single precision."""
    rows, cols = height.shape
    inner = np.empty((4, 4))
    for i in range(rows - 1):
        for j in range(cols - 1):
            for k in range(4):
                row = min(max(i - 1 + k, 0), rows - 1)
                a, b = float(height[row, max(j - 1, 0)]), float(height[row, j])
                c, d = float(height[row, j + 1]), float(height[row, min(j + 2, cols - 1)])
                inner[k, 0], inner[k, 1], inner[k, 2], inner[k, 3] = b, b + (c - a) / 6, c - (d - b) / 6, c
            top = -math.inf
            for k in range(4):
                a, b, c, d = inner[0, k], inner[1, k], inner[2, k], inner[3, k]
                top = max(top, b, b + (c - a) / 6, c - (d - b) / 6, c)
            out[i, j] = top + _BOUND_MARGIN * abs(top)


@njit(cache=True, nogil=True)
def _first_hit(height, bound, levels, u0, v0, z0, du, dv, dz, level, tolerance):
    """Time at which the ray (u0 + t du, v0 + t dv, z0 + t dz), above the surface at t = 0, meets it; -1 if never.

    u, v: grid coordinates (column, row); z, t, tolerance: metres. level: first level of the pyramid.
    """
    rows, cols = height.shape
    top = len(levels) - 1
    highest = bound[levels[top, 0]]
    per_u = 1.0 / du if du != 0.0 else math.inf
    per_v = 1.0 / dv if dv != 0.0 else math.inf
    per_z = 1.0 / dz if dz != 0.0 else math.inf
    nudge = _NUDGE * min(abs(per_u), abs(per_v))
    ahead_u, ahead_v = 1 if du > 0.0 else 0, 1 if dv > 0.0 else 0
    t = 0.0
    while True:
        u, v, z = u0 + t * du, v0 + t * dv, z0 + t * dz
        if not (0.0 <= u < cols - 1 and 0.0 <= v < rows - 1) or (dz >= 0.0 and z > highest):
            return -1.0
        i, j = int(v) >> level, int(u) >> level
        ceiling = bound[levels[level, 0] + i * levels[level, 2] + j]
        leave = min(
            (((j + ahead_u) << level) - u0) * per_u if du != 0.0 else math.inf,
            (((i + ahead_v) << level) - v0) * per_v if dv != 0.0 else math.inf,
        )
        if (z if dz >= 0.0 else z0 + leave * dz) > ceiling:  # over the whole block
            t = leave + nudge
            level = min(level + 1, top)
            continue
        if z > ceiling:
            t = max(t, (ceiling - z0) * per_z)
        if level > 0:
            level -= 1
            continue
        if leave == math.inf:  # a vertical ray
            leave = t + abs(z - cell_height(height, i, j, u, v)) + 1.0
        root = _cross_cell(height, i, j, u0, v0, z0, du, dv, dz, t, leave, tolerance)
        if root >= 0.0:
            return root
        t = leave + nudge
        level = 1 if top > 0 else 0


@njit(cache=True, nogil=True)
def _above(height, i, j, u0, v0, z0, du, dv, dz, t):
    return z0 + t * dz - cell_height(height, i, j, u0 + t * du, v0 + t * dv)


@njit(cache=True, nogil=True)
def _cross_cell(height, i, j, u0, v0, z0, du, dv, dz, start, end, tolerance):
    """Time at which the ray goes below the surface in cell [i, j], between start and end; -1 if it does not.

    Regula falsi with the Illinois weighting.
    """
    a, b = start, end
    fb = _above(height, i, j, u0, v0, z0, du, dv, dz, b)
    if fb > 0.0:
        return -1.0
    fa = _above(height, i, j, u0, v0, z0, du, dv, dz, a)
    if fa <= 0.0:
        return a
    side = 0
    t = b
    for _ in range(_MAX_STEPS):
        t = (fb * a - fa * b) / (fb - fa)
        ft = _above(height, i, j, u0, v0, z0, du, dv, dz, t)
        if abs(ft) < tolerance:
            break
        if ft > 0.0:
            a, fa = t, ft
            if side == 1:
                fb *= 0.5
            side = 1
        else:
            b, fb = t, ft
            if side == -1:
                fa *= 0.5
            side = -1
    return t


@njit(cache=True, nogil=True)
def _entry_time(u, v, z, du, dv, dz, rows, cols, highest):
    """Time at which a ray is first within the grid and below its highest point; -1 if never."""
    enter, leave = 0.0, math.inf
    for position, rate, last in ((u, du, cols - 1.0), (v, dv, rows - 1.0)):
        if rate == 0.0:
            if not 0.0 <= position < last:
                return -1.0
        else:
            a, b = -position / rate, (last - position) / rate
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    if z > highest:
        if dz >= 0.0:
            return -1.0
        enter = max(enter, (highest - z) / dz)
    return enter if enter < leave else -1.0


@njit(cache=True, nogil=True)
def _trace(height, albedo, bound, levels, frame, origin, directions, sun, hit, distance, normal, out_albedo, lit):
    """Fills the arrays of `Hits`. frame: x, y of sample [0, 0], and spacing."""
    rows, cols = height.shape
    spacing = frame[2]
    tolerance = _TOLERANCE * spacing
    top = len(levels) - 1
    highest = bound[levels[top, 0]]
    u, v, z = (origin[0] - frame[0]) / spacing, (origin[1] - frame[1]) / spacing, origin[2]
    for n in range(len(directions)):
        hit[n], lit[n] = False, False
        length = math.sqrt(directions[n, 0] ** 2 + directions[n, 1] ** 2 + directions[n, 2] ** 2)
        du, dv = directions[n, 0] / (length * spacing), directions[n, 1] / (length * spacing)
        dz = directions[n, 2] / length
        enter = _entry_time(u, v, z, du, dv, dz, rows, cols, highest)
        if enter < 0.0:
            continue
        us, vs, zs = u + enter * du, v + enter * dv, z + enter * dz
        us, vs = min(max(us, 0.0), cols - 1.0 - _EDGE_MARGIN), min(max(vs, 0.0), rows - 1.0 - _EDGE_MARGIN)
        if zs < cell_height(height, int(vs), int(us), us, vs):
            continue
        t = _first_hit(height, bound, levels, us, vs, zs, du, dv, dz, min(top, _ENTRY_LEVEL), tolerance)
        if t < 0.0:
            continue
        hit[n] = True
        distance[n] = (enter + t) / length
        uh, vh, zh = us + t * du, vs + t * dv, zs + t * dz
        _, z_u, z_v = height_and_slopes(height, uh, vh)
        nx, ny = -z_u / spacing, -z_v / spacing
        scale = 1.0 / math.sqrt(nx * nx + ny * ny + 1.0)
        nx, ny, nz = nx * scale, ny * scale, scale
        normal[n, 0], normal[n, 1], normal[n, 2] = nx, ny, nz
        out_albedo[n] = bilinear(albedo, uh, vh)
        if nx * sun[0] + ny * sun[1] + nz * sun[2] <= 0.0:
            continue
        blocked = _first_hit(
            height,
            bound,
            levels,
            uh + _SHADOW_OFFSET * nx,
            vh + _SHADOW_OFFSET * ny,
            zh + _SHADOW_OFFSET * nz * spacing,
            sun[0] / spacing,
            sun[1] / spacing,
            sun[2],
            0,
            tolerance,
        )
        lit[n] = blocked < 0.0
