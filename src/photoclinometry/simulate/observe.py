"""A camera's view of a surface: radiance, and position, normal and albedo behind each sample of the image."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.region import Region
from photoclinometry.simulate.photometry import Photometry, radiance_factor
from photoclinometry.simulate.raycast import Hits

_SAMPLES_PER_STRIP = 2**17
"""Rays that one thread follows at a time: some 30 MB."""


class RayTracer(Protocol):
    """A surface that rays can meet: a height field (`raycast.py`) or a whole body (`bodies/surface.py`)."""

    def trace(self, origin: np.ndarray, directions: np.ndarray, sun: np.ndarray) -> Hits:
        """First hits of rays origin (3,) + t directions (n, 3), and whether the Sun (3,) lights them; all in B."""
        ...


@dataclass(frozen=True)
class Samples:
    """The surface where rays through a regular grid of image points meet it."""

    position: np.ndarray
    """(h, w, 3) in B; defined where `hit`."""
    normal: np.ndarray
    """(h, w, 3)."""
    albedo: np.ndarray
    """(h, w)."""
    lit: np.ndarray
    """(h, w) bool."""
    hit: np.ndarray
    """(h, w) bool."""


def sample_points(region: Region, supersampling: int, margin_px: int) -> np.ndarray:
    """((height + 2 margin) s, (width + 2 margin) s, 2) pixel coordinates of s x s samples per pixel."""
    s = supersampling
    x = region.col - margin_px + (np.arange((region.width + 2 * margin_px) * s) + 0.5) / s
    y = region.row - margin_px + (np.arange((region.height + 2 * margin_px) * s) + 0.5) / s
    return np.stack(np.meshgrid(x, y), -1)


def cast(raycaster: RayTracer, camera: Camera, body_from_cam: Rigid, sun: np.ndarray, pixels: np.ndarray) -> Samples:
    """The surface behind the pixels (h, w, 2) of one view; sun: (3,) in B."""
    rays, hits = _trace(raycaster, camera, body_from_cam, sun, pixels.reshape(-1, 2))
    shape = pixels.shape[:-1]
    position = np.zeros_like(rays)
    position[hits.hit] = body_from_cam.translation + hits.distance[hits.hit, None] * rays[hits.hit]
    return Samples(
        position.reshape(*shape, 3),
        np.where(hits.hit[:, None], hits.normal, 0.0).reshape(*shape, 3),
        np.where(hits.hit, hits.albedo, 0.0).reshape(shape),
        hits.lit.reshape(shape),
        hits.hit.reshape(shape),
    )


def radiance(
    raycaster: RayTracer,
    camera: Camera,
    body_from_cam: Rigid,
    sun: np.ndarray,
    photometry: Photometry,
    supersampling: int,
    margin_px: int,
) -> tuple[np.ndarray, bool]:
    """I/F ((height + 2 margin) s, (width + 2 margin) s) float32 over one view's frame and a margin.

    Zero in shadow and off the surface. The second result is True if every ray hit the surface. Raises InputError if
    the model is negative somewhere, as fitted phase functions are beyond the phase angles of their data.
    """
    frame = Region.of_image(camera.height, camera.width)
    pixels = sample_points(frame, supersampling, margin_px)
    out = np.zeros(pixels.shape[:2], np.float32)
    step = max(_SAMPLES_PER_STRIP // pixels.shape[1], 1)

    def strip(first: int) -> bool:
        rows = slice(first, first + step)
        rays, hits = _trace(raycaster, camera, body_from_cam, sun, pixels[rows].reshape(-1, 2))
        lit = hits.lit
        position = body_from_cam.translation + hits.distance[lit, None] * rays[lit]
        angles = photometric_angles(sun, body_from_cam.translation, position, hits.normal[lit])
        values = np.zeros(len(lit), np.float32)
        values[lit] = radiance_factor(photometry, hits.albedo[lit], *angles)
        out[rows] = values.reshape(out[rows].shape)
        return bool(hits.hit.all())

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        complete = all(list(pool.map(strip, range(0, len(out), step))))
    if out.min() < 0:
        raise InputError(
            "the reflectance model is negative at these phase angles, for which its coefficients are not valid; choose "
            "--reflectance hapke, or a smaller --max-emission-deg"
        )
    return out, complete


def _trace(
    raycaster: RayTracer, camera: Camera, body_from_cam: Rigid, sun: np.ndarray, pixels: np.ndarray
) -> tuple[np.ndarray, Hits]:
    """Rays (n, 3) in B, of unit depth in the camera, through pixels (n, 2), and their hits."""
    rays = np.einsum("ij,nj->ni", body_from_cam.rotation, camera.ray_in_cam(pixels))
    return rays, raycaster.trace(body_from_cam.translation, rays, sun)
