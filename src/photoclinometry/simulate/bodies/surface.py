"""The surface of a whole body, and the rays that meet it.

Embree finds the first triangle of a ray (Wald et al. 2014, doi:10.1145/2601097.2601199), in single precision. Light
falls on the normals at the vertices, interpolated within the triangle; where such a normal faces away from the camera,
as at the limb, the triangle's own is taken. What a camera sees and what the Sun lights is decided by the triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.simulate.bodies.mesh import area_vectors, signed_volume
from photoclinometry.simulate.raycast import Hits

_SHADOW_OFFSET = 5e-3
"""Rays away from the surface start this far above it, along the triangle's normal [spacings]."""
_OUTSIDE = 1.01
"""Rays start where they enter a sphere of this many greatest radii, since single precision wants short ways."""


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
        return unit(area_vectors(self.vertices, self.faces))


class BodyRaycaster:
    """A body's surface in Embree; its methods may be called from several threads. Raises InputError without embreex."""

    def __init__(self, surface: BodySurface):
        self.surface = surface
        self._scene = _embree_scene(surface)
        self._radius = _OUTSIDE * float(np.linalg.norm(surface.vertices, axis=1).max())

    def first_hit(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The triangle (n,) int that rays from (n, 3) along unit vectors (n, 3) meet first, -1 for none, and the
        weights (n, 3) of its corners there."""
        ahead = -np.sum(origins * directions, -1)
        # From outside, a ray enters the sphere at the earliest this far on.
        skip = np.maximum(ahead - self._radius, 0.0)
        start = (origins + skip[:, None] * directions).astype(np.float32)
        found = self._scene.run(start, directions.astype(np.float32), output=True)
        u, v = found["u"].astype(float), found["v"].astype(float)
        return found["primID"], np.stack([1.0 - u - v, u, v], -1)

    def blocked(self, triangles: np.ndarray, points: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(n,) bool: something stands between points (n, 3) on triangles (n,) and where unit vectors (n, 3) point."""
        corner = self.surface.vertices[self.surface.faces[triangles]]
        above = unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
        start = (points + _SHADOW_OFFSET * self.surface.spacing * above).astype(np.float32)
        return self._scene.run(start, np.ascontiguousarray(directions, np.float32), query="OCCLUDED") >= 0

    def trace(self, origin: np.ndarray, directions: np.ndarray, sun: np.ndarray) -> Hits:
        """First hits of rays origin + t directions, t > 0, and whether the Sun lights them.

        origin: (3,), outside; directions: (n, 3), any length; sun: (3,) unit vector towards the Sun; all in B.
        """
        n, surface = len(directions), self.surface
        length = np.linalg.norm(directions, axis=-1)
        ray = directions / length[:, None]
        triangle, weight = self.first_hit(np.broadcast_to(origin, ray.shape), ray)
        hit = triangle >= 0
        hits = Hits(hit, np.zeros(n), np.zeros((n, 3)), np.zeros(n), np.zeros(n, bool))
        triangle, weight, ray = triangle[hit], weight[hit], ray[hit]
        corner = surface.faces[triangle]
        distance = np.sum((_mixed(surface.vertices, corner, weight) - origin) * ray, -1)
        normal = self._shading_normals(triangle, weight, ray)
        hits.distance[hit] = distance / length[hit]
        hits.normal[hit] = normal
        hits.albedo[hit] = _mixed(surface.albedo[:, None], corner, weight)[:, 0]
        lit = normal @ sun > 0
        points = origin + distance[lit, None] * ray[lit]
        lit[lit] = ~self.blocked(triangle[lit], points, np.broadcast_to(sun, points.shape))
        hits.lit[hit] = lit
        return hits

    def _shading_normals(self, triangle: np.ndarray, weight: np.ndarray, ray: np.ndarray) -> np.ndarray:
        """(n, 3) interpolated unit normals, or the triangles' where these face away from the rays (n, 3)."""
        corner = self.surface.faces[triangle]
        normal = unit(_mixed(self.surface.normals, corner, weight))
        away = np.sum(normal * ray, -1) >= 0
        a, b, c = (self.surface.vertices[corner[away, k]] for k in range(3))
        normal[away] = unit(np.cross(b - a, c - a))
        return normal


def _mixed(values: np.ndarray, corner: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(n, d) values (V, d) at the corners (n, 3) by their weights (n, 3)."""
    return np.einsum("nk,nkd->nd", weight, values[corner])


def _embree_scene(surface: BodySurface) -> Any:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise InputError("whole bodies need the ray tracer Embree: pip install photoclinometry[body]") from error
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, surface.vertices.astype(np.float32), surface.faces.astype(np.int32))
    # The first query builds the tree, which must not happen in several threads.
    scene.run(np.zeros((1, 3), np.float32), np.array([[0.0, 0.0, 1.0]], np.float32))
    return scene
