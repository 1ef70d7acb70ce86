"""Images of the assumed ground in the planned views: cut to the representative map, with optics and noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.scene import Views
from photoclinometry.simulate.camera_model import Detector, expose, pixel_average
from photoclinometry.simulate.observe import RayTracer, radiance
from photoclinometry.simulate.photometry import Photometry

MARGIN_PX = 24
"""Pixels around the map that matching and shadows need: as wide as its windows on the coarsest level of flow."""

RELIEF_SHARE = 0.15
"""Largest move of a point by relief along the line of sight at the edge of images, as a share of half the map's
side."""

EXTENT = 1.2
"""Extent of the ground relative to that shown in the images, so that ground that casts shadows into them exists."""

_SUPERSAMPLING = 2
"""Rays per pixel, along each side, as of simulated sites."""

_SMALLEST_PX = 16
"""Side of the smallest square of the map that a view must show [px]; with less it counts as showing nothing of it."""


def cropped_views(views: Views, half_side: float) -> tuple[Views, np.ndarray]:
    """The views whose images show the square of ground [-half_side, half_side]^2 [m], cut to it; and which (K,) do.

    Only cameras change: their principal points move with the corner of the cut.
    """
    up = RELIEF_SHARE * half_side
    square = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-up / half_side, up / half_side)])
    cameras, shows = [], np.zeros(len(views), bool)
    for k, camera in enumerate(views.cameras):
        pixel = views.project(k, half_side * square)
        first = np.maximum(np.floor(pixel.min(0)).astype(int) - MARGIN_PX, 0)
        last = np.minimum(np.ceil(pixel.max(0)).astype(int) + MARGIN_PX, (camera.width, camera.height))
        shows[k] = bool(np.all(last - first >= _SMALLEST_PX))
        cameras.append(_cut(camera, first, last) if shows[k] else camera)
    return replace(views, cameras=tuple(cameras))[np.flatnonzero(shows)], shows


def _cut(camera: Camera, first: np.ndarray, last: np.ndarray) -> Camera:
    """The camera of the part of its image between two corners (x, y) [px]."""
    (x, y), (width, height) = first.tolist(), (last - first).tolist()
    return Camera("PINHOLE", width, height, (*camera.focal_px, camera.principal_px[0] - x, camera.principal_px[1] - y))


def ground_half_extent(views: Views, half_side: float) -> float:
    """Half the side of the square of ground [m] in the images of `cropped_views`, with their relief."""
    reach = half_side
    for k, camera in enumerate(views.cameras):
        corners = np.array([(x, y) for x in (0.0, camera.width) for y in (0.0, camera.height)])
        pose = views.body_from_cam[k]
        rays = camera.ray_in_cam(corners) @ pose.rotation.T
        if np.any(rays[:, 2] >= 0.0):
            raise InputError(f"{views.name[k]}: sees past the horizon of the place; choose another view or place")
        for height in (-RELIEF_SHARE * half_side, RELIEF_SHARE * half_side):
            at = pose.translation + rays * ((height - pose.translation[2]) / rays[:, 2])[:, None]
            reach = max(reach, float(np.abs(at[:, :2]).max()))
    return EXTENT * reach


def exposed(tracer: RayTracer, views: Views, k: int, photometry: Photometry, detector: Detector, seed: int) -> Image:
    """The image of view k: I/F with the detector's noise. Numbers of one seed and view are the same."""
    fine, _ = radiance(
        tracer,
        views.cameras[k],
        views.body_from_cam[k],
        views.sun[k],
        photometry,
        _SUPERSAMPLING,
        detector.margin_px,
    )
    average = pixel_average(fine, _SUPERSAMPLING, detector.margin_px, detector.psf_sigma_px)
    iof = expose(average, detector, np.random.default_rng([seed, 2, k])).iof
    valid = np.isfinite(iof)
    return Image(views.name[k], np.where(valid, iof, 0.0).astype(np.float32), valid)
