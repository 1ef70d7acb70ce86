"""The reflectance parameters, which every brightness depends on: a border of the normal equations.

They are few, so their rows and columns are kept as they are, (J, 6, T) and (K, 10, T), made in a pass over the
rows that `kernels.linearize` has stored. A parameter's coordinate is its relative change from the start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.graph.kernels import (
    CAMERA_SIZE,
    LANDMARK_SIZE,
    STORED,
    CameraState,
    LandmarkState,
    observed_brightness,
)
from photoclinometry.adjust.graph.layout import LANES, Layout, Measurements
from photoclinometry.adjust.graph.product import Linearized
from photoclinometry.adjust.graph.rows import COMPILED
from photoclinometry.model.reflectance import angles_at, photometric_parameters, photometric_value


class Border(NamedTuple):
    """What T parameters add to the normal equations."""

    by_landmark: np.ndarray
    """(J, 6, T) float32."""
    by_camera: np.ndarray
    """(K, 10, T)."""
    block: np.ndarray
    """(T, T)."""
    gradient: np.ndarray
    """(T,)."""


class ParameterResponse(NamedTuple):
    """How uncertain T estimated parameters are, as relative changes, and what all else does when they move."""

    covariance: np.ndarray
    """(T, T)."""
    of_cameras: np.ndarray
    """(10 K, T)."""
    of_landmarks: np.ndarray
    """(J, 6, T)."""


def no_border(views: int, landmarks: int) -> Border:
    """Of no parameters."""
    by_landmark, by_camera = np.zeros((landmarks, LANDMARK_SIZE, 0), np.float32), np.zeros((views, CAMERA_SIZE, 0))
    return Border(by_landmark, by_camera, np.zeros((0, 0)), np.zeros(0))


def linearize_parameters(
    layout: Layout,
    measured: Measurements,
    cameras: CameraState,
    landmarks: LandmarkState,
    where: Linearized,
    packed: np.ndarray,
    start: np.ndarray,
    stored: np.ndarray,
    threads: int,
) -> Border:
    """packed: `Reflectance.packed`; start: (T,) the parameters whose relative changes are estimated."""
    count, views, marks = len(start), len(cameras.center), len(landmarks.albedo)
    by_landmark = np.zeros((marks, LANDMARK_SIZE, count), np.float32)
    by_camera = np.zeros((threads, views, count, CAMERA_SIZE))
    block, gradient = np.zeros((threads, count, count)), np.zeros((threads, count))
    _linearize(
        layout, measured, cameras, landmarks, where.of_landmarks, packed, start, stored, by_landmark, by_camera, block,
        gradient,
    )  # fmt: skip
    return Border(by_landmark, np.swapaxes(by_camera.sum(0), 1, 2).copy(), block.sum(0), gradient.sum(0))


@njit(cache=True, parallel=True, error_model="numpy")
def _linearize(
    layout, measured, cameras, landmarks, where, packed, start, stored, by_landmark, by_camera, block, gradient
):
    """`linearize_parameters`; by_camera: (threads, K, T, 10)."""
    parts = gradient.shape[0]
    groups = layout.slot_start.size - 1
    for part in prange(parts):
        row = np.zeros(start.size)
        for group in range(part * groups // parts, (part + 1) * groups // parts):
            for slot in range(layout.slot_start[group], layout.slot_start[group + 1]):
                k = layout.slot_view[slot]
                rows = stored[STORED * LANES * slot : STORED * LANES * (slot + 1)]
                for lane in range(LANES):
                    weight = rows[11 * LANES + lane]
                    if weight != 0.0:
                        j = LANES * group + lane
                        place = LANES * slot + lane
                        seen = observed_brightness(j, k, place, measured, cameras, landmarks)
                        r = _row(j, k, weight, seen, cameras, landmarks, packed, row)
                        for t in range(start.size):
                            row[t] *= start[t]
                        _add(rows, lane, cameras.scale[k], where[j], row, by_landmark[j], by_camera[part, k])
                        for t in range(start.size):
                            gradient[part, t] += r * row[t]
                            for u in range(start.size):
                                block[part, t, u] += row[t] * row[u]


@njit(cache=True, error_model="numpy")
def _row(j, k, weight, brightness, cameras, landmarks, packed, row):
    """Derivatives of one whitened brightness by the parameters; returns the residual."""
    mu0, mu, phase = angles_at(cameras.sun[k], cameras.center[k], landmarks.position[j], landmarks.normal[j])
    gain = cameras.scale[k] * landmarks.albedo[j]
    photometric_parameters(packed, mu0, mu, phase, row)
    for t in range(row.size):
        row[t] *= weight * gain
    return weight * (gain * photometric_value(packed, mu0, mu, phase) + cameras.bias[k] - brightness)


@njit(cache=True, error_model="numpy")
def _add(rows, lane, scale, where, row, by_landmark, by_camera):
    """Products of one observation's other derivatives with those by the parameters; where: `Linearized`."""
    p, albedo = where, where[3]
    h0, h1, h2 = rows[3 * LANES + lane], rows[4 * LANES + lane], rows[5 * LANES + lane]
    orbit = (
        h1 * p[2] - h2 * p[1] + rows[12 * LANES + lane],
        h2 * p[0] - h0 * p[2] + rows[13 * LANES + lane],
        h0 * p[1] - h1 * p[0] + rows[14 * LANES + lane],
    )
    for t in range(row.size):
        g = row[t]
        for i in range(3):
            by_landmark[i, t] += rows[(3 + i) * LANES + lane] * g
            by_camera[t, i] += orbit[i] * g
            by_camera[t, 3 + i] -= rows[(3 + i) * LANES + lane] * g
        for i in range(2):
            by_landmark[3 + i, t] += rows[(6 + i) * LANES + lane] * g
            by_camera[t, 6 + i] += rows[(8 + i) * LANES + lane] * g
        by_landmark[5, t] += rows[10 * LANES + lane] * scale * g
        by_camera[t, 8] += rows[10 * LANES + lane] * albedo * g
        by_camera[t, 9] += rows[11 * LANES + lane] * g


@njit(parallel=True, **COMPILED)
def add_border(by_landmark, landmark, parameter, landmark_out, parameter_out):
    """landmark_out += border parameter, and parameter_out (threads, T) its transpose times landmark (J, 6); float32.

    Compiled, as BLAS would set threads of its own spinning for products this thin.
    """
    parts, count = parameter_out.shape
    marks = landmark.shape[0]
    for part in prange(parts):
        total = np.zeros(count)
        for j in range(part * marks // parts, (part + 1) * marks // parts):
            for i in range(LANDMARK_SIZE):
                x, change = landmark[j, i], np.float32(0.0)
                for t in range(count):
                    change += by_landmark[j, i, t] * parameter[t]
                    total[t] += by_landmark[j, i, t] * x
                landmark_out[j, i] += change
        parameter_out[part] = total
