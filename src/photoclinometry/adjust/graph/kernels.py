"""The compiled inner loops over keypoints and brightness. `rows.py` states a row, `factors.py` states it in NumPy.

Everything is done for one slot at a time: a view and the sixteen landmarks of a group (see `layout`). What belongs to
the view is one number for all of them; what belongs to a landmark or an observation is a row of sixteen, kept in a flat
array so that each loop is one straight run of vector instructions. All is in double precision here; the rows of the
Jacobian are kept in single precision for `product.multiply` (single precision throughout was measured to be wrong:
the cost was off by 2e-5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.graph.layout import LANES
from photoclinometry.adjust.graph.rows import (
    COMPILED,
    along_basis,
    angles,
    brightness_by_vectors,
    direction,
    huber,
    pixel_by_position,
    view_numbers,
)
from photoclinometry.model.projection import project_point
from photoclinometry.model.reflectance import photometric_function

CAMERA_SIZE = 10
"""omega 3, tau 3, Sun 2, scale 1, bias 1."""
LANDMARK_SIZE = 6
"""position 3, normal 2, albedo 1."""
STORED = 15
"""Rows kept of each slot. Of keypoints, 0: weight over depth, 1, 2: x / z and y / z. Of brightness, 3:6 by position,
6:8 by normal, 8:10 by Sun, 10: weight times rho, 11: weight, 12:15 by orbit, beyond what follows from 3:6."""

# Rows of the scratch array: what is known of the landmarks, the Jacobian by landmark and view, residuals.
_POSITION, _NORMAL, _BASIS, _ALBEDO, _LIMIT = 0, 3, 6, 12, 13
_U, _V, _B = 14, 17, 20
_SUN, _SCALE, _WEIGHT, _RESIDUAL = 26, 28, 29, 30
_TO_CAMERA, _COSINE, _SINE, _RHO, _RANGE = 33, 36, 37, 38, 42
_SEEN, _TURN = 43, 46
_COLUMNS, _ROWS = 49, 49 + 3 * CAMERA_SIZE
_BLOCK_SIZE = LANDMARK_SIZE * (LANDMARK_SIZE + 1) // 2 + LANDMARK_SIZE


class CameraState(NamedTuple):
    """What the kernels need of K views."""

    rotation: np.ndarray
    """(K, 3, 3) body_from_cam."""
    center: np.ndarray
    """(K, 3) in B."""
    intrinsics: np.ndarray
    """(K, 4) fx, fy, cx, cy [px]."""
    sun: np.ndarray
    """(K, 3) in B."""
    sun_basis: np.ndarray
    """(K, 3, 2) tangent basis of `sun`."""
    scale: np.ndarray
    bias: np.ndarray


class LandmarkState(NamedTuple):
    """What the kernels need of J landmarks."""

    position: np.ndarray
    """(J, 3) in B."""
    normal: np.ndarray
    """(J, 3)."""
    normal_basis: np.ndarray
    """(J, 3, 2) tangent basis of `normal`."""
    albedo: np.ndarray


class Normal(NamedTuple):
    """Gradient and diagonal blocks of the normal equations, filled by `linearize`."""

    landmark_block: np.ndarray
    """(J, 6, 6)."""
    landmark_gradient: np.ndarray
    """(J, 6)."""
    camera_block: np.ndarray
    """(threads, K, 10, 10), lower triangles, summed over the first axis by the caller."""
    camera_gradient: np.ndarray
    """(threads, K, 10), likewise."""
    cost: np.ndarray
    """(threads, 2): squared whitened residuals of keypoints and of brightness, after the loss."""


@njit(parallel=True, **COMPILED)
def linearize(layout, measured, cameras, landmarks, pivot, packed, with_jacobian, stored, normal):
    """Cost of keypoints and brightness and, if asked, their Jacobian (`stored`) and normal equations.

    pivot: (3,) as in `Estimate`. packed: `Reflectance.packed`.
    stored: (STORED P,) float32, filled with the rows of sixteen of every slot if asked. normal: `Normal`, overwritten.
    """
    parts = normal.cost.shape[0]
    for part in prange(parts):
        _linearize_part(part, parts, layout, measured, cameras, landmarks, pivot, packed, with_jacobian, stored, normal)


@njit(**COMPILED)
def _linearize_part(part, parts, layout, measured, cameras, landmarks, pivot, packed, with_jacobian, stored, normal):
    """`linearize` for one thread's share of the groups."""
    w, scratch = np.zeros(_ROWS * LANES), np.zeros(STORED * LANES, np.float32)
    of_landmarks = np.zeros(_BLOCK_SIZE * LANES)
    normal.camera_block[part] = 0.0
    normal.camera_gradient[part] = 0.0
    keypoint_cost = brightness_cost = 0.0
    groups = layout.slot_start.size - 1
    for group in range(part * groups // parts, (part + 1) * groups // parts):
        _gather_landmarks(LANES * group, landmarks, measured.keypoint_limit, w)
        of_landmarks[:] = 0.0
        for slot in range(layout.slot_start[group], layout.slot_start[group + 1]):
            k, place = layout.slot_view[slot], LANES * slot
            rows = stored[STORED * place : STORED * (place + LANES)] if with_jacobian else scratch
            keypoint_cost += _keypoint_rows(k, place, cameras, measured, w, rows)
            lit = _brightness_geometry(k, place, cameras, measured.brightness_weight, packed, w)
            brightness_cost += _brightness_rows(k, place, lit, cameras, measured, w, rows)
            if with_jacobian:
                _add_landmarks(w, of_landmarks)
                _camera_rows(pivot, w)
                _add_camera(w, normal.camera_block[part, k], normal.camera_gradient[part, k])
        if with_jacobian:
            _scatter_landmarks(LANES * group, of_landmarks, normal.landmark_block, normal.landmark_gradient)
    normal.cost[part, 0] = keypoint_cost
    normal.cost[part, 1] = brightness_cost


@njit(**COMPILED)
def _gather_landmarks(first, landmarks, limit, w):
    """The group's landmarks, one to a lane; beyond the last landmark it is repeated, with nothing measured there."""
    for lane in range(LANES):
        j = min(first + lane, landmarks.albedo.size - 1)
        for i in range(3):
            w[(_POSITION + i) * LANES + lane] = landmarks.position[j, i]
            w[(_NORMAL + i) * LANES + lane] = landmarks.normal[j, i]
            for m in range(2):
                w[(_BASIS + 2 * i + m) * LANES + lane] = landmarks.normal_basis[j, i, m]
        w[_ALBEDO * LANES + lane] = landmarks.albedo[j]
        w[_LIMIT * LANES + lane] = limit[j]


@njit(**COMPILED)
def _keypoint_rows(k, place, cameras, measured, w, rows):
    """Whitened projection rows of a slot (factors.projection); returns their cost."""
    c0, c1, c2 = cameras.center[k, 0], cameras.center[k, 1], cameras.center[k, 2]
    intrinsics, rotation = view_numbers(k, cameras)
    fx, fy, cx, cy = intrinsics
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    weights = measured.keypoint_weight[place : place + LANES]
    measured_x, measured_y = measured.keypoint[0, place : place + LANES], measured.keypoint[1, place : place + LANES]
    total = 0.0
    for s in range(LANES):
        d0, d1, d2 = w[s] - c0, w[LANES + s] - c1, w[2 * LANES + s] - c2
        inverse, x, y = project_point(r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2)
        w[_SEEN * LANES + s], w[(_SEEN + 1) * LANES + s], w[(_SEEN + 2) * LANES + s] = inverse, x, y
        weight = float(weights[s])
        u = weight * (fx * x + cx - measured_x[s])
        v = weight * (fy * y + cy - measured_y[s])
        cost, shrink = huber(math.sqrt(u * u + v * v), w[_LIMIT * LANES + s])
        total += cost
        w[_RESIDUAL * LANES + s] = u * shrink
        w[(_RESIDUAL + 1) * LANES + s] = v * shrink
        weight *= shrink
        rows[s], rows[LANES + s], rows[2 * LANES + s] = weight * inverse, x, y
        by_x, by_y = pixel_by_position(intrinsics, rotation, weight * inverse, x, y)
        for i in range(3):
            w[(_U + i) * LANES + s] = by_x[i]
            w[(_V + i) * LANES + s] = by_y[i]
    return total


@njit(**COMPILED)
def _brightness_geometry(k, place, cameras, weights, packed, w):
    """Directions to the camera, rho and its three derivatives in a slot; returns whether any brightness counts."""
    lit = False
    for s in range(LANES):
        lit |= weights[place + s] != 0.0
    if not lit:
        return False
    c0, c1, c2 = cameras.center[k, 0], cameras.center[k, 1], cameras.center[k, 2]
    sun = cameras.sun[k, 0], cameras.sun[k, 1], cameras.sun[k, 2]
    for s in range(LANES):
        e, inverse = direction(c0 - w[s], c1 - w[LANES + s], c2 - w[2 * LANES + s])
        normal = w[_NORMAL * LANES + s], w[(_NORMAL + 1) * LANES + s], w[(_NORMAL + 2) * LANES + s]
        mu0, mu, cosine, sine = angles(sun, e, normal)
        for i in range(3):
            w[(_TO_CAMERA + i) * LANES + s] = e[i]
        w[_COSINE * LANES + s], w[_SINE * LANES + s] = cosine, sine
        w[_RHO * LANES + s], w[(_RHO + 1) * LANES + s] = mu0, mu
        w[_RANGE * LANES + s] = inverse
    for s in range(LANES):
        value = 0.0, 0.0, 0.0, 0.0
        if weights[place + s] != 0.0:
            phase = math.atan2(w[_SINE * LANES + s], w[_COSINE * LANES + s])
            value = photometric_function(packed, w[_RHO * LANES + s], w[(_RHO + 1) * LANES + s], phase)
        for i in range(4):
            w[(_RHO + i) * LANES + s] = value[i]
    return True


@njit(**COMPILED)
def _brightness_rows(k, place, lit, cameras, measured, w, rows):
    """Whitened photometric rows of a slot (factors.photometric, factors.direct); returns their cost."""
    if not lit:
        w[_B * LANES : (_RESIDUAL) * LANES] = 0.0
        w[_TURN * LANES : _COLUMNS * LANES] = 0.0
        w[(_RESIDUAL + 2) * LANES : (_RESIDUAL + 3) * LANES] = 0.0
        rows[3 * LANES :] = np.float32(0.0)
        return 0.0
    scale, bias = cameras.scale[k], cameras.bias[k]
    sun, b = (cameras.sun[k, 0], cameras.sun[k, 1], cameras.sun[k, 2]), cameras.sun_basis[k]
    sun_basis = b[0, 0], b[0, 1], b[1, 0], b[1, 1], b[2, 0], b[2, 1]
    weights, brightness = measured.brightness_weight[place : place + LANES], measured.brightness[place : place + LANES]
    along_x, along_y = measured.slope[0, place : place + LANES], measured.slope[1, place : place + LANES]
    intrinsics, rotation = view_numbers(k, cameras)
    fx, fy, cx, cy = intrinsics
    limit, total = measured.brightness_limit, 0.0
    for s in range(LANES):
        weight, rho, albedo = float(weights[s]), w[_RHO * LANES + s], w[_ALBEDO * LANES + s]
        inverse, x, y = w[_SEEN * LANES + s], w[(_SEEN + 1) * LANES + s], w[(_SEEN + 2) * LANES + s]
        gx, gy = float(along_x[s]), float(along_y[s])
        gain = scale * albedo
        residual = weight * (gain * rho + bias - brightness[s] - gx * (fx * x + cx) - gy * (fy * y + cy))
        cost, shrink = huber(abs(residual), limit)
        total += cost
        w[(_RESIDUAL + 2) * LANES + s] = residual * shrink
        weight *= shrink
        e = w[_TO_CAMERA * LANES + s], w[(_TO_CAMERA + 1) * LANES + s], w[(_TO_CAMERA + 2) * LANES + s]
        normal = w[_NORMAL * LANES + s], w[(_NORMAL + 1) * LANES + s], w[(_NORMAL + 2) * LANES + s]
        by_position, by_normal, by_sun, turn = brightness_by_vectors(
            weight * gain, w[(_RHO + 1) * LANES + s], w[(_RHO + 2) * LANES + s], w[(_RHO + 3) * LANES + s],
            w[_SINE * LANES + s], sun, e, normal, w[_RANGE * LANES + s],
        )  # fmt: skip
        by_x, by_y = pixel_by_position(intrinsics, rotation, weight * inverse, x, y)
        for i in range(3):
            w[(_B + i) * LANES + s] = by_position[i] - gx * by_x[i] - gy * by_y[i]
            w[(_TURN + i) * LANES + s] = turn[i]
        basis = (
            w[_BASIS * LANES + s], w[(_BASIS + 1) * LANES + s], w[(_BASIS + 2) * LANES + s],
            w[(_BASIS + 3) * LANES + s], w[(_BASIS + 4) * LANES + s], w[(_BASIS + 5) * LANES + s],
        )  # fmt: skip
        w[(_B + 3) * LANES + s], w[(_B + 4) * LANES + s] = along_basis(by_normal, basis)
        w[(_B + 5) * LANES + s] = weight * scale * rho
        w[_SUN * LANES + s], w[(_SUN + 1) * LANES + s] = along_basis(by_sun, sun_basis)
        w[_SCALE * LANES + s] = weight * albedo * rho
        w[_WEIGHT * LANES + s] = weight
        rows[10 * LANES + s] = weight * rho
        rows[11 * LANES + s] = weight
    for i in range(5):
        for s in range(LANES):
            rows[(3 + i) * LANES + s] = w[(_B + i) * LANES + s]
    for i in range(2):
        for s in range(LANES):
            rows[(8 + i) * LANES + s] = w[(_SUN + i) * LANES + s]
    for i in range(3):
        for s in range(LANES):
            rows[(12 + i) * LANES + s] = w[(_TURN + i) * LANES + s]
    return total


@njit(**COMPILED)
def observed_brightness(j, k, place, measured, cameras, landmarks):
    """The image's brightness where landmark j projects into view k (`Measurements`), for the observation at a place."""
    p, c = landmarks.position[j], cameras.center[k]
    intrinsics, rotation = view_numbers(k, cameras)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    _, x, y = project_point(r00, r01, r02, r10, r11, r12, r20, r21, r22, p[0] - c[0], p[1] - c[1], p[2] - c[2])
    gx, gy = float(measured.slope[0, place]), float(measured.slope[1, place])
    return (
        measured.brightness[place] + gx * (intrinsics[0] * x + intrinsics[2]) + gy * (intrinsics[1] * y + intrinsics[3])
    )


@njit(**COMPILED)
def _add_landmarks(w, out):
    """Adds a slot's share to its landmarks' gradients (6) and lower triangles (21), one landmark to a lane."""
    n = LANDMARK_SIZE
    for i in range(LANDMARK_SIZE):
        for s in range(LANES):
            out[i * LANES + s] += w[(_B + i) * LANES + s] * w[(_RESIDUAL + 2) * LANES + s]
        for m in range(i + 1):
            for s in range(LANES):
                out[n * LANES + s] += w[(_B + i) * LANES + s] * w[(_B + m) * LANES + s]
            if i < 3:
                for s in range(LANES):
                    out[n * LANES + s] += (
                        w[(_U + i) * LANES + s] * w[(_U + m) * LANES + s]
                        + w[(_V + i) * LANES + s] * w[(_V + m) * LANES + s]
                    )
            n += 1
        if i < 3:
            for s in range(LANES):
                out[i * LANES + s] += (
                    w[(_U + i) * LANES + s] * w[_RESIDUAL * LANES + s]
                    + w[(_V + i) * LANES + s] * w[(_RESIDUAL + 1) * LANES + s]
                )


@njit(**COMPILED)
def _scatter_landmarks(first, of_landmarks, block, gradient):
    """What `_add_landmarks` has summed, to the landmarks' blocks (J, 6, 6) and gradients (J, 6)."""
    for lane in range(min(LANES, gradient.shape[0] - first)):
        n = LANDMARK_SIZE
        for i in range(LANDMARK_SIZE):
            gradient[first + lane, i] = of_landmarks[i * LANES + lane]
            for m in range(i + 1):
                block[first + lane, i, m] = block[first + lane, m, i] = of_landmarks[n * LANES + lane]
                n += 1


@njit(**COMPILED)
def _camera_rows(pivot, w):
    """Rows by view, from the rows by landmark: with a the row by position, the row by shift is -a and the row by orbit
    a x arm from the pivot, force and torque. Of brightness, the reflectance sees the camera turn about the landmark,
    too."""
    q0, q1, q2 = pivot[0], pivot[1], pivot[2]
    for r in range(3):
        row, out = (_U + 3 * r) * LANES, (_COLUMNS + CAMERA_SIZE * r) * LANES
        for s in range(LANES):
            d0, d1, d2 = w[s] - q0, w[LANES + s] - q1, w[2 * LANES + s] - q2
            a0, a1, a2 = w[row + s], w[row + LANES + s], w[row + 2 * LANES + s]
            w[out + s] = a1 * d2 - a2 * d1
            w[out + LANES + s] = a2 * d0 - a0 * d2
            w[out + 2 * LANES + s] = a0 * d1 - a1 * d0
            w[out + 3 * LANES + s] = -a0
            w[out + 4 * LANES + s] = -a1
            w[out + 5 * LANES + s] = -a2
    out = (_COLUMNS + 2 * CAMERA_SIZE) * LANES
    for s in range(3 * LANES):
        w[out + s] += w[_TURN * LANES + s]
    for s in range(4 * LANES):
        w[out + 6 * LANES + s] = w[_SUN * LANES + s]


@njit(**COMPILED)
def _add_camera(w, block, gradient):
    """Adds a slot's share to its view's block (10, 10), lower triangle, and gradient (10,)."""
    u, v, b = _COLUMNS * LANES, (_COLUMNS + CAMERA_SIZE) * LANES, (_COLUMNS + 2 * CAMERA_SIZE) * LANES
    for i in range(CAMERA_SIZE):
        for m in range(i + 1):
            total = 0.0
            for s in range(LANES):
                total += w[b + i * LANES + s] * w[b + m * LANES + s]
            if i < 6:
                for s in range(LANES):
                    total += w[u + i * LANES + s] * w[u + m * LANES + s] + w[v + i * LANES + s] * w[v + m * LANES + s]
            block[i, m] += total
        total = 0.0
        for s in range(LANES):
            total += w[b + i * LANES + s] * w[(_RESIDUAL + 2) * LANES + s]
        if i < 6:
            for s in range(LANES):
                total += w[u + i * LANES + s] * w[_RESIDUAL * LANES + s]
                total += w[v + i * LANES + s] * w[(_RESIDUAL + 1) * LANES + s]
        gradient[i] += total
