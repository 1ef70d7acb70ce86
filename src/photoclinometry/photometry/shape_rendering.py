"""Pictures of a closed surface as a camera would take them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.reflectance import Reflectance, photometric_angles
from photoclinometry.surface.mesh_rays import MeshRays, through_pixels

RAYS = 2
"""Rays through a pixel, across and down: its brightness is their mean."""


@dataclass(frozen=True, kw_only=True)
class ShadedSurface:
    """A closed surface with all that its brightness depends on."""

    rays: MeshRays
    normals: np.ndarray
    """(V, 3) of its vertices."""
    albedo: np.ndarray
    """(V,)."""
    reflectance: Reflectance


def rendered_shape(surface: ShadedSurface, camera: Camera, body_from_cam: Rigid, sun: np.ndarray) -> np.ndarray:
    """(height, width) brightness by the reflectance model, zero in shadow, NaN where no ray of a pixel meets the body.

    sun: (3,) unit vector towards the Sun in B.
    """
    fine = replace(
        camera,
        width=RAYS * camera.width,
        height=RAYS * camera.height,
        params=tuple(RAYS * value for value in camera.params),
    )
    _, triangle, weight = through_pixels(surface.rays, fine, body_from_cam)
    hit = triangle >= 0
    value = np.zeros(len(triangle))
    value[hit] = _brightness(surface, triangle[hit], weight[hit], body_from_cam.translation, sun)
    of_pixel = (camera.height, RAYS, camera.width, RAYS)
    met = hit.reshape(of_pixel).any((1, 3))
    return np.where(met, value.reshape(of_pixel).mean((1, 3)), np.nan)


def through_optics(rendering: np.ndarray, sigma_px: float) -> np.ndarray:
    """A rendering (height, width) as a Gaussian point-spread function shows it; its sky is dark, and stays NaN."""
    from scipy.ndimage import gaussian_filter

    return np.where(np.isfinite(rendering), gaussian_filter(np.nan_to_num(rendering), sigma_px), np.nan)


def _brightness(
    surface: ShadedSurface, triangle: np.ndarray, weight: np.ndarray, center: np.ndarray, sun: np.ndarray
) -> np.ndarray:
    """(n,) at places in triangles (n,), given by weights (n, 3) of their corners."""
    rays = surface.rays
    point = rays.interpolated(rays.vertices, triangle, weight)
    normal = unit(rays.interpolated(surface.normals, triangle, weight))
    albedo = rays.interpolated(surface.albedo[:, None], triangle, weight)[:, 0]
    value = albedo * surface.reflectance(*photometric_angles(sun, center, point, normal))
    dark = rays.blocked(triangle, point, np.broadcast_to(sun, point.shape))
    return np.where(dark, 0.0, value)
