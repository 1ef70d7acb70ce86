"""Rays from the origin at a triangle mesh, in double precision: radii by direction, as maps and ICQ models need them.

Directions are sorted into the cells of a cube around the origin. A cell lists the triangles that its rays may meet.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

import photoclinometry.model.kernel_cache  # noqa: F401

_CELLS_PER_EDGE = 0.5
"""Cells along a side of the cube over the number of triangles along it: each cell then lists a dozen triangles."""
_MOST_CELLS = 1024
"""Along a side of the cube."""
_SLACK = 1e-9
"""Share of a triangle by which rays may pass it and still meet it: neighbours then leave no gap between them."""
_CELL_MARGIN = 1e-9
"""A triangle is also listed in cells that it misses by this, against rounding [half sides of the cube]."""
_NEAR_PLANE = 1e-3
"""A triangle with corners this near to a side's plane through the origin [greatest radii] may be seen in all cells."""


class RadialRays:
    """A mesh of vertices (V, 3) and faces (F, 3); rays start at the origin of its frame."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        self.vertices = np.ascontiguousarray(vertices, float)
        self.faces = np.ascontiguousarray(faces, np.int64)
        self._side = int(np.clip(_CELLS_PER_EDGE * math.sqrt(len(faces) / 12.0), 1, _MOST_CELLS))
        near = _NEAR_PLANE * float(np.linalg.norm(self.vertices, axis=1).max())
        count = _listed(self.vertices, self.faces, self._side, near, np.zeros(0, np.int64), np.zeros(0, np.int64))
        self._start = np.r_[0, np.cumsum(count)]
        self._list = np.empty(self._start[-1], np.int64)
        _listed(self.vertices, self.faces, self._side, near, self._start[:-1].copy(), self._list)

    @property
    def listed(self) -> int:
        """Total number of triangles listed by all cells."""
        return len(self._list)

    def outermost(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of unit vectors (n, 3): the radius (n,) of the outermost surface, its face (n,) and the weights (n, 3) of
        that face's corners. A direction in which there is no surface has radius NaN and face -1."""
        directions = np.ascontiguousarray(directions, float)
        radius, face = np.full(len(directions), np.nan), np.full(len(directions), -1, np.int64)
        weight = np.full((len(directions), 3), np.nan)
        _meet(directions, self.vertices, self.faces, self._side, self._start, self._list, radius, face, weight)
        return radius, face, weight


def is_star_shaped(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether each ray from the origin meets a closed mesh once: all faces are seen from inside at the origin."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return bool((np.einsum("ij,ij->i", a, np.cross(b, c)) > 0.0).all())


@njit(cache=True)
def _on_side(x, side):
    """Coordinates u, v, w of a point seen from a side of the cube, 0 to 5: w is outwards."""
    axis, sign = side // 2, 1.0 - 2.0 * (side % 2)
    return x[(axis + 1) % 3], x[(axis + 2) % 3], sign * x[axis]


@njit(cache=True)
def _listed(vertices, faces, cells, near, start, out):
    """(6 cells^2,) number of triangles that each cell lists; with `start` (first free places), also lists them in
    `out`."""
    count = np.zeros(6 * cells * cells, np.int64)
    for f in range(len(faces)):
        for side in range(6):
            low, high = np.full(2, np.inf), np.full(2, -np.inf)
            beside, least = np.full(4, np.inf), np.inf
            for k in range(3):
                u, v, w = _on_side(vertices[faces[f, k]], side)
                least = min(least, w)
                beside[0], beside[1] = min(beside[0], u - w), min(beside[1], -u - w)
                beside[2], beside[3] = min(beside[2], v - w), min(beside[3], -v - w)
                if w > 0.0:
                    low[0], high[0] = min(low[0], u / w), max(high[0], u / w)
                    low[1], high[1] = min(low[1], v / w), max(high[1], v / w)
            # The side's pyramid is |u|, |v| <= w. A triangle whose corners all lie beyond one of its planes is outside.
            if beside.max() > 0.0 or low[0] > high[0]:
                continue
            if least < near:
                low[:], high[:] = -1.0, 1.0
            if low[0] > 1.0 or low[1] > 1.0 or high[0] < -1.0 or high[1] < -1.0:
                continue
            first_u, last_u = _cell(low[0] - _CELL_MARGIN, cells), _cell(high[0] + _CELL_MARGIN, cells)
            first_v, last_v = _cell(low[1] - _CELL_MARGIN, cells), _cell(high[1] + _CELL_MARGIN, cells)
            for i in range(first_u, last_u + 1):
                for j in range(first_v, last_v + 1):
                    cell = (side * cells + i) * cells + j
                    if len(start) > 0:
                        out[start[cell] + count[cell]] = f
                    count[cell] += 1
    return count


@njit(cache=True)
def _cell(x, cells):
    """Index of the cell of a coordinate in [-1, 1]."""
    return min(max(int(0.5 * (x + 1.0) * cells), 0), cells - 1)


@njit(cache=True)
def _meet(directions, vertices, faces, cells, start, triangles, radius, found, weight):
    """Writes the outermost meeting of each ray."""
    for n in range(len(directions)):
        d = directions[n]
        side = 0
        for k in range(1, 3):
            if abs(d[k]) > abs(d[side]):
                side = k
        side = 2 * side + (1 if d[side] < 0.0 else 0)
        u, v, w = _on_side(d, side)
        cell = (side * cells + _cell(u / w, cells)) * cells + _cell(v / w, cells)
        for i in range(start[cell], start[cell + 1]):
            f = triangles[i]
            a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
            # Weights are the volumes that the ray spans with the edges (Moeller & Trumbore 1997, about the origin).
            first, second, third = _volume(d, b, c), _volume(d, c, a), _volume(d, a, b)
            total = first + second + third
            if total == 0.0:
                continue
            first, second, third = first / total, second / total, third / total
            if min(first, second, third) < -_SLACK:
                continue
            length = 0.0
            for k in range(3):
                length += d[k] * (first * a[k] + second * b[k] + third * c[k])
            if length > 0.0 and not length <= radius[n]:
                radius[n], found[n] = length, f
                weight[n, 0], weight[n, 1], weight[n, 2] = first, second, third


@njit(cache=True)
def _volume(a, b, c):
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
