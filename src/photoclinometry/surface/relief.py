"""The shape of a map by itself: its mean plane, heights above it, and the shadows that it casts.

The local frame has its origin in the middle of the map: x to the right and y up in the reference image, both
along the mean plane, z out of the ground. Azimuths count clockwise from y ("up in the reference image"),
elevations from the plane, so that they mean something before a map is georeferenced.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.scene import Scene, Surroundings

_NOTHING_AROUND = Surroundings(depth=np.full((1, 1), np.nan), stride=1)


def mean_plane(position: np.ndarray, iterations: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """A point (3,) and the unit normal (3,), of either sign, of the plane through points (n, 3).

    Least squares re-weighted by 1 / (1 + (d / s)^2), s the median distance: spikes do not tilt it.
    """
    weight = np.ones(len(position))
    for _ in range(iterations):
        center = weight @ position / weight.sum()
        offset = position - center
        normal = np.linalg.eigh((offset * weight[:, None]).T @ offset)[1][:, 0]
        distance = np.abs(offset @ normal)
        weight = 1.0 / (1.0 + (distance / max(np.median(distance), 1e-300)) ** 2)
    return center, normal


def local_frame(scene: Scene) -> Rigid:
    """body_from_local of the map (see the module)."""
    center, up = mean_plane(scene.landmarks.position)
    reference = scene.views.body_from_cam[scene.reference]
    if up @ (reference.translation - center) < 0:
        up = -up
    image_up = -reference.rotation[:, 1]
    north = unit(image_up - (image_up @ up) * up)
    return Rigid(np.stack([np.cross(north, up), north, up], -1), center)


def height_map(scene: Scene) -> np.ndarray:
    """Heights (h, w) of the landmarks above their mean plane, in units of B; NaN where there is none."""
    return scene.grid(local_frame(scene).inverse()(scene.landmarks.position)[:, 2])


def sun_from_angles(body_from_local: Rigid, azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector (3,) in B from azimuth, clockwise from the local y, and elevation above the plane [rad]."""
    flat = np.cos(elevation)
    local = np.array([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)])
    return body_from_local.rotation @ local


def angles_from_sun(body_from_local: Rigid, sun: np.ndarray) -> tuple[float, float]:
    """Azimuth and elevation [rad] of a direction (3,) of B: the inverse of `sun_from_angles`."""
    x, y, z = sun @ body_from_local.rotation
    return float(np.arctan2(x, y) % (2 * np.pi)), float(np.arctan2(z, np.hypot(x, y)))


def lambert_shade(normal: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Hillshade (...,) in [0, 1]: the cosine of incidence of normals (..., 3) under a Sun (3,)."""
    return np.clip(normal @ sun, 0.0, 1.0)


@njit(cache=True, inline="always")
def _depth_at(depth, row, col):
    """Depth (h, w) at a row and a column within the grid, linear in between; NaN beside what is missing."""
    r, c = int(row), int(col)
    u, v = row - r, col - c
    return (1.0 - u) * ((1.0 - v) * depth[r, c] + v * depth[r, c + 1]) + u * (
        (1.0 - v) * depth[r + 1, c] + v * depth[r + 1, c + 1]
    )


@njit(cache=True, parallel=True)
def _march(
    point, towards, fx, fy, cx, cy, row0, col0, stride, depth, around, around_stride, nearest, farthest, step, free
):
    height, width = depth.shape
    bottom, right = around_stride * (around.shape[0] - 1), around_stride * (around.shape[1] - 1)
    for j in prange(point.shape[0]):
        travelled = 1.5 * step
        while True:
            x = point[j, 0] + travelled * towards[j, 0]
            y = point[j, 1] + travelled * towards[j, 1]
            z = point[j, 2] + travelled * towards[j, 2]
            travelled += step
            if z < nearest or z > farthest:
                break
            col, row = fx * x / z + cx - 0.5, fy * y / z + cy - 0.5
            map_row, map_col = (row - row0) / stride, (col - col0) / stride
            if 0.0 <= map_row < height - 1 and 0.0 <= map_col < width - 1:
                ground = _depth_at(depth, map_row, map_col)
            elif 0.0 <= row < bottom and 0.0 <= col < right:
                ground = _depth_at(around, row / around_stride, col / around_stride)
            else:
                break
            if z > ground:  # behind what the reference camera sees; False where nothing is known (NaN)
                free[j] = False
                break


def unobstructed(scene: Scene, towards: np.ndarray, surroundings: Surroundings | None = None) -> np.ndarray:
    """(J,) bool: no other part of the map stands in the way from the landmarks towards (3,) or (J, 3), in B.

    A ray from each landmark is followed over the reference camera's depth map, in steps as wide as landmarks are
    apart, until it leaves the region or all relief. Ground outside the map, or hidden from the reference camera,
    obstructs nothing; with `surroundings`, these do, but not in holes of the map.
    towards: of any length.
    """
    cam_from_body = scene.views.body_from_cam[scene.reference].inverse()
    point = cam_from_body(scene.landmarks.position)
    direction = unit(np.asarray(towards, float)) @ cam_from_body.rotation.T
    camera = scene.views.cameras[scene.reference]
    around = surroundings or _NOTHING_AROUND
    depths = np.concatenate([point[:, 2], around.depth.ravel()])
    free = np.ones(len(point), bool)
    _march(
        point,
        np.ascontiguousarray(np.broadcast_to(direction, point.shape)),
        *camera.focal_px,
        *camera.principal_px,
        scene.region.row,
        scene.region.col,
        scene.region.stride,
        scene.grid(point[:, 2]),
        around.depth,
        around.stride,
        np.nanmin(depths),
        np.nanmax(depths),
        scene.spacing,
        free,
    )
    return free


def in_sunlight(scene: Scene, sun: np.ndarray, surroundings: Surroundings | None = None) -> np.ndarray:
    """(J,) bool: no other part of the map, and no `surroundings`, shade the landmark from the Sun (3,), in B.

    As `unobstructed`. Attached shadow (incidence above 90 degrees) is the reflectance model's affair.
    """
    return unobstructed(scene, sun, surroundings)
