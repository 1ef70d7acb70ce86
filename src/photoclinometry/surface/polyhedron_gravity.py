"""Gravity of a homogeneous polyhedron as a closed sum over its edges and faces.

    U = G rho / 2 (sum_e r_e' E_e r_e L_e - sum_f r_f' F_f r_f w_f)
    g = -G rho (sum_e E_e r_e L_e - sum_f F_f r_f w_f)
    laplacian U = -G rho sum_f w_f
    L_e = ln((a + b + e) / (a + b - e)), and w_f is the solid angle of face f

Werner & Scheeres (1997), Celest. Mech. Dyn. Astron. 65, 313, doi:10.1007/BF00053511. r_e and r_f point from the field
point to the edge and the face, a and b are the distances to the edge's ends, e is its length. U is positive (the work
per mass that gravity has done from infinity); geophysics' potential energy is -U. The mesh must be closed; units are m.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

import photoclinometry.model.kernel_cache  # noqa: F401
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.surface.closed_mesh import face_normals, half_edges, is_watertight, unique_edges

GRAVITATIONAL_CONSTANT = 6.67430e-11
"""CODATA 2018 [m^3 kg^-1 s^-2]."""
_ON_EDGE = 1e-14
"""Least (a + b - e) / (a + b + e). On the edge itself L is infinite, and E r is zero: the limit of their product is."""


class Polyhedron:
    """A closed mesh of vertices (V, 3) [m] and faces (F, 3) that look outwards, of one density [kg/m^3].

    Raises InputError for a mesh that is not closed.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, density: float):
        if not is_watertight(faces):
            raise InputError("gravity is that of a closed mesh; this one has open edges")
        self.vertices = np.ascontiguousarray(vertices, float)
        self.faces = np.ascontiguousarray(faces, np.int64)
        self.density = density
        self._normals = face_normals(self.vertices, self.faces)
        self._edges, self._dyads = _edge_dyads(self.vertices, self.faces, self._normals)

    def field(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At points (n, 3) [m], inside, outside or on the surface: the potential U (n,) [m^2/s^2], the attraction
        (n, 3) [m/s^2], and the Laplacian of U (n,) [1/s^2]: -4 pi G rho inside, 0 outside, half on a face.

        Takes 40 ns for each point and face on one core.
        """
        points = np.ascontiguousarray(points, float)
        out = np.empty((len(points), 5))
        _sum(points, self.vertices, self.faces, self._normals, self._edges, self._dyads, out)
        scale = GRAVITATIONAL_CONSTANT * self.density
        return 0.5 * scale * out[:, 0], -scale * out[:, 1:4], -scale * out[:, 4]


def _edge_dyads(vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (E, 2), and E_e (E, 3, 3): the sum over the edge's two faces of normal times outward edge normal."""
    edges, index = unique_edges(faces)
    halves = half_edges(faces)
    along = unit(vertices[halves[..., 1]] - vertices[halves[..., 0]])
    outward = np.cross(along, normals[:, None, :])
    dyads = np.zeros((len(edges), 3, 3))
    for k in range(3):
        np.add.at(dyads, index[:, k], normals[:, :, None] * outward[:, k, None, :])
    return edges.astype(np.int64), dyads


@njit(cache=True, parallel=True)
def _sum(points, vertices, faces, normals, edges, dyads, out):
    """Writes the sums of potential, attraction (negative) and solid angles, without G rho."""
    for n in prange(len(points)):
        p, total = points[n], np.zeros(5)
        for e in range(len(edges)):
            _add_edge(p, vertices[edges[e, 0]], vertices[edges[e, 1]], dyads[e], total)
        for f in range(len(faces)):
            _add_face(p, vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]], normals[f], total)
        out[n] = total


@njit(cache=True)
def _add_edge(p, a, b, dyad, total):
    x, y, z = a[0] - p[0], a[1] - p[1], a[2] - p[2]
    u, v, w = b[0] - p[0], b[1] - p[1], b[2] - p[2]
    ends = math.sqrt(x * x + y * y + z * z) + math.sqrt(u * u + v * v + w * w)
    length = math.sqrt((u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2)
    log = -math.log(max((ends - length) / (ends + length), _ON_EDGE))
    ex = dyad[0, 0] * x + dyad[0, 1] * y + dyad[0, 2] * z
    ey = dyad[1, 0] * x + dyad[1, 1] * y + dyad[1, 2] * z
    ez = dyad[2, 0] * x + dyad[2, 1] * y + dyad[2, 2] * z
    total[0] += log * (x * ex + y * ey + z * ez)
    total[1] += log * ex
    total[2] += log * ey
    total[3] += log * ez


@njit(cache=True)
def _add_face(p, a, b, c, normal, total):
    x, y, z = a[0] - p[0], a[1] - p[1], a[2] - p[2]
    u, v, w = b[0] - p[0], b[1] - p[1], b[2] - p[2]
    k, l, m = c[0] - p[0], c[1] - p[1], c[2] - p[2]
    ra, rb, rc = (
        math.sqrt(x * x + y * y + z * z),
        math.sqrt(u * u + v * v + w * w),
        math.sqrt(k * k + l * l + m * m),
    )
    volume = x * (v * m - w * l) + y * (w * k - u * m) + z * (u * l - v * k)
    below = ra * rb * rc + ra * (u * k + v * l + w * m) + rb * (k * x + l * y + m * z) + rc * (x * u + y * v + z * w)
    solid = 2.0 * math.atan2(volume, below)
    height = normal[0] * x + normal[1] * y + normal[2] * z
    total[0] -= height * height * solid
    total[1] -= height * solid * normal[0]
    total[2] -= height * solid * normal[1]
    total[3] -= height * solid * normal[2]
    total[4] += solid
