"""The plane of a scene's maps: a map projection of the body, or the mean plane of the scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from photoclinometry.io.rasters.globe import geographic, name_of, need_rasterio
from photoclinometry.io.rasters.projection import local_crs, site_projection
from photoclinometry.model.geometry import tangent_basis
from photoclinometry.output.export.frame import Framed
from photoclinometry.surface.relief import local_frame

if TYPE_CHECKING:
    from photoclinometry.output.export.options import ExportOptions

_STEEPEST_DEG = 70.0
"""Slope to which gradients of heights are limited: normals of steeper ground are too uncertain to interpolate with."""
_STEP_GSD = 0.01
"""Step of the numerical derivative of the projection [ground samples]."""
_UPRIGHT = 1e-9
"""Ratio of a tangent plane's area on the map to the largest, below which the ground is vertical."""


@dataclass(frozen=True, kw_only=True)
class Plane:
    """The plane of a map, and the landmarks on it."""

    crs: Any
    """rasterio's CRS; None if the unit of length is unknown."""
    name: str
    place: np.ndarray
    """(J, 3) x, y and height in the map's unit."""
    gradient: np.ndarray
    """(J, 2) derivatives of the height by x and y, from the normals."""
    up: np.ndarray
    """(J, 3) unit vectors of the vertical, in the frame of the scene."""
    north: np.ndarray
    """(3,) direction whose horizontal part is the map's north: that of the pole, or a local map's y."""


def map_plane(framed: Framed, options: ExportOptions) -> Plane:
    """The map projection of a body-fixed scene, else the mean plane of the scene. Raises InputError."""
    need_rasterio()
    position, step = framed.scene.landmarks.position, _STEP_GSD * framed.scene.gsd
    if framed.globe is not None:
        drawn = site_projection(framed.globe, options.projection or "equirectangular", position, options.center_deg)
        lon, lat, _ = np.radians(geographic(framed.globe, position)).T
        up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
        pole = np.array([0.0, 0.0, 1.0])
        return Plane(
            crs=drawn.crs,
            name=name_of(drawn.crs),
            place=drawn.from_body(position),
            gradient=height_gradient(drawn.from_body, position, framed.scene.landmarks.normal, step),
            up=up,
            north=pole,
        )
    body_from_local = local_frame(framed.scene)
    name = f"{framed.scene.name}: local plane, y is up in the reference image, not north"
    return Plane(
        crs=local_crs(name) if framed.metric else None,
        name=name,
        place=body_from_local.inverse()(position),
        gradient=height_gradient(body_from_local.inverse(), position, framed.scene.landmarks.normal, step),
        up=np.broadcast_to(body_from_local.rotation[:, 2], position.shape),
        north=body_from_local.rotation[:, 1],
    )


def height_gradient(
    place_of: Callable[[np.ndarray], np.ndarray], position: np.ndarray, normal: np.ndarray, step: float
) -> np.ndarray:
    """(J, 2) derivatives of the height by x and y on a map, of ground through points (J, 3) with normals (J, 3).

    place_of: map coordinates and height of points (n, 3); step: a length small compared with the relief. Limited to
    _STEEPEST_DEG; zero where the ground is vertical.
    """
    tangent, here = tangent_basis(normal), place_of(position)
    (x1, y1, z1), (x2, y2, z2) = ((place_of(position + step * tangent[..., i]) - here).T for i in range(2))
    area = x1 * y2 - x2 * y1
    upright = np.abs(area) < _UPRIGHT * np.abs(area).max()
    rise = np.stack([z1 * y2 - z2 * y1, x1 * z2 - x2 * z1], -1)
    gradient = np.where(upright[:, None], 0.0, rise / np.where(upright, 1.0, area)[:, None])
    steepness = np.linalg.norm(gradient, axis=-1, keepdims=True)
    return gradient * np.minimum(1.0, math.tan(math.radians(_STEEPEST_DEG)) / np.maximum(steepness, 1e-300))
