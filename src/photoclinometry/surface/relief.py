"""The shape of a map by itself: its mean plane, heights above it, and the shadows that it casts.

The local frame has its origin in the middle of the map: x to the right and y up in the reference image, both
along the mean plane, z out of the ground. Azimuths count clockwise from y ("up in the reference image"),
elevations from the plane; so they are defined before a map is georeferenced.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.robust import REWEIGHTINGS
from photoclinometry.model.scene import Scene, Surroundings
from photoclinometry.model.tiny import TINY

FIRST_STEP = 1.5
"""Rays start this many steps from their landmark: past the grid cells around it, whose own slope would obstruct it."""

_NOTHING_AROUND = Surroundings(depth=np.full((1, 1), np.nan), stride=1)


def mean_plane(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A point (3,) and the unit normal (3,), of either sign, of the plane through points (n, 3).

    Least squares reweighted by 1 / (1 + (d / s)^2), s the median distance, so that spikes do not tilt it.
    """
    weight, center, normal = np.ones(len(position)), position.mean(0), np.zeros(3)
    for _ in range(REWEIGHTINGS):
        center = weight @ position / weight.sum()
        offset = position - center
        normal = np.linalg.eigh((offset * weight[:, None]).T @ offset)[1][:, 0]
        distance = np.abs(offset @ normal)
        weight = 1.0 / (1.0 + (distance / max(np.median(distance), TINY)) ** 2)
    return center, normal


def local_frame(scene: Scene) -> Rigid:
    """body_from_local of the map (the module's docstring defines the local frame)."""
    center, up = mean_plane(scene.landmarks.position)
    reference = scene.views.body_from_cam[scene.reference]
    if up @ (reference.translation - center) < 0:
        up = -up
    image_up = -reference.rotation[:, 1]
    north = unit(image_up - (image_up @ up) * up)
    return Rigid(np.stack([np.cross(north, up), north, up], -1), center)


def reference_depth(scene: Scene) -> np.ndarray:
    """(J,) depths of the landmarks along the reference view's optical axis, in units of B."""
    return scene.views.body_from_cam[scene.reference].inverse()(scene.landmarks.position)[:, 2]


def heights(scene: Scene) -> np.ndarray:
    """(J,) of the landmarks above their mean plane, in units of B."""
    return local_frame(scene).inverse()(scene.landmarks.position)[:, 2]


def on_mean_plane(scene: Scene, pixels: np.ndarray) -> np.ndarray:
    """Where the rays of reference pixels (..., 2) meet the map's mean plane (..., 3), in B."""
    frame, pose = local_frame(scene), scene.views.body_from_cam[scene.reference]
    rays, up = scene.views.cameras[scene.reference].ray_in_cam(pixels) @ pose.rotation.T, frame.rotation[:, 2]
    distance = (frame.translation - pose.translation) @ up / (rays @ up)
    return pose.translation + distance[..., None] * rays


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
    """Depth (h, w) at a row and a column within the grid, bilinear; NaN next to missing cells."""
    r, c = int(row), int(col)
    u, v = row - r, col - c
    return (1.0 - u) * ((1.0 - v) * depth[r, c] + v * depth[r, c + 1]) + u * (
        (1.0 - v) * depth[r + 1, c] + v * depth[r + 1, c + 1]
    )


class _DepthGrid(NamedTuple):
    """Depths at every so many pixels of the reference image."""

    depth: np.ndarray
    """(h, w) along the optical axis; NaN where unknown."""
    row: int
    """Of the reference image, of the first cell."""
    col: int
    stride: int


@njit(cache=True, parallel=True)
def _march(point, towards, intrinsics, ground, around, depths, step):
    """(J,) bool: the rays from points (J, 3) towards (J, 3), in the reference camera's frame, meet no ground.

    intrinsics: fx, fy, cx, cy; ground, around: `_DepthGrid`, the second where the first ends; depths: nearest and
    farthest of both; step: length.
    """
    free = np.ones(point.shape[0], np.bool_)
    fx, fy, cx, cy = intrinsics
    nearest, farthest = depths
    map_depth, map_stride, around_depth, around_stride = ground.depth, ground.stride, around.depth, around.stride
    first_row, first_col = ground.row, ground.col
    height, width = map_depth.shape
    bottom, right = around_stride * (around_depth.shape[0] - 1), around_stride * (around_depth.shape[1] - 1)
    for j in prange(point.shape[0]):
        travelled = FIRST_STEP * step
        while True:
            x = point[j, 0] + travelled * towards[j, 0]
            y = point[j, 1] + travelled * towards[j, 1]
            z = point[j, 2] + travelled * towards[j, 2]
            travelled += step
            if z < nearest or z > farthest:
                break
            # Array position of the pixel: the centre of pixel [row, col] is at (col + 0.5, row + 0.5).
            col, row = fx * x / z + cx - 0.5, fy * y / z + cy - 0.5
            map_row, map_col = (row - first_row) / map_stride, (col - first_col) / map_stride
            if 0.0 <= map_row < height - 1 and 0.0 <= map_col < width - 1:
                surface = _depth_at(map_depth, map_row, map_col)
            elif 0.0 <= row < bottom and 0.0 <= col < right:
                surface = _depth_at(around_depth, row / around_stride, col / around_stride)
            else:
                break
            if z > surface:  # behind the ground; False where the depth is unknown (NaN)
                free[j] = False
                break
    return free


def unobstructed(scene: Scene, towards: np.ndarray, surroundings: Surroundings | None = None) -> np.ndarray:
    """(J,) bool: no other part of the map stands in the way from the landmarks towards (3,) or (J, 3), in B.

    A ray from each landmark is followed over the reference camera's depth map, in steps of the landmarks' spacing,
    until it leaves the region or the range of depths. Ground outside the map, or hidden from the reference camera,
    obstructs nothing. With `surroundings`, these obstruct where the map ends, but not in its holes.
    towards: of any length.
    """
    cam_from_body = scene.views.body_from_cam[scene.reference].inverse()
    point = cam_from_body(scene.landmarks.position)
    direction = unit(np.asarray(towards, float)) @ cam_from_body.rotation.T
    camera, region = scene.views.cameras[scene.reference], scene.region
    around = surroundings or _NOTHING_AROUND
    depths = np.concatenate([point[:, 2], around.depth.ravel()])
    return _march(
        point,
        np.ascontiguousarray(np.broadcast_to(direction, point.shape)),
        camera.intrinsics,
        _DepthGrid(scene.grid(point[:, 2]), region.row, region.col, region.stride),
        _DepthGrid(around.depth, 0, 0, around.stride),
        (np.nanmin(depths), np.nanmax(depths)),
        scene.spacing,
    )


def in_sunlight(scene: Scene, sun: np.ndarray, surroundings: Surroundings | None = None) -> np.ndarray:
    """(J,) bool: neither another part of the map nor the `surroundings` shade the landmark from the Sun (3,), in B.

    By `unobstructed`. In attached shadow (incidence above 90 degrees) the reflectance model is zero by itself.
    """
    return unobstructed(scene, sun, surroundings)
