"""Rays over a map: whether its own ground, or the ground around it, hides landmarks from the Sun or from a camera."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.model.scene import Scene, Surroundings
from photoclinometry.model.threads import PARALLEL_LOOPS

FIRST_STEP = 1.5
"""Distance from the landmark at which rays start, in cells of the map as the reference camera sees them: past the cells
around it, whose own slope would obstruct it."""

_NOTHING_AROUND = Surroundings(depth=np.full((1, 1), np.nan), stride=1)


@dataclass(frozen=True, kw_only=True)
class Decided:
    """The nodes of the ground around a map that decide whether rays (n,) meet it."""

    node: np.ndarray
    """(n,) int: index into the flattened depths of the node nearest to the point where the ray is deepest below that
    ground, or lowest above it; -1 for rays that are never over it, or that the map itself obstructs."""
    below: np.ndarray
    """(n,) increase of the node's depth with which the ray would just touch the ground there [units of B]. The ray
    meets the ground where this is positive."""


class MapRays:
    """Rays from all landmarks of a map, over the depth map of its reference camera.

    A ray is followed in steps of the landmarks' spacing until it leaves the region or the range of depths. Ground
    outside the map, or hidden from the reference camera, obstructs nothing. With `surroundings`, these obstruct where
    the map ends, but not in its holes.
    """

    def __init__(self, scene: Scene, surroundings: Surroundings | None = None) -> None:
        around, region = surroundings or _NOTHING_AROUND, scene.region
        self._cam_from_body = scene.views.body_from_cam[scene.reference].inverse()
        self._point = self._cam_from_body(scene.landmarks.position)
        depth = self._point[:, 2]
        self._ground = _DepthGrid(scene.grid(depth), region.row, region.col, region.stride)
        self._around = _DepthGrid(around.depth, 0, 0, around.stride)
        self._depths = (
            min(float(np.nanmin(part, initial=np.inf)) for part in (depth, around.depth)),
            max(float(np.nanmax(part, initial=-np.inf)) for part in (depth, around.depth)),
        )
        self._intrinsics = scene.views.cameras[scene.reference].intrinsics
        self._step = scene.spacing

    def of(self, chosen: np.ndarray) -> MapRays:
        """The rays from some of the landmarks alone, by their indices or a mask; J is their number then."""
        some = copy(self)
        some._point = self._point[chosen]
        return some

    def unoccluded_towards(self, direction: np.ndarray) -> np.ndarray:
        """(J,) bool: no ground stands in the way from the landmarks into a direction (3,) of B, of any length."""
        return self._free((direction @ self._cam_from_body.rotation.T)[None])

    def free_up_to(self, place: np.ndarray) -> np.ndarray:
        """(J,) bool: no ground stands in the way from the landmarks to a place (3,) of B beyond all of it."""
        return self._free(self._cam_from_body(place) - self._point)

    def decided(self, direction: np.ndarray, above: float = 0.0) -> Decided:
        """Obstruction by the ground around the map of rays from the landmarks into a direction (3,) of B.

        above: distance beyond the nearest and the farthest ground up to which rays are followed [units of B].
        """
        count = len(self._point)
        node, below = np.full(count, -1), np.full(count, -np.inf)
        free = self._march((direction @ self._cam_from_body.rotation.T)[None], node, below, above)
        node[~free] = -1
        return Decided(node=node, below=below)

    def _free(self, towards: np.ndarray) -> np.ndarray:
        return self._march(towards, np.empty(0, int), np.empty(0))

    def _march(self, towards: np.ndarray, node: np.ndarray, below: np.ndarray, above: float = 0.0) -> np.ndarray:
        grids, depths = (self._ground, self._around), (self._depths[0] - above, self._depths[1] + above)
        with PARALLEL_LOOPS:
            return _march(self._point, towards, self._intrinsics, *grids, depths, self._step, node, below)


def in_sunlight(scene: Scene, sun: np.ndarray, surroundings: Surroundings | None = None) -> np.ndarray:
    """(J,) bool: neither another part of the map nor the `surroundings` shade the landmark from the Sun (3,), in B.

    In attached shadow (incidence above 90 degrees) the reflectance model is zero by itself.
    """
    return MapRays(scene, surroundings).unoccluded_towards(sun)


class _DepthGrid(NamedTuple):
    """Depths on a regular grid of pixels of the reference image."""

    depth: np.ndarray
    """(h, w) along the optical axis; NaN where unknown."""
    row: int
    """Of the reference image, of the first cell."""
    col: int
    stride: int


@njit(cache=True, inline="always")
def _depth_at(depth, row, col):
    """Depth (h, w) at a row and a column within the grid, bilinear; NaN next to missing cells."""
    r, c = int(row), int(col)
    u, v = row - r, col - c
    return (1.0 - u) * ((1.0 - v) * depth[r, c] + v * depth[r, c + 1]) + u * (
        (1.0 - v) * depth[r + 1, c] + v * depth[r + 1, c + 1]
    )


@njit(cache=True, parallel=True, error_model="numpy")
def _march(point, towards, intrinsics, ground, around, depths, step, node, below):
    """(J,) bool: the rays from points (J, 3), in the reference camera's frame, meet no ground.

    towards: (J, 3), or (1, 3) of all, of any length; intrinsics: fx, fy, cx, cy; ground, around: `_DepthGrid`, the
    second where the first ends; depths: nearest and farthest of both; step: length. node, below: (J,) of `Decided`; the
    obstruction by the ground around is written into them, while rays go on through it; or empty.
    """
    goes_on = node.size > 0
    free = np.ones(point.shape[0], np.bool_)
    nearest, farthest = depths
    map_depth, around_depth = ground.depth, around.depth
    fx, fy, cx, cy = _in_cells(intrinsics, ground)
    around_fx, around_fy, around_cx, around_cy = _in_cells(intrinsics, around)
    height, width = map_depth.shape[0] - 1, map_depth.shape[1] - 1
    around_height, around_width = around_depth.shape[0] - 1, around_depth.shape[1] - 1
    for j in prange(point.shape[0]):
        k = np.int64(j) if towards.shape[0] > 1 else 0
        along_x, along_y, along_z = towards[k, 0], towards[k, 1], towards[k, 2]
        pace = step / math.sqrt(along_x * along_x + along_y * along_y + along_z * along_z)
        back = along_z / point[j, 2]
        across_x, across_y = along_x - back * point[j, 0], along_y - back * point[j, 1]
        travelled = FIRST_STEP * step / math.sqrt(across_x * across_x + across_y * across_y)
        while True:
            z = point[j, 2] + travelled * along_z
            if z < nearest or z > farthest:
                break
            inverse = 1.0 / z
            x = (point[j, 0] + travelled * along_x) * inverse
            y = (point[j, 1] + travelled * along_y) * inverse
            travelled += pace
            row, col = fy * y + cy, fx * x + cx
            if 0.0 <= row < height and 0.0 <= col < width:
                surface = _depth_at(map_depth, row, col)
            else:
                row, col = around_fy * y + around_cy, around_fx * x + around_cx
                if not (0.0 <= row < around_height and 0.0 <= col < around_width):
                    break
                surface = _depth_at(around_depth, row, col)
                if goes_on:
                    r, c = int(row + 0.5), int(col + 0.5)
                    by_node = (1.0 - abs(row - r)) * (1.0 - abs(col - c))
                    if (z - surface) / by_node > below[j]:
                        below[j] = (z - surface) / by_node
                        node[j] = r * around_depth.shape[1] + c
                    continue
            if z > surface:  # behind the ground; False where the depth is unknown (NaN)
                free[j] = False
                break
    return free


@njit(cache=True, inline="always")
def _in_cells(intrinsics, grid):
    """fx, fy, cx, cy of a camera whose pixels are the cells of a grid: x / z * fx + cx is a column of it.

    The centre of pixel [row, col] of the image is at (col + 0.5, row + 0.5).
    """
    fx, fy, cx, cy = intrinsics
    return (
        fx / grid.stride,
        fy / grid.stride,
        (cx - 0.5 - grid.col) / grid.stride,
        (cy - 0.5 - grid.row) / grid.stride,
    )
