"""The information matrix J^T J of the joint estimate, in double precision, for any run of landmarks.

The solver never forms it. The covariances need it, a patch of the map at a time: each landmark's own block, how it is
coupled with the views that see it, and what it tells them. `factors.py` states the rows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from photoclinometry.adjust.kernels import CAMERA_SIZE, FAST, LANDMARK_SIZE, CameraState, LandmarkState
from photoclinometry.model.reflectance import _PHASE_FLOOR, phase_angle, photometric_function


class Observed(NamedTuple):
    """N observations, landmark by landmark, and how much each counts."""

    start: np.ndarray
    """(J + 1,) as in `Tracks`."""
    seen_by: np.ndarray
    """(N,) int32, the view of each."""
    keypoint: np.ndarray
    """(N, 2) [px]."""
    brightness: np.ndarray
    """(N,) where the landmarks project, or as it was measured."""
    slope: np.ndarray
    """(N, 2) how brightness changes with the projected pixel [1/px]."""
    keypoint_weight: np.ndarray
    """(N,) 1 / sigma [1/px] as the estimate has it."""
    brightness_weight: np.ndarray
    """(N,) 1 / sigma as the estimate has it, zero where brightness does not count."""
    keypoint_limit: np.ndarray
    """(J,) Huber limit, in sigmas."""
    brightness_limit: float


@njit(**FAST)
def _project(j, k, cameras, points, by_position):
    """Where landmark j lies in view k [px]; by_position[:2, :3] takes how that changes with its position."""
    rotation, arm = cameras.rotation[k], points.position[j] - cameras.center[k]
    z = rotation[0, 2] * arm[0] + rotation[1, 2] * arm[1] + rotation[2, 2] * arm[2]
    pixel = np.empty(2)
    for r in range(2):
        ratio = (rotation[0, r] * arm[0] + rotation[1, r] * arm[1] + rotation[2, r] * arm[2]) / z
        focal = cameras.intrinsics[k, r]
        pixel[r] = focal * ratio + cameras.intrinsics[k, 2 + r]
        for c in range(3):
            by_position[r, c] = focal * (rotation[c, r] - ratio * rotation[c, 2]) / z
    return pixel


@njit(**FAST)
def _keypoint_rows(j, i, k, cameras, points, observed, pivot, by_landmark, by_camera):
    """Rows 0 and 1 of observation i: `factors.projection`, scaled down beyond Huber's limit."""
    weight, from_pivot = observed.keypoint_weight[i], points.position[j] - pivot
    pixel = _project(j, k, cameras, points, by_landmark)
    squared = 0.0
    for r in range(2):
        squared += (weight * (pixel[r] - observed.keypoint[i, r])) ** 2
    shrink = math.sqrt(min(1.0, observed.keypoint_limit[j] / math.sqrt(max(squared, 1e-300))))
    for r in range(2):
        for c in range(3):
            by_landmark[r, c] *= weight * shrink
        _by_pose(by_landmark[r], from_pivot, by_camera[r])


@njit(**FAST)
def _by_pose(a, arm, out):
    """The row by pose (orbit 3, shift 3) that belongs to the row a by position: torque about the pivot, and force."""
    out[0] = a[1] * arm[2] - a[2] * arm[1]
    out[1] = a[2] * arm[0] - a[0] * arm[2]
    out[2] = a[0] * arm[1] - a[1] * arm[0]
    out[3], out[4], out[5] = -a[0], -a[1], -a[2]


@njit(**FAST)
def _add_slope(j, i, k, weight, cameras, points, observed, pivot, by_landmark, by_camera):
    """Takes from the row of a brightness what the image changes by where the landmark projects (`factors.direct`)."""
    slope = observed.slope[i]
    if slope[0] == 0.0 and slope[1] == 0.0:
        return
    of_pixel, image, of_pose = np.empty((2, 3)), np.empty(3), np.empty(6)
    _project(j, k, cameras, points, of_pixel)
    for c in range(3):
        image[c] = -weight * (slope[0] * of_pixel[0, c] + slope[1] * of_pixel[1, c])
    _by_pose(image, points.position[j] - pivot, of_pose)
    for c in range(3):
        by_landmark[c] += image[c]
    for c in range(6):
        by_camera[c] += of_pose[c]


@njit(**FAST)
def _brightness_row(j, i, k, cameras, points, observed, pivot, packed, by_landmark, by_camera):
    """Row 2 of observation i: `factors.photometric`, scaled down beyond Huber's limit."""
    weight = observed.brightness_weight[i]
    by_landmark[2] = 0.0
    by_camera[2] = 0.0
    if weight == 0.0:
        return
    sun, normal, albedo = cameras.sun[k], points.normal[j], points.albedo[j]
    offset = cameras.center[k] - points.position[j]
    distance = math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
    e = offset / distance
    c0, c1, c2 = sun[1] * e[2] - sun[2] * e[1], sun[2] * e[0] - sun[0] * e[2], sun[0] * e[1] - sun[1] * e[0]
    sine = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
    mu0 = sun[0] * normal[0] + sun[1] * normal[1] + sun[2] * normal[2]
    mu = e[0] * normal[0] + e[1] * normal[1] + e[2] * normal[2]
    phase = phase_angle(sun[0] * e[0] + sun[1] * e[1] + sun[2] * e[2], sine)
    rho, by_mu0, by_mu, by_phase = photometric_function(packed, mu0, mu, phase)
    gain = cameras.scale[k] * albedo
    residual = weight * (gain * rho + cameras.bias[k] - observed.brightness[i])
    weight *= math.sqrt(min(1.0, observed.brightness_limit / max(abs(residual), 1e-150)))
    bend = by_phase / max(sine, _PHASE_FLOOR)
    by_e = weight * gain * (by_mu * normal - bend * sun)
    along = by_e[0] * e[0] + by_e[1] * e[1] + by_e[2] * e[2]
    by_normal = weight * gain * (by_mu0 * sun + by_mu * e)
    by_sun = weight * gain * (by_mu0 * normal - bend * e)
    for c in range(3):
        by_landmark[2, c] = -(by_e[c] - along * e[c]) / distance
    _by_pose(by_landmark[2], cameras.center[k] - pivot, by_camera[2])
    _add_slope(j, i, k, weight, cameras, points, observed, pivot, by_landmark[2], by_camera[2])
    for c in range(2):
        basis, sun_basis = points.normal_basis[j], cameras.sun_basis[k]
        by_landmark[2, 3 + c] = by_normal[0] * basis[0, c] + by_normal[1] * basis[1, c] + by_normal[2] * basis[2, c]
        by_camera[2, 6 + c] = by_sun[0] * sun_basis[0, c] + by_sun[1] * sun_basis[1, c] + by_sun[2] * sun_basis[2, c]
    by_landmark[2, 5] = weight * cameras.scale[k] * rho
    by_camera[2, 8] = weight * albedo * rho
    by_camera[2, 9] = weight


@njit(nogil=True, **FAST)
def _add_patch(first, last, slot, cameras, points, observed, pivot, packed, patch):
    by_landmark, by_camera = np.zeros((3, LANDMARK_SIZE)), np.zeros((3, CAMERA_SIZE))
    for j in range(first, last):
        n = j - first
        for i in range(observed.start[j], observed.start[j + 1]):
            k = observed.seen_by[i]
            s = slot[k]
            _keypoint_rows(j, i, k, cameras, points, observed, pivot, by_landmark, by_camera)
            _brightness_row(j, i, k, cameras, points, observed, pivot, packed, by_landmark, by_camera)
            for r in range(3):
                touched, moved = (3, 6) if r < 2 else (LANDMARK_SIZE, CAMERA_SIZE)
                for a in range(touched):
                    x = by_landmark[r, a]
                    patch.shifts[n, a, s, r] += x
                    for b in range(touched):
                        patch.own[n, r // 2, a, b] += x * by_landmark[r, b]
                    for b in range(moved):
                        patch.coupling[n, a, s, b] += x * by_camera[r, b]
                for a in range(moved):
                    for b in range(a + 1):
                        patch.camera[s, a, b] += by_camera[r, a] * by_camera[r, b]


class Patch(NamedTuple):
    """J^T J from the observations of a run of n landmarks, which m views see; and their rows."""

    views: np.ndarray
    """(m,) indices."""
    own: np.ndarray
    """(n, 2, 6, 6) each landmark's block, by keypoints and by brightness."""
    coupling: np.ndarray
    """(n, 6, m, 10) landmark with view."""
    shifts: np.ndarray
    """(n, 6, m, 3) rows by landmark: what a unit whitened error of u, v and brightness in a view adds to -gradient."""
    camera: np.ndarray
    """(m, 10, 10) each view's block."""


def observed_patch(
    first, last, cameras: CameraState, points: LandmarkState, observed: Observed, pivot, packed
) -> Patch:
    """The patch of landmarks first:last. pivot: (3,) of `Estimate`; packed: `Reflectance.packed`."""
    views = np.unique(observed.seen_by[observed.start[first] : observed.start[last]])
    slot = np.zeros(len(cameras.scale), np.int64)
    slot[views] = np.arange(len(views))
    n, m = last - first, len(views)
    patch = Patch(
        views,
        np.zeros((n, 2, LANDMARK_SIZE, LANDMARK_SIZE)),
        np.zeros((n, LANDMARK_SIZE, m, CAMERA_SIZE)),
        np.zeros((n, LANDMARK_SIZE, m, 3)),
        np.zeros((m, CAMERA_SIZE, CAMERA_SIZE)),
    )
    _add_patch(first, last, slot, cameras, points, observed, pivot, packed, patch)
    patch.camera[:] += np.swapaxes(np.tril(patch.camera, -1), 1, 2)
    return patch
