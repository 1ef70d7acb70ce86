"""Dense matches and poses -> landmarks with tracks: one landmark per reference pixel that enough views see."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from photoclinometry.matching.interface import Matches
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import Rigid, skew
from photoclinometry.model.scene import Camera, Region, Tracks, Views

log = logging.getLogger(__name__)

BLOCK = 2**21
"""Observations that are triangulated at a time, rows of the map's grid together: 100 MB."""


@dataclass(frozen=True, kw_only=True)
class DensifyOptions:
    """Landmarks from dense matches."""

    min_views: int = 6
    """A landmark is observed in at least this many views, the reference included."""
    max_sampson_px2: float = 1.0
    """Greatest squared Sampson distance of a match to the epipolar geometry of the sparse poses [px^2]."""
    max_reprojection_px: float = 3.0
    """Observations farther from the triangulated point are dropped [px]."""
    min_triangulation_deg: float = 1.0
    """The reference's ray and one other at least must meet at this angle."""
    min_certainty: float = 0.05
    """Matches of less certainty are not used."""
    reference_sigma_px: float = 0.1
    """Standard deviation of the reference's own keypoint, the pixel centre that defines the landmark [px]."""


@dataclass(frozen=True, kw_only=True)
class DenseTracks:
    """J landmarks, row by row of the region, and their N observations (compressed rows)."""

    position: np.ndarray
    """(J, 3) in B."""
    pixel: np.ndarray
    """(J, 2) int32 (row, col) of the reference image."""
    start: np.ndarray
    """(J + 1,) int64."""
    view: np.ndarray
    """(N,) int32, ascending within a landmark; the reference is among them."""
    keypoint: np.ndarray
    """(N, 2) float64 [px]."""
    keypoint_sigma: np.ndarray
    """(N,) float64 [px]."""


def densify(
    region: Region,
    reference: int,
    matches: dict[int, Matches],
    cameras: tuple[Camera, ...] | list[Camera],
    body_from_cam: Rigid,
    options: DensifyOptions | None = None,
) -> DenseTracks:
    """Triangulate every pixel of the map's grid that at least `min_views` views agree on.

    matches: by view index, over `region`; the reference itself is not in it. cameras, body_from_cam: all K views.
    A match must be valid, certain enough and near its epipolar line; the point is the linear least-squares
    solution of all its projections (`triangulate`), found again without observations of gross error.
    Raises ReconstructionError where no pixel qualifies.
    """
    options = options or DensifyOptions()
    views = np.array(sorted([*matches, reference]), np.int32)
    rows, cols = region.grid_shape
    found, first = [], 0
    for part in region.row_blocks(max(1, BLOCK // (cols * len(views)))):
        part_rows = slice(first, first + part.grid_shape[0])
        found.append(_densify_rows(part, part_rows, reference, matches, views, cameras, body_from_cam, options))
        first = part_rows.stop
    # A field at a time, each of whose parts are let go of before the next.
    merged = {name: np.concatenate([part.pop(name) for part in found]) for name in tuple(found[0])}
    landmarks, observations = len(merged["count"]), len(merged["view"])
    if not landmarks:
        raise ReconstructionError(
            f"no pixel of the region was matched in {options.min_views} views or more; lower min_views "
            f"(there are {len(views)} views) or choose a region that more views see"
        )
    log.info("%d landmarks from %d pixels, %.1f views each", landmarks, rows * cols, observations / landmarks)
    return DenseTracks(start=np.concatenate([[0], np.cumsum(merged.pop("count"))]).astype(np.int64), **merged)


def _densify_rows(
    part: Region,
    rows: slice,
    reference: int,
    matches: dict[int, Matches],
    views: np.ndarray,
    cameras: tuple[Camera, ...] | list[Camera],
    body_from_cam: Rigid,
    options: DensifyOptions,
) -> dict[str, np.ndarray]:
    """`DenseTracks` of a part of the region, with each landmark's `count` of observations instead of `start`.

    rows: of the whole map's grid, over which matches are, those of the part.
    """
    xy, sigma, used = _stack(part, rows, reference, matches, views, cameras, body_from_cam, options)
    cam_from_body = body_from_cam[views].inverse()
    intrinsics = np.array([(*cameras[k].focal_px, *cameras[k].principal_px) for k in views], float)
    own = int(np.flatnonzero(views == reference)[0])
    position, kept = np.zeros((len(xy), 3)), np.zeros(len(xy), bool)
    _triangulate_all(
        xy, sigma, used, np.ascontiguousarray(cam_from_body.rotation), cam_from_body.translation,
        body_from_cam.translation[views], intrinsics, own, options.min_views, options.max_reprojection_px,
        math.radians(options.min_triangulation_deg), position, kept,
    )  # fmt: skip
    landmark, column = np.nonzero(used & kept[:, None])
    row, col = np.divmod(np.flatnonzero(kept), part.grid_shape[1])
    row, col = part.row + part.stride * row, part.col + part.stride * col
    return {
        "position": position[kept],
        "pixel": np.stack([row, col], -1).astype(np.int32),
        "count": used[kept].sum(1),
        "view": views[column],
        "keypoint": xy[landmark, column],
        "keypoint_sigma": sigma[landmark, column],
    }


def fundamental_matrix(camera_a: Camera, pose_a: Rigid, camera_b: Camera, pose_b: Rigid) -> np.ndarray:
    """F (3, 3) with (x_b, 1) F (x_a, 1)^T = 0 for pixels of one point; poses are body_from_cam."""
    b_from_a = pose_b.inverse() @ pose_a
    essential = skew(b_from_a.translation) @ b_from_a.rotation
    return _pixel_from_ray_inverse(camera_b).T @ essential @ _pixel_from_ray_inverse(camera_a)


def sampson_error(fundamental: np.ndarray, xy_a: np.ndarray, xy_b: np.ndarray) -> np.ndarray:
    """Squared Sampson distance [px^2] of pixels (..., 2) of a and b to the epipolar geometry.

    (x_b F x_a)^2 / ((F x_a)_1^2 + (F x_a)_2^2 + (F^T x_b)_1^2 + (F^T x_b)_2^2)   (Hartley and Zisserman 11.9)
    """
    one = np.ones_like(xy_a[..., :1])
    a, b = np.concatenate([xy_a, one], -1), np.concatenate([xy_b, one], -1)
    line_b, line_a = a @ fundamental.T, b @ fundamental
    squares = (line_b[..., :2] ** 2).sum(-1) + (line_a[..., :2] ** 2).sum(-1)
    return np.sum(b * line_b, -1) ** 2 / np.maximum(squares, 1e-300)


def _pixel_from_ray_inverse(camera: Camera) -> np.ndarray:
    """(3, 3) ray_from_pixel, the inverse of the calibration matrix."""
    (fx, fy), (cx, cy) = camera.focal_px, camera.principal_px
    return np.array([[1 / fx, 0, -cx / fx], [0, 1 / fy, -cy / fy], [0, 0, 1]])


def _stack(
    part: Region,
    rows: slice,
    reference: int,
    matches: dict[int, Matches],
    views: np.ndarray,
    cameras: tuple[Camera, ...] | list[Camera],
    body_from_cam: Rigid,
    options: DensifyOptions,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (P, V, 2), sigmas (P, V) and use (P, V) of a part of the region in all views, the reference included."""
    center = part.pixel_centers()[part.grid_slices]
    shape = (center.shape[0] * center.shape[1], len(views))
    xy, sigma, used = np.zeros((*shape, 2)), np.ones(shape), np.zeros(shape, bool)
    for column, view in enumerate(views):
        if view == reference:
            xy[:, column] = center.reshape(-1, 2)
            sigma[:, column], used[:, column] = options.reference_sigma_px, True
            continue
        match = matches[int(view)]
        fundamental = fundamental_matrix(
            cameras[reference], body_from_cam[reference], cameras[view], body_from_cam[view]
        )
        position = match.position[rows]
        near = sampson_error(fundamental, center, position) < options.max_sampson_px2
        use = match.valid[rows] & near & (match.certainty[rows] >= options.min_certainty)
        xy[:, column] = position.reshape(-1, 2)
        sigma[:, column] = match.sigma_px[rows].ravel()
        used[:, column] = use.ravel()
    return xy, sigma, used


@njit(cache=True)
def triangulate(xy, weight, used, rotation, translation, intrinsics, point):
    """Linear least squares for the point of its projections: the direct linear transform with X_4 = 1.

    Each used observation gives w (x_n r3 - r1) . X = w (t1 - x_n t3) and the same for y, with x_n normalised by
    the intrinsics; weighted by focal / (sigma depth), with the depth of the first solution, the rows are
    whitened reprojection errors. xy (V, 2), weight (V,) 1 / sigma, used (V,); cam_from_body rotation (V, 3, 3),
    translation (V, 3); intrinsics (V, 4). Writes point (3,); returns False where the rays do not fix it.
    """
    for sweep in range(2):
        a00 = a01 = a02 = a11 = a12 = a22 = b0 = b1 = b2 = 0.0
        for k in range(used.size):
            if not used[k]:
                continue
            r, t = rotation[k], translation[k]
            depth = t[2]
            if sweep > 0:
                depth += r[2, 0] * point[0] + r[2, 1] * point[1] + r[2, 2] * point[2]
            for axis in range(2):
                w = weight[k] * intrinsics[k, axis] / depth
                n = (xy[k, axis] - intrinsics[k, 2 + axis]) / intrinsics[k, axis]
                u0 = w * (n * r[2, 0] - r[axis, 0])
                u1 = w * (n * r[2, 1] - r[axis, 1])
                u2 = w * (n * r[2, 2] - r[axis, 2])
                v = w * (t[axis] - n * t[2])
                a00 += u0 * u0
                a01 += u0 * u1
                a02 += u0 * u2
                a11 += u1 * u1
                a12 += u1 * u2
                a22 += u2 * u2
                b0 += u0 * v
                b1 += u1 * v
                b2 += u2 * v
        c00, c01, c02 = a11 * a22 - a12 * a12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
        c11, c12, c22 = a00 * a22 - a02 * a02, a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
        determinant = a00 * c00 + a01 * c01 + a02 * c02
        if not determinant > 1e-12 * a00 * a11 * a22:
            return False
        point[0] = (c00 * b0 + c01 * b1 + c02 * b2) / determinant
        point[1] = (c01 * b0 + c11 * b1 + c12 * b2) / determinant
        point[2] = (c02 * b0 + c12 * b1 + c22 * b2) / determinant
    return True


def triangulate_tracks(tracks: Tracks, views: Views) -> np.ndarray:
    """(J, 3) the points of all tracks by `triangulate`; NaN where their rays do not fix one."""
    cam_from_body = views.body_from_cam.inverse()
    rotation = np.ascontiguousarray(cam_from_body.rotation)
    weight = 1.0 / tracks.keypoint_sigma
    found = np.full((len(tracks.start) - 1, 3), np.nan)
    _triangulate_tracks(
        tracks.start, tracks.view, tracks.keypoint, weight, rotation, cam_from_body.translation, views.intrinsics, found
    )
    return found


@njit(cache=True)
def _triangulate_tracks(start, view, keypoint, weight, rotation, translation, intrinsics, position):
    """Writes position (J, 3) where there is one."""
    point = np.zeros(3)
    for j in range(len(start) - 1):
        seen = slice(start[j], start[j + 1])
        k = view[seen]
        used = np.ones(len(k), np.bool_)
        if triangulate(keypoint[seen], weight[seen], used, rotation[k], translation[k], intrinsics[k], point):
            position[j] = point


@njit(cache=True)
def _worst(xy, used, rotation, translation, intrinsics, point):
    """Index and squared error [px^2] of the worst observation; infinite behind a camera."""
    worst, at = -1.0, -1
    for k in range(used.size):
        if not used[k]:
            continue
        r, t = rotation[k], translation[k]
        z = r[2, 0] * point[0] + r[2, 1] * point[1] + r[2, 2] * point[2] + t[2]
        error = np.inf
        if z > 0.0:
            x = r[0, 0] * point[0] + r[0, 1] * point[1] + r[0, 2] * point[2] + t[0]
            y = r[1, 0] * point[0] + r[1, 1] * point[1] + r[1, 2] * point[2] + t[1]
            dx = intrinsics[k, 0] * x / z + intrinsics[k, 2] - xy[k, 0]
            dy = intrinsics[k, 1] * y / z + intrinsics[k, 3] - xy[k, 1]
            error = dx * dx + dy * dy
        if error > worst:
            worst, at = error, k
    return at, worst


@njit(cache=True)
def _widest_angle(used, center, own, point):
    """Greatest angle [rad] at the point between the reference's ray and another used view's; centers (V, 3)."""
    e0, e1, e2 = point[0] - center[own, 0], point[1] - center[own, 1], point[2] - center[own, 2]
    widest = 0.0
    for k in range(used.size):
        if used[k] and k != own:
            o0, o1, o2 = point[0] - center[k, 0], point[1] - center[k, 1], point[2] - center[k, 2]
            c0, c1, c2 = e1 * o2 - e2 * o1, e2 * o0 - e0 * o2, e0 * o1 - e1 * o0
            sine = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
            widest = max(widest, math.atan2(sine, e0 * o0 + e1 * o1 + e2 * o2))
    return widest


@njit(cache=True, parallel=True)
def _triangulate_all(
    xy, sigma, used, rotation, translation, center, intrinsics, own, min_views, max_error, min_angle,
    position, kept,
):  # fmt: skip
    """Triangulate each pixel, dropping the worst observation while one is off by more than max_error [px].

    `used` (P, V) is updated to the observations that remain; position (P, 3) and kept (P,) are written. A
    pixel whose own reference observation is the worst is given up.
    """
    for p in prange(xy.shape[0]):
        point = np.zeros(3)
        weight = 1.0 / sigma[p]
        while True:
            if np.sum(used[p]) < min_views:
                break
            if not triangulate(xy[p], weight, used[p], rotation, translation, intrinsics, point):
                break
            at, worst = _worst(xy[p], used[p], rotation, translation, intrinsics, point)
            if worst > max_error * max_error:
                if at == own:
                    break
                used[p, at] = False
                continue
            if _widest_angle(used[p], center, own, point) >= min_angle:
                position[p] = point
                kept[p] = True
            break
