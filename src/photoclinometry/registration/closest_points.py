"""The nearest point of a reference surface: a triangle mesh, or a cloud of points with normals."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from photoclinometry.model.tiny import TINY

NEIGHBOURS = 6
"""Faces around this many nearest vertices are searched for the nearest point. A vertex of an even mesh has six
neighbours."""

PLANE_POINTS = 12
"""Points of a cloud to which the plane of a normal is fitted, where the cloud has no normals."""

RIM_SPACINGS = 3.0
"""A foot farther from the cloud's nearest point than this many of its median spacings lies beside the surface."""


class MeshSurface:
    """Nearest points on a triangle mesh; calling it is an `alignment.Closest`.

    The search looks at all faces around the NEIGHBOURS vertices nearest to a point. For meshes of evenly
    sized triangles that is the nearest face; otherwise the distance is an upper bound.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, closed: bool = False):
        """vertices: (V, 3); faces: (F, 3) int; closed: whether there is no rim, so that none is searched for."""
        from scipy.spatial import KDTree

        self.vertices, self.faces = np.asarray(vertices, float), np.asarray(faces, np.int64)
        self.tree = KDTree(self.vertices)
        corners = self.faces.ravel()
        self._around = np.argsort(corners, kind="stable") // 3
        self._start = np.r_[0, np.cumsum(np.bincount(corners, minlength=len(self.vertices)))]
        self._rim_edge = np.zeros(self.faces.shape, bool)
        self._rim_vertex = np.zeros(len(self.vertices), bool)
        if not closed:
            self._find_rim()

    def _find_rim(self) -> None:
        # An edge that belongs to one face only is part of the rim. Edge i of a face is opposite to corner i.
        edges = np.sort(np.stack([self.faces[:, [1, 2]], self.faces[:, [2, 0]], self.faces[:, [0, 1]]], 1), -1)
        _, inverse, count = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
        self._rim_edge = (count[inverse.ravel()] == 1).reshape(-1, 3)
        self._rim_vertex[edges[self._rim_edge].ravel()] = True

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        foot, inside, _ = self._found(points)
        return foot, inside

    def weights(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The face (n,) nearest to each point (n, 3), and the weights (n, 3) of its corners at the nearest point."""
        foot, _, face = self._found(points)
        a, b, c = (self.vertices[self.faces[face, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        size = np.maximum(np.sum(normal * normal, -1), TINY)
        second = np.sum(np.cross(foot - a, c - a) * normal, -1) / size
        third = np.sum(np.cross(b - a, foot - a) * normal, -1) / size
        return face, np.clip(np.stack([1.0 - second - third, second, third], -1), 0.0, 1.0)

    def _found(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Feet (n, 3), whether these are not on the rim (n,), and their faces (n,), 0 where no face was in reach."""
        count = min(NEIGHBOURS, len(self.vertices))
        near = np.reshape(self.tree.query(points, count)[1], (len(points), count)).astype(np.int64)
        foot, inside, face = np.empty((len(points), 3)), np.empty(len(points), bool), np.zeros(len(points), np.int64)
        _closest(
            np.ascontiguousarray(points, float),
            near,
            self.vertices,
            self.faces,
            self._around,
            self._start,
            self._rim_edge,
            self._rim_vertex,
            foot,
            inside,
            face,
        )
        return foot, inside, face


class CloudSurface:
    """Nearest points on the tangent planes of a point cloud; calling it is an `alignment.Closest`.

    A foot far from the nearest point (RIM_SPACINGS) counts as beside the surface.
    """

    def __init__(self, points: np.ndarray, normals: np.ndarray | None):
        """points: (n, 3); normals: (n, 3), by default of planes through PLANE_POINTS neighbours."""
        from scipy.spatial import KDTree

        self.points = np.asarray(points, float)
        self.tree = KDTree(self.points)
        distance, neighbours = self.tree.query(self.points, min(PLANE_POINTS, len(points)))
        self.spacing = float(np.median(distance[:, 1]))
        if normals is None:
            offset = self.points[neighbours] - self.points[neighbours].mean(1, keepdims=True)
            normals = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))[1][..., 0]
        self.normals = np.asarray(normals, float)

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _, nearest = self.tree.query(points)
        normal, offset = self.normals[nearest], points - self.points[nearest]
        along = np.sum(offset * normal, -1, keepdims=True) * normal
        return points - along, np.linalg.norm(offset - along, axis=-1) < RIM_SPACINGS * self.spacing


@njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _on_triangle(p, a, b, c):
    """Barycentric weights (of a, b, c) of the point of a triangle nearest to p.

    Ericson (2005), Real-Time Collision Detection, section 5.1.5.
    """
    ab, ac, ap = b - a, c - a, p - a
    d1, d2 = _dot(ab, ap), _dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    bp = p - b
    d3, d4 = _dot(ab, bp), _dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return 1.0 - v, v, 0.0
    cp = p - c
    d5, d6 = _dot(ab, cp), _dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        return 1.0 - w, 0.0, w
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 0.0, 1.0 - w, w
    total = va + vb + vc
    return va / total, vb / total, vc / total


@njit(cache=True)
def _closest_one(point, near, vertices, faces, around, start, rim_edge, rim_vertex, foot):
    """Writes the foot (3,) of one point; True if it is not on the rim, and its face."""
    best, inside, found = np.inf, False, 0
    for vertex in near:
        for e in range(start[vertex], start[vertex + 1]):
            face = around[e]
            corner = faces[face]
            a, b, c = vertices[corner[0]], vertices[corner[1]], vertices[corner[2]]
            weight = _on_triangle(point, a, b, c)
            candidate = weight[0] * a + weight[1] * b + weight[2] * c
            offset = point - candidate
            square = _dot(offset, offset)
            if square < best:
                best, inside, found = square, True, face
                foot[:] = candidate
                for k in range(3):
                    if (weight[k] == 1.0 and rim_vertex[corner[k]]) or (weight[k] == 0.0 and rim_edge[face, k]):
                        inside = False
    if best == np.inf:  # a vertex that no face uses
        foot[:] = vertices[near[0]]
    return inside, found


@njit(cache=True, parallel=True)
def _closest(points, near, vertices, faces, around, start, rim_edge, rim_vertex, foot, inside, found):
    for i in prange(len(points)):
        inside[i], found[i] = _closest_one(
            points[i], near[i], vertices, faces, around, start, rim_edge, rim_vertex, foot[i]
        )
