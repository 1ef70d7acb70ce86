"""Points from their projections: linear least squares, and the rejection of wrong observations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.model.projection import project_point
from photoclinometry.model.scene import Tracks, Views

SINGULAR = 1e-12
"""Rays do not fix a point if the determinant of its normal equations is below this share of the product of their
diagonal: about the square of the angle between the rays [rad], so that rays parallel within 1e-6 rad are refused."""


class PinholeCameras(NamedTuple):
    """Poses and intrinsics of V views, in the form of the compiled loops."""

    rotation: np.ndarray
    """(V, 3, 3) body_from_cam."""
    center: np.ndarray
    """(V, 3) camera centres in B."""
    intrinsics: np.ndarray
    """(V, 4) fx, fy, cx, cy [px]."""


class Limits(NamedTuple):
    """Limits for a triangulated point to be accepted."""

    min_views: int
    max_error_px: float
    """Of each observation."""
    min_angle_rad: float
    """Between the reference's ray and the one at the widest angle to it."""


@njit(cache=True)
def triangulate(xy, weight, used, cameras, point):
    """Linear least squares for the point of its projections: the direct linear transform with X_4 = 1.

    Each used observation gives w (x_n r3 - r1) . (X - c) = 0 and the same for y, with x_n normalised by the
    intrinsics, r1 to r3 the camera's axes in B and c its centre; weighted by focal / (sigma depth), with the depth of
    the first solution, the rows are whitened reprojection errors. xy (V, 2), weight (V,) 1 / sigma, used (V,);
    cameras: `PinholeCameras` of V views. Writes point (3,); returns False where the rays do not fix it.
    """
    for sweep in range(2):
        a00 = a01 = a02 = a11 = a12 = a22 = b0 = b1 = b2 = 0.0
        for k in range(used.size):
            if not used[k]:
                continue
            r, c, intrinsics = cameras.rotation[k], cameras.center[k], cameras.intrinsics[k]
            # The first sweep takes the depth of B's origin.
            d0, d1, d2 = -c[0], -c[1], -c[2]
            if sweep > 0:
                d0, d1, d2 = point[0] - c[0], point[1] - c[1], point[2] - c[2]
            depth = r[0, 2] * d0 + r[1, 2] * d1 + r[2, 2] * d2
            for axis in range(2):
                w = weight[k] * intrinsics[axis] / depth
                n = (xy[k, axis] - intrinsics[2 + axis]) / intrinsics[axis]
                u0 = w * (n * r[0, 2] - r[0, axis])
                u1 = w * (n * r[1, 2] - r[1, axis])
                u2 = w * (n * r[2, 2] - r[2, axis])
                v = u0 * c[0] + u1 * c[1] + u2 * c[2]
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
        if not determinant > SINGULAR * a00 * a11 * a22:
            return False
        point[0] = (c00 * b0 + c01 * b1 + c02 * b2) / determinant
        point[1] = (c01 * b0 + c11 * b1 + c12 * b2) / determinant
        point[2] = (c02 * b0 + c12 * b1 + c22 * b2) / determinant
    return True


def triangulate_tracks(tracks: Tracks, views: Views) -> np.ndarray:
    """(J, 3) the points of all tracks by `triangulate`; NaN where their rays do not fix one."""
    pose = views.body_from_cam
    cameras = PinholeCameras(np.ascontiguousarray(pose.rotation), pose.translation, views.intrinsics)
    position = np.full((len(tracks.start) - 1, 3), np.nan)
    _triangulate_tracks(tracks.start, tracks.view, tracks.keypoint, 1.0 / tracks.keypoint_sigma, cameras, position)
    return position


@njit(cache=True)
def _triangulate_tracks(start, view, keypoint, weight, cameras, position):
    """Writes position (J, 3) where there is one."""
    point = np.zeros(3)
    for j in range(len(start) - 1):
        row = slice(start[j], start[j + 1])
        k = view[row]
        own = PinholeCameras(cameras.rotation[k], cameras.center[k], cameras.intrinsics[k])
        if triangulate(keypoint[row], weight[row], np.ones(len(k), np.bool_), own, point):
            position[j] = point


@njit(cache=True, parallel=True)
def triangulate_all(xy, sigma, used, cameras, reference, limits, position, kept):
    """Triangulate each of P pixels, dropping the worst observation while one is off by more than the limit.

    xy (P, V, 2) [px], sigma (P, V) [px]; cameras: `PinholeCameras` of V views; reference: its index among these;
    limits: `Limits`. `used` (P, V) is updated to the observations that remain; position (P, 3) and kept (P,) are
    written. A pixel is given up if the reference's own observation is the worst one.
    """
    for p in prange(xy.shape[0]):
        point = np.zeros(3)
        weight = 1.0 / sigma[p]
        while True:
            if np.sum(used[p]) < limits.min_views:
                break
            if not triangulate(xy[p], weight, used[p], cameras, point):
                break
            worst, square = _worst(xy[p], used[p], cameras, point)
            if square > limits.max_error_px * limits.max_error_px:
                if worst == reference:
                    break
                used[p, worst] = False
                continue
            if _widest_angle(used[p], cameras.center, reference, point) >= limits.min_angle_rad:
                position[p] = point
                kept[p] = True
            break


@njit(cache=True)
def _worst(xy, used, cameras, point):
    """Index and squared error [px^2] of the worst observation; infinite behind a camera."""
    largest, worst = -1.0, -1
    for k in range(used.size):
        if not used[k]:
            continue
        r, c, intrinsics = cameras.rotation[k], cameras.center[k], cameras.intrinsics[k]
        inverse_depth, x, y = project_point(
            r[0, 0], r[0, 1], r[0, 2], r[1, 0], r[1, 1], r[1, 2], r[2, 0], r[2, 1], r[2, 2],
            point[0] - c[0], point[1] - c[1], point[2] - c[2],
        )  # fmt: skip
        error = np.inf
        if inverse_depth > 0.0:
            dx = intrinsics[0] * x + intrinsics[2] - xy[k, 0]
            dy = intrinsics[1] * y + intrinsics[3] - xy[k, 1]
            error = dx * dx + dy * dy
        if error > largest:
            largest, worst = error, k
    return worst, largest


@njit(cache=True)
def _widest_angle(used, center, reference, point):
    """Greatest angle [rad] at the point between the reference's ray and another used view's; centers (V, 3)."""
    e0, e1, e2 = point[0] - center[reference, 0], point[1] - center[reference, 1], point[2] - center[reference, 2]
    widest = 0.0
    for k in range(used.size):
        if used[k] and k != reference:
            o0, o1, o2 = point[0] - center[k, 0], point[1] - center[k, 1], point[2] - center[k, 2]
            c0, c1, c2 = e1 * o2 - e2 * o1, e2 * o0 - e0 * o2, e0 * o1 - e1 * o0
            sine = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
            widest = max(widest, math.atan2(sine, e0 * o0 + e1 * o1 + e2 * o2))
    return widest
