"""One slot: the rows of a view and the sixteen landmarks of a group. `rows.py` states a row, `factors.py` in NumPy.

What belongs to the view is one number for all lanes; what belongs to a landmark or an observation is a row of sixteen
numbers, kept in a flat scratch array `w` so that each loop is one straight run of vector instructions. All is in double
precision here; the rows of the Jacobian are kept in single precision for `product.multiply` (single precision
throughout was measured to be wrong: the cost was off by 2e-5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

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
from photoclinometry.adjust.graph.variables import VIEW_SIZE
from photoclinometry.model.projection import project_point
from photoclinometry.model.reflectance import continued_function, continued_parameters

STORED = 15
"""Rows kept of each slot. Of keypoints, 0: weight over depth, 1, 2: x / z and y / z. Of brightness, 3:6 by position,
6:8 by normal, 8:10 by Sun, 10: weight times rho, 11: weight, 12:15 by orbit, beyond what follows from 3:6."""

# Rows of the scratch array: what is known of the landmarks,
_POSITION, _NORMAL, _BASIS, _ALBEDO, _LIMIT = 0, 3, 6, 12, 13
# the rows of the Jacobian by landmark: keypoint's x and y by position, brightness by all six,
BY_X, BY_Y, BY_LANDMARK = 14, 17, 20
# brightness by Sun and scale, its weight, and the three residuals,
_SUN, _SCALE, _WEIGHT, RESIDUAL = 26, 28, 29, 30
_TO_CAMERA, _COSINE, _SINE, _RHO, _RANGE = 33, 36, 37, 38, 42
_SEEN, _TURN, _ANGLES = 43, 46, 49
# the cost of keypoint and brightness, and the rows by view: ten of x, y and brightness each, beside each other.
COST, BY_VIEW, SCRATCH = 52, 53, 53 + 3 * VIEW_SIZE


class ViewState(NamedTuple):
    """The parts of K views that the kernels need."""

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
    """The parts of J landmarks that the kernels need."""

    position: np.ndarray
    """(J, 3) in B."""
    normal: np.ndarray
    """(J, 3)."""
    normal_basis: np.ndarray
    """(J, 3, 2) tangent basis of `normal`."""
    albedo: np.ndarray


@njit(**COMPILED)
def gather_landmarks(first, landmarks, limit, w):
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
def keypoint_rows(k, place, view_state, measured, w, rows):
    """Whitened projection rows of a slot (factors.projection); returns their cost."""
    c0, c1, c2 = view_state.center[k, 0], view_state.center[k, 1], view_state.center[k, 2]
    intrinsics, rotation = view_numbers(k, view_state)
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
        w[COST * LANES + s] = cost
        w[RESIDUAL * LANES + s] = u * shrink
        w[(RESIDUAL + 1) * LANES + s] = v * shrink
        weight *= shrink
        rows[s], rows[LANES + s], rows[2 * LANES + s] = weight * inverse, x, y
        by_x, by_y = pixel_by_position(intrinsics, rotation, weight * inverse, x, y)
        for i in range(3):
            w[(BY_X + i) * LANES + s] = by_x[i]
            w[(BY_Y + i) * LANES + s] = by_y[i]
    return total


@njit(**COMPILED)
def brightness_geometry(k, place, view_state, weights, parameter_vector, w):
    """Directions to the camera, rho and its three derivatives in a slot; returns whether any brightness counts."""
    lit = False
    for s in range(LANES):
        lit |= weights[place + s] != 0.0
    if not lit:
        return False
    c0, c1, c2 = view_state.center[k, 0], view_state.center[k, 1], view_state.center[k, 2]
    sun = view_state.sun[k, 0], view_state.sun[k, 1], view_state.sun[k, 2]
    for s in range(LANES):
        e, inverse = direction(c0 - w[s], c1 - w[LANES + s], c2 - w[2 * LANES + s])
        normal = w[_NORMAL * LANES + s], w[(_NORMAL + 1) * LANES + s], w[(_NORMAL + 2) * LANES + s]
        mu0, mu, cosine, sine = angles(sun, e, normal)
        for i in range(3):
            w[(_TO_CAMERA + i) * LANES + s] = e[i]
        w[_COSINE * LANES + s], w[_SINE * LANES + s] = cosine, sine
        w[_ANGLES * LANES + s], w[(_ANGLES + 1) * LANES + s] = mu0, mu
        w[_RANGE * LANES + s] = inverse
    for s in range(LANES):
        value = 0.0, 0.0, 0.0, 0.0
        if weights[place + s] != 0.0:
            phase = math.atan2(w[_SINE * LANES + s], w[_COSINE * LANES + s])
            w[(_ANGLES + 2) * LANES + s] = phase
            value = continued_function(parameter_vector, w[_ANGLES * LANES + s], w[(_ANGLES + 1) * LANES + s], phase)
        for i in range(4):
            w[(_RHO + i) * LANES + s] = value[i]
    return True


@njit(**COMPILED)
def brightness_rows(k, place, lit, view_state, measured, w, rows):
    """Whitened photometric rows of a slot (factors.photometric, factors.direct); returns their cost."""
    if not lit:
        w[BY_LANDMARK * LANES : (RESIDUAL) * LANES] = 0.0
        w[_TURN * LANES : _ANGLES * LANES] = 0.0
        w[(RESIDUAL + 2) * LANES : (RESIDUAL + 3) * LANES] = 0.0
        rows[3 * LANES :] = np.float32(0.0)
        return 0.0
    scale, bias = view_state.scale[k], view_state.bias[k]
    sun, b = (view_state.sun[k, 0], view_state.sun[k, 1], view_state.sun[k, 2]), view_state.sun_basis[k]
    sun_basis = b[0, 0], b[0, 1], b[1, 0], b[1, 1], b[2, 0], b[2, 1]
    weights, brightness = measured.brightness_weight[place : place + LANES], measured.brightness[place : place + LANES]
    along_x, along_y = measured.gradient[0, place : place + LANES], measured.gradient[1, place : place + LANES]
    intrinsics, rotation = view_numbers(k, view_state)
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
        w[COST * LANES + s] += cost
        w[(RESIDUAL + 2) * LANES + s] = residual * shrink
        weight *= shrink
        e = w[_TO_CAMERA * LANES + s], w[(_TO_CAMERA + 1) * LANES + s], w[(_TO_CAMERA + 2) * LANES + s]
        normal = w[_NORMAL * LANES + s], w[(_NORMAL + 1) * LANES + s], w[(_NORMAL + 2) * LANES + s]
        by_position, by_normal, by_sun, turn = brightness_by_vectors(
            weight * gain, w[(_RHO + 1) * LANES + s], w[(_RHO + 2) * LANES + s], w[(_RHO + 3) * LANES + s],
            w[_SINE * LANES + s], sun, e, normal, w[_RANGE * LANES + s],
        )  # fmt: skip
        by_x, by_y = pixel_by_position(intrinsics, rotation, weight * inverse, x, y)
        for i in range(3):
            w[(BY_LANDMARK + i) * LANES + s] = by_position[i] - gx * by_x[i] - gy * by_y[i]
            w[(_TURN + i) * LANES + s] = turn[i]
        basis = (
            w[_BASIS * LANES + s], w[(_BASIS + 1) * LANES + s], w[(_BASIS + 2) * LANES + s],
            w[(_BASIS + 3) * LANES + s], w[(_BASIS + 4) * LANES + s], w[(_BASIS + 5) * LANES + s],
        )  # fmt: skip
        w[(BY_LANDMARK + 3) * LANES + s], w[(BY_LANDMARK + 4) * LANES + s] = along_basis(by_normal, basis)
        w[(BY_LANDMARK + 5) * LANES + s] = weight * scale * rho
        w[_SUN * LANES + s], w[(_SUN + 1) * LANES + s] = along_basis(by_sun, sun_basis)
        w[_SCALE * LANES + s] = weight * albedo * rho
        w[_WEIGHT * LANES + s] = weight
        rows[10 * LANES + s] = weight * rho
        rows[11 * LANES + s] = weight
    for i in range(5):
        for s in range(LANES):
            rows[(3 + i) * LANES + s] = w[(BY_LANDMARK + i) * LANES + s]
    for i in range(2):
        for s in range(LANES):
            rows[(8 + i) * LANES + s] = w[(_SUN + i) * LANES + s]
    for i in range(3):
        for s in range(LANES):
            rows[(12 + i) * LANES + s] = w[(_TURN + i) * LANES + s]
    return total


@njit(**COMPILED)
def view_rows(pivot, w):
    """Rows by view, from the rows by landmark: with a the row by position, the row by shift is -a and the row by orbit
    a x arm from the pivot, force and torque. For brightness, the reflectance also depends on the camera's turn about
    the landmark."""
    q0, q1, q2 = pivot[0], pivot[1], pivot[2]
    for r in range(3):
        row, out = (BY_X + 3 * r) * LANES, (BY_VIEW + r) * LANES
        for s in range(LANES):
            d0, d1, d2 = w[s] - q0, w[LANES + s] - q1, w[2 * LANES + s] - q2
            a0, a1, a2 = w[row + s], w[row + LANES + s], w[row + 2 * LANES + s]
            w[out + s] = a1 * d2 - a2 * d1
            w[out + 3 * LANES + s] = a2 * d0 - a0 * d2
            w[out + 6 * LANES + s] = a0 * d1 - a1 * d0
            w[out + 9 * LANES + s] = -a0
            w[out + 12 * LANES + s] = -a1
            w[out + 15 * LANES + s] = -a2
    for i in range(3):
        for s in range(LANES):
            w[(BY_VIEW + 3 * i + 2) * LANES + s] += w[(_TURN + i) * LANES + s]
    for i in range(4):
        for s in range(LANES):
            w[(BY_VIEW + 3 * (6 + i) + 2) * LANES + s] = w[(_SUN + i) * LANES + s]


@njit(**COMPILED)
def of_pixel_and_brightness(w, i):
    """The rows by coordinate i of the view, of x, y and brightness, one after the other (48,); Suns, scale and bias
    (6 and up) have none but that of brightness."""
    return w[(BY_VIEW + 3 * i) * LANES : (BY_VIEW + 3 * i + 3) * LANES]


@njit(**COMPILED)
def of_brightness(w, i):
    """The row of brightness by coordinate i of the view (16,)."""
    return w[(BY_VIEW + 3 * i + 2) * LANES : (BY_VIEW + 3 * i + 3) * LANES]


@njit(**COMPILED)
def dot(a, b):
    """Sum of products. LLVM unrolls loops of sixteen turns before it can vectorise a sum. It vectorises sums over
    arrays, whose length it does not know, which takes half the time."""
    total = 0.0
    for s in range(a.size):
        total += a[s] * b[s]
    return total


@njit(**COMPILED)
def parameter_rows(scale, parameter_vector, unit, w, row, out):
    """Whitened derivatives of a lit slot's brightness by T reflectance parameters into out (16 T,).

    parameter_vector: `Reflectance.parameter_vector`; unit: (T,) in which each parameter changes; row: (T,) scratch.
    """
    for s in range(LANES):
        gain = w[_WEIGHT * LANES + s] * scale * w[_ALBEDO * LANES + s]
        row[:] = 0.0
        if gain != 0.0:
            mu0, mu, phase = w[_ANGLES * LANES + s], w[(_ANGLES + 1) * LANES + s], w[(_ANGLES + 2) * LANES + s]
            continued_parameters(parameter_vector, mu0, mu, phase, row)
        for t in range(unit.size):
            out[t * LANES + s] = gain * unit[t] * row[t]
