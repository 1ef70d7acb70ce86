"""Rays that meet a triangle mesh, and the views that see its ground lit.

Embree finds the first triangle of a ray (Wald et al. 2014, doi:10.1145/2601097.2601199), in single precision.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Views
from photoclinometry.surface.closed_mesh import face_normals

_SHADOW_OFFSET = 5e-3
"""Height above the surface at which rays away from it start, along the triangle's normal [spacings]."""
_OUTSIDE = 1.01
"""Rays start where they enter a sphere of this many greatest radii, since single precision requires short distances."""


class MeshRays:
    """A triangle mesh in Embree; its methods may be called from several threads.

    vertices: (V, 3), the origin inside; faces: (F, 3), counter-clockwise as seen from outside; spacing: mean length of
    the edges. Raises InputError without embreex.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, spacing: float):
        self.vertices, self.faces, self.spacing = vertices, faces, spacing
        self.facet_normals = face_normals(vertices, faces)
        self._scene = _embree_scene(vertices, faces)
        self._radius = _OUTSIDE * float(np.linalg.norm(vertices, axis=1).max())

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

    def interpolated(self, values: np.ndarray, triangles: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(n, d) values (V, d) of vertices, at places in triangles (n,) given by weights (n, 3) of their corners."""
        return np.einsum("nk,nkd->nd", weights, values[self.faces[triangles]])

    def blocked(self, triangles: np.ndarray, points: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(n,) bool: the ray from a point (n, 3) on a triangle (n,) along a unit vector (n, 3) is obstructed."""
        start = (points + _SHADOW_OFFSET * self.spacing * self.facet_normals[triangles]).astype(np.float32)
        return self._scene.run(start, np.ascontiguousarray(directions, np.float32), query="OCCLUDED") >= 0


@dataclass(frozen=True)
class SeenByView:
    """Visibility and illumination of points on a mesh in one view."""

    seen: np.ndarray
    """(n,) bool: in the image, nothing in the way, and not facing away."""
    lit: np.ndarray
    """(n,) bool: facing the Sun, nothing in the way."""
    pixel: np.ndarray
    """(n, 2) where they project."""
    emission: np.ndarray
    """(n,) angle between the normal and the camera [rad]."""
    incidence: np.ndarray
    """(n,) angle between the normal and the Sun [rad]."""
    gsd: np.ndarray
    """(n,) a pixel across the line of sight, on the ground [units of B]."""


def sight_of_views(
    rays: MeshRays, views: Views, triangles: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> Iterator[SeenByView]:
    """`SeenByView` of points (n, 3) on triangles (n,) with unit normals (n, 3), in the order of the views."""
    for k in range(len(views)):
        camera, away = views.cameras[k], views.body_from_cam.translation[k] - points
        towards = unit(away)
        cos_emission, cos_incidence = np.sum(normals * towards, -1), normals @ views.sun[k]
        pixel = views.project(k, points)
        ahead = -away @ views.body_from_cam.rotation[k][:, 2] > 0
        inside = ((pixel >= 0) & (pixel <= (camera.width, camera.height))).all(-1)
        seen = ahead & inside & (cos_emission > 0)
        seen[seen] = ~rays.blocked(triangles[seen], points[seen], towards[seen])
        lit = cos_incidence > 0
        sun = np.broadcast_to(views.sun[k], points.shape)
        lit[lit] = ~rays.blocked(triangles[lit], points[lit], sun[lit])
        yield SeenByView(
            seen=seen,
            lit=lit,
            pixel=pixel,
            emission=np.arccos(np.clip(cos_emission, -1.0, 1.0)),
            incidence=np.arccos(np.clip(cos_incidence, -1.0, 1.0)),
            gsd=np.linalg.norm(away, axis=-1) / np.mean(camera.focal_px),
        )


def depth_image(rays: MeshRays, camera: Camera, body_from_cam: Rigid) -> np.ndarray:
    """(height, width) depth of the mesh along the optical axis at each pixel's centre; NaN where a ray misses it."""
    _, triangle, weight = through_pixels(rays, camera, body_from_cam)
    point = rays.interpolated(rays.vertices, triangle, weight)
    depth = (point - body_from_cam.translation) @ body_from_cam.rotation[:, 2]
    return np.where(triangle >= 0, depth, np.nan).reshape(camera.height, camera.width)


def emission_image(rays: MeshRays, camera: Camera, body_from_cam: Rigid) -> np.ndarray:
    """(height, width) angle [rad] between each pixel's line of sight and the triangle there; pi / 2 beside the mesh."""
    direction, triangle, _ = through_pixels(rays, camera, body_from_cam)
    cosine = -np.sum(direction * rays.facet_normals[triangle], -1)
    emission = np.arccos(np.clip(np.where(triangle >= 0, cosine, 0.0), 0.0, 1.0))
    return emission.reshape(camera.height, camera.width)


def through_pixels(rays: MeshRays, camera: Camera, body_from_cam: Rigid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors (n, 3) through the pixels' centres, row by row, and the triangles that they meet, as of
    `first_hit`."""
    pixels = Region.of_image(camera.height, camera.width).pixel_centers().reshape(-1, 2)
    direction = unit(camera.ray_in_cam(pixels) @ body_from_cam.rotation.T)
    return direction, *rays.first_hit(np.broadcast_to(body_from_cam.translation, direction.shape), direction)


def _embree_scene(vertices: np.ndarray, faces: np.ndarray) -> Any:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise InputError("whole bodies need the ray tracer Embree: pip install photoclinometry[body]") from error
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, vertices.astype(np.float32), faces.astype(np.int32))
    # The first query builds the tree, which must not happen in several threads.
    scene.run(np.zeros((1, 3), np.float32), np.array([[0.0, 0.0, 1.0]], np.float32))
    return scene
