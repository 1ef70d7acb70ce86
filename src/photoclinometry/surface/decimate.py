"""Coarser closed meshes: edges are collapsed where that moves the surface least, and the mesh stays closed.

Quadric error metrics (Garland & Heckbert 1997, doi:10.1145/258734.258849). An edge is collapsed only where its two ends
have exactly two neighbours in common (the link condition, Dey et al. 1999): then every edge keeps exactly two faces,
and the number of holes through the body does not change. Edges that one pass collapses have no neighbour in common.
"""

from __future__ import annotations

import numpy as np
from numba import njit

import photoclinometry.model.kernel_cache  # noqa: F401
from photoclinometry.model.errors import InputError
from photoclinometry.model.tiny import TINY
from photoclinometry.surface.closed_mesh import area_vectors, half_edges, is_watertight

_CHEAPEST = 0.5
"""Largest share of the edges that one pass collapses, those of least cost: the others wait for the next pass."""
_PULL = 1e-3
"""Weight of an edge's middle in its new point, relative to that of the planes: it holds points on flat ground, which
planes do not hold, without moving others."""
_LARGEST_TURN = 0.3
"""Cosine of the largest angle that a face may turn by in one collapse: folds are beyond 90 degrees."""
_LEAST_SHAPE = 0.1
"""Least quality of a new face, 4 sqrt(3) area / sum of squared edges: 1 for equilateral triangles, 0 for needles."""
_FEWEST_FACES = 4
"""A tetrahedron."""
_MAX_NEIGHBOURS = 64
"""A vertex with more neighbours is left as it is."""


def decimate(vertices: np.ndarray, faces: np.ndarray, target: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed mesh of vertices (V, 3) and faces (F, 3) with about `target` faces: new vertices and faces.

    A mesh that has no more faces is returned as it is. Collapses that would break the mesh or fold it are not made, so
    that very coarse targets may not be reached. Raises InputError for a mesh that is not closed.
    """
    if not is_watertight(faces):
        raise InputError("only closed meshes can be made coarser; this one has open edges")
    # Passes work in units of the body's size about its middle: coordinates far from the origin would cost digits.
    middle = 0.5 * (vertices.min(0) + vertices.max(0))
    size = float(np.abs(vertices - middle).max())
    points, faces = (vertices - middle) / size, np.ascontiguousarray(faces, np.int64)
    quadrics = _vertex_quadrics(points, faces)
    while len(faces) > max(target, _FEWEST_FACES):
        before = len(faces)
        points, faces, quadrics = _one_pass(points, faces, quadrics, (before - target + 1) // 2)
        if len(faces) == before:
            break
    return size * points + middle, faces.astype(np.int32)


def _one_pass(
    points: np.ndarray, faces: np.ndarray, quadrics: np.ndarray, collapses: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The mesh after at most `collapses` independent collapses, without the vertices that they removed."""
    # Two faces pass each edge of a closed mesh in opposite directions, so that one has the smaller vertex first.
    pairs = half_edges(faces).reshape(-1, 2)
    edges = pairs[pairs[:, 0] < pairs[:, 1]]
    cost, place = _edge_costs(points, quadrics, edges)
    count = max(1, int(_CHEAPEST * len(edges)))
    order = np.argpartition(cost, count - 1)[:count]
    order = order[np.argsort(cost[order], kind="stable")]
    start = np.r_[0, np.cumsum(np.bincount(faces.ravel(), minlength=len(points)))]
    around = _faces_around(faces, start)
    points, faces, quadrics = points.copy(), faces.copy(), quadrics.copy()
    alive = _collapse(points, faces, quadrics, edges[order], place[order], around, start, collapses)
    faces = faces[alive]
    used = np.zeros(len(points), bool)
    used[faces] = True
    return points[used], (np.cumsum(used) - 1)[faces], quadrics[used]


def _vertex_quadrics(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V, 4, 4) quadrics: x'Qx of homogeneous x is the sum of areas times squared distances to the faces' planes."""
    normal = area_vectors(points, faces)
    area = np.linalg.norm(normal, axis=1)
    normal = normal / np.maximum(area, TINY)[:, None]
    plane = np.concatenate([normal, -np.sum(normal * points[faces[:, 0]], -1)[:, None]], -1)
    total = np.zeros((len(points), 4, 4))
    _add_quadrics(faces, plane, area, total)
    return total


@njit(cache=True)
def _add_quadrics(faces, plane, area, total):
    for f in range(len(faces)):
        for vertex in faces[f]:
            for i in range(4):
                for j in range(4):
                    total[vertex, i, j] += area[f] * plane[f, i] * plane[f, j]


@njit(cache=True)
def _faces_around(faces, start):
    """(3 F,) the faces around each vertex, those of vertex v from start[v] on."""
    free, around = start.copy(), np.empty(3 * len(faces), np.int64)
    for f in range(len(faces)):
        for vertex in faces[f]:
            around[free[vertex]] = f
            free[vertex] += 1
    return around


@njit(cache=True)
def _edge_costs(points, quadrics, edges):
    """(E,) cost of each edge's collapse, and (E, 3) the position of its vertex then: the lowest point, by Cramer's
    rule, of x'qx plus the pull towards the edge's middle; the middle itself where there is none."""
    cost, place = np.empty(len(edges)), np.empty((len(edges), 3))
    for n in range(len(edges)):
        i, j = edges[n]
        p, q = quadrics[i], quadrics[j]
        u, v = 0.5 * (points[i, 0] + points[j, 0]), 0.5 * (points[i, 1] + points[j, 1])
        w = 0.5 * (points[i, 2] + points[j, 2])
        a, b, c = p[0, 0] + q[0, 0], p[1, 1] + q[1, 1], p[2, 2] + q[2, 2]
        d, e, f = p[0, 1] + q[0, 1], p[0, 2] + q[0, 2], p[1, 2] + q[1, 2]
        k, l, m = p[0, 3] + q[0, 3], p[1, 3] + q[1, 3], p[2, 3] + q[2, 3]
        pull = _PULL * (a + b + c)
        x, y, z = _lowest(a + pull, b + pull, c + pull, d, e, f, pull * u - k, pull * v - l, pull * w - m, u, v, w)
        place[n, 0], place[n, 1], place[n, 2] = x, y, z
        planes = a * x * x + b * y * y + c * z * z + 2.0 * (d * x * y + e * x * z + f * y * z)
        planes += 2.0 * (k * x + l * y + m * z) + p[3, 3] + q[3, 3]
        cost[n] = planes + pull * ((x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2)
    return cost, place


@njit(cache=True)
def _lowest(a, b, c, d, e, f, r, s, t, u, v, w):
    """The solution of [[a, d, e], [d, b, f], [e, f, c]] x = (r, s, t); (u, v, w) of a matrix that is not definite."""
    c00, c01, c02 = b * c - f * f, e * f - d * c, d * f - b * e
    c11, c12, c22 = a * c - e * e, d * e - a * f, a * b - d * d
    determinant = a * c00 + d * c01 + e * c02
    if not determinant > 0.0:
        return u, v, w
    x, y, z = c00 * r + c01 * s + c02 * t, c01 * r + c11 * s + c12 * t, c02 * r + c12 * s + c22 * t
    return x / determinant, y / determinant, z / determinant


@njit(cache=True)
def _collapse(points, faces, quadrics, edges, place, around, start, collapses):
    """Collapses edges in their order, in place; (F,) bool of the faces that remain.

    A vertex whose faces have changed is locked, since `around` then no longer lists its faces.
    """
    alive, locked = np.ones(len(faces), np.bool_), np.zeros(len(points), np.bool_)
    near_a, near_b = np.empty(_MAX_NEIGHBOURS, np.int64), np.empty(_MAX_NEIGHBOURS, np.int64)
    done = 0
    for e in range(len(edges)):
        if done == collapses:
            break
        a, b = edges[e]
        if locked[a] or locked[b]:
            continue
        n_a = _neighbours(a, faces, around, start, near_a)
        n_b = _neighbours(b, faces, around, start, near_b)
        if n_a < 0 or n_b < 0 or locked[near_a[:n_a]].any() or locked[near_b[:n_b]].any():
            continue
        if not _may_collapse(near_a[:n_a], near_b[:n_b], start):
            continue
        if _folds(a, b, place[e], points, faces, around, start) or _folds(b, a, place[e], points, faces, around, start):
            continue
        points[a] = place[e]
        quadrics[a] += quadrics[b]
        for i in range(start[b], start[b + 1]):
            face = faces[around[i]]
            if face[0] == a or face[1] == a or face[2] == a:
                alive[around[i]] = False
            for k in range(3):
                if face[k] == b:
                    face[k] = a
        for i in range(n_a):
            locked[near_a[i]] = True
        for i in range(n_b):
            locked[near_b[i]] = True
        locked[a] = locked[b] = True
        done += 1
    return alive


@njit(cache=True)
def _neighbours(vertex, faces, around, start, out):
    """Writes the vertices that share an edge with one of a closed mesh; their number, -1 if they are too many."""
    count = start[vertex + 1] - start[vertex]
    if count > len(out):
        return -1
    for i in range(count):
        face = faces[around[start[vertex] + i]]
        for k in range(3):
            if face[k] == vertex:
                out[i] = face[(k + 1) % 3]
    return count


@njit(cache=True)
def _may_collapse(near_a, near_b, start):
    """Whether the ends of an edge have exactly two neighbours in common (their neighbours are given), and no vertex is
    left with two faces: a common neighbour loses one, and of those around the ends four go."""
    common = 0
    for v in near_a:
        for w in near_b:
            if v == w:
                common += 1
                if start[v + 1] - start[v] <= 3:
                    return False
    return common == 2 and len(near_a) + len(near_b) >= 7


@njit(cache=True)
def _folds(vertex, other, place, points, faces, around, start):
    """Whether a face around a vertex turns or narrows too much when the vertex moves; faces with `other` vanish."""
    for i in range(start[vertex], start[vertex + 1]):
        face = faces[around[i]]
        if face[0] == other or face[1] == other or face[2] == other:
            continue
        k = 0
        while face[k] != vertex:
            k += 1
        p, q = points[face[(k + 1) % 3]], points[face[(k + 2) % 3]]
        old, new = np.cross(p - points[vertex], q - points[vertex]), np.cross(p - place, q - place)
        length = np.sqrt(np.sum(new * new))
        if np.sum(old * new) < _LARGEST_TURN * np.sqrt(np.sum(old * old)) * length:
            return True
        edges = np.sum((p - place) ** 2) + np.sum((q - place) ** 2) + np.sum((p - q) ** 2)
        if 2.0 * np.sqrt(3.0) * length < _LEAST_SHAPE * edges:
            return True
    return False
