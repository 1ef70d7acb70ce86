"""The surface of a whole body, and the rays that meet it.

Light falls on the normals at the vertices, interpolated within the triangle; where such a normal faces away from the
camera,
as at the limb, the triangle's own is taken. The triangles decide what a camera sees and what the Sun lights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.simulate.raycast import Hits
from photoclinometry.surface.closed_mesh import face_normals, signed_volume
from photoclinometry.surface.mesh_rays import MeshRays


@dataclass(frozen=True)
class BodySurface:
    """A closed triangle mesh in the body-fixed frame [m]. Its numbers are those of single precision, as in its file."""

    vertices: np.ndarray
    """(V, 3) float64."""
    faces: np.ndarray
    """(F, 3) int32, counter-clockwise as seen from outside."""
    normals: np.ndarray
    """(V, 3) outward unit vectors, which the light falls on."""
    albedo: np.ndarray
    """(V,) normal albedo."""
    spacing: float
    """Mean length of the edges [m]."""

    @property
    def mean_radius(self) -> float:
        """Radius of the sphere of the same volume [m]."""
        return float(np.cbrt(0.75 / np.pi * signed_volume(self.vertices, self.faces)))

    @property
    def facet_normals(self) -> np.ndarray:
        """(F, 3) outward unit normals of the triangles."""
        return face_normals(self.vertices, self.faces)


class BodyRaycaster:
    """A body's surface and its rays; may be called from several threads. Raises InputError without embreex."""

    def __init__(self, surface: BodySurface):
        self.surface = surface
        self.rays = MeshRays(surface.vertices, surface.faces, surface.spacing)

    def trace(self, origin: np.ndarray, directions: np.ndarray, sun: np.ndarray) -> Hits:
        """First hits of rays origin + t directions, t > 0, and whether the Sun lights them.

        origin: (3,), outside; directions: (n, 3), any length; sun: (3,) unit vector towards the Sun; all in B.
        """
        n, surface = len(directions), self.surface
        length = np.linalg.norm(directions, axis=-1)
        ray = directions / length[:, None]
        triangle, weight = self.rays.first_hit(np.broadcast_to(origin, ray.shape), ray)
        hit = triangle >= 0
        hits = Hits(hit, np.zeros(n), np.zeros((n, 3)), np.zeros(n), np.zeros(n, bool))
        triangle, weight, ray = triangle[hit], weight[hit], ray[hit]
        mixed = self.rays.interpolated
        distance = np.sum((mixed(surface.vertices, triangle, weight) - origin) * ray, -1)
        normal = self._shading_normals(triangle, weight, ray)
        hits.distance[hit] = distance / length[hit]
        hits.normal[hit] = normal
        hits.albedo[hit] = mixed(surface.albedo[:, None], triangle, weight)[:, 0]
        lit = normal @ sun > 0
        points = origin + distance[lit, None] * ray[lit]
        lit[lit] = ~self.rays.blocked(triangle[lit], points, np.broadcast_to(sun, points.shape))
        hits.lit[hit] = lit
        return hits

    def _shading_normals(self, triangle: np.ndarray, weight: np.ndarray, ray: np.ndarray) -> np.ndarray:
        """(n, 3) interpolated unit normals, or the triangles' where these face away from the rays (n, 3)."""
        corner = self.surface.faces[triangle]
        normal = unit(self.rays.interpolated(self.surface.normals, triangle, weight))
        away = np.sum(normal * ray, -1) >= 0
        a, b, c = (self.surface.vertices[corner[away, k]] for k in range(3))
        normal[away] = unit(np.cross(b - a, c - a))
        return normal
