"""The compiled inner loops of the joint estimate. `factors.py` says the same in plain NumPy.

Of each observation 16 single-precision numbers are kept (64 bytes): the rows of its whitened Jacobian by landmark, by
Sun, and its brightness weight. The columns by camera follow from the geometry. With a the row by position, the row by
shift is -a and the row by orbit a x arm: force and torque, where the arm from the pivot is the landmark's for
keypoints and the camera's for brightness. Residuals, gradients and diagonal blocks are in double precision; single
precision throughout was measured to be wrong (the cost was off by 2e-5).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.layout import LANES
from photoclinometry.reflectance import _PHASE_FLOOR, phase_angle, photometric_function

CAMERA_SIZE = 10
"""omega 3, tau 3, Sun 2, scale 1, bias 1."""
LANDMARK_SIZE = 6
"""position 3, normal 2, albedo 1."""
STORED = 16
"""u by position 0:3, v by position 3:6; brightness by position 6:9, normal 9:11, albedo 11, Sun 12:14, scale 14, and
its weight 15."""

_FAST: dict[str, Any] = dict(cache=True, fastmath={"contract", "reassoc", "nsz", "arcp"}, error_model="numpy")


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


@njit(**_FAST)
def _loss(squared, limit):
    """Huber's loss of a squared residual, and the factor that scales residual and Jacobian."""
    if squared <= limit * limit:
        return squared, 1.0
    root = math.sqrt(squared)
    return limit * (2.0 * root - limit), math.sqrt(limit / root)


@njit(**_FAST)
def _keypoint_rows(j, place, view, cameras, landmarks, measured, rows, residual):
    """Whitened projection rows of one landmark in all its slots (factors.projection); returns their cost."""
    rotation, center, intrinsics = cameras.rotation, cameras.center, cameras.intrinsics
    weights, keypoint, limit = measured.keypoint_weight, measured.keypoint, measured.keypoint_limit[j]
    p0, p1, p2 = landmarks.position[j, 0], landmarks.position[j, 1], landmarks.position[j, 2]
    total = 0.0
    for s in range(view.size):
        k = view[s]
        weight = float(weights[place + s])
        d0, d1, d2 = p0 - center[k, 0], p1 - center[k, 1], p2 - center[k, 2]
        inverse = 1.0 / (rotation[k, 0, 2] * d0 + rotation[k, 1, 2] * d1 + rotation[k, 2, 2] * d2)
        x = (rotation[k, 0, 0] * d0 + rotation[k, 1, 0] * d1 + rotation[k, 2, 0] * d2) * inverse
        y = (rotation[k, 0, 1] * d0 + rotation[k, 1, 1] * d1 + rotation[k, 2, 1] * d2) * inverse
        u = weight * (intrinsics[k, 0] * x + intrinsics[k, 2] - keypoint[0, place + s])
        v = weight * (intrinsics[k, 1] * y + intrinsics[k, 3] - keypoint[1, place + s])
        cost, shrink = _loss(u * u + v * v, limit)
        total += cost
        residual[0, s] = u * shrink
        residual[1, s] = v * shrink
        fx = weight * shrink * intrinsics[k, 0] * inverse
        fy = weight * shrink * intrinsics[k, 1] * inverse
        for i in range(3):
            rows[i, s] = fx * (rotation[k, i, 0] - x * rotation[k, i, 2])
            rows[3 + i, s] = fy * (rotation[k, i, 1] - y * rotation[k, i, 2])
    return total


@njit(**_FAST)
def _brightness_rows(j, place, view, packed, cameras, landmarks, measured, rows, residual):
    """Whitened photometric rows of one landmark in all its slots (factors.photometric); returns their cost."""
    center, sun, scale, bias, sun_basis = cameras.center, cameras.sun, cameras.scale, cameras.bias, cameras.sun_basis
    weights, brightness, limit = measured.brightness_weight, measured.brightness, measured.brightness_limit
    basis, albedo = landmarks.normal_basis, landmarks.albedo[j]
    p0, p1, p2 = landmarks.position[j, 0], landmarks.position[j, 1], landmarks.position[j, 2]
    n0, n1, n2 = landmarks.normal[j, 0], landmarks.normal[j, 1], landmarks.normal[j, 2]
    total = 0.0
    for s in range(view.size):
        k = view[s]
        weight = float(weights[place + s])
        if weight == 0.0:
            residual[2, s] = 0.0
            for i in range(6, STORED):
                rows[i, s] = 0.0
            continue
        e0, e1, e2 = center[k, 0] - p0, center[k, 1] - p1, center[k, 2] - p2
        inverse = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
        e0, e1, e2 = e0 * inverse, e1 * inverse, e2 * inverse
        s0, s1, s2 = sun[k, 0], sun[k, 1], sun[k, 2]
        c0, c1, c2 = s1 * e2 - s2 * e1, s2 * e0 - s0 * e2, s0 * e1 - s1 * e0
        sine = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
        phase = phase_angle(s0 * e0 + s1 * e1 + s2 * e2, sine)
        rho, by_mu0, by_mu, by_phase = photometric_function(
            packed, s0 * n0 + s1 * n1 + s2 * n2, e0 * n0 + e1 * n1 + e2 * n2, phase
        )
        gain = scale[k] * albedo
        r = weight * (gain * rho + bias[k] - brightness[place + s])
        cost, shrink = _loss(r * r, limit)
        total += cost
        residual[2, s] = r * shrink
        weight *= shrink
        m0, mu, ph = gain * weight * by_mu0, gain * weight * by_mu, gain * weight * by_phase / max(sine, _PHASE_FLOOR)
        g0, g1, g2 = mu * n0 - ph * s0, mu * n1 - ph * s1, mu * n2 - ph * s2
        along = g0 * e0 + g1 * e1 + g2 * e2
        rows[6, s] = -(g0 - along * e0) * inverse
        rows[7, s] = -(g1 - along * e1) * inverse
        rows[8, s] = -(g2 - along * e2) * inverse
        h0, h1, h2 = m0 * s0 + mu * e0, m0 * s1 + mu * e1, m0 * s2 + mu * e2
        t0, t1, t2 = m0 * n0 - ph * e0, m0 * n1 - ph * e1, m0 * n2 - ph * e2
        for i in range(2):
            rows[9 + i, s] = h0 * basis[j, 0, i] + h1 * basis[j, 1, i] + h2 * basis[j, 2, i]
            rows[12 + i, s] = t0 * sun_basis[k, 0, i] + t1 * sun_basis[k, 1, i] + t2 * sun_basis[k, 2, i]
        rows[11, s] = weight * scale[k] * rho
        rows[14, s] = weight * albedo * rho
        rows[15, s] = weight
    return total


@njit(**_FAST)
def _add_landmark(rows, residual, slots, block, gradient):
    """One landmark's diagonal block (6, 6) and gradient (6,), summed over its slots."""
    for i in range(LANDMARK_SIZE):
        total = 0.0
        if i < 3:
            for s in range(slots):
                total += rows[i, s] * residual[0, s] + rows[3 + i, s] * residual[1, s]
        for s in range(slots):
            total += rows[6 + i, s] * residual[2, s]
        gradient[i] = total
        for m in range(i + 1):
            total = 0.0
            if i < 3:
                for s in range(slots):
                    total += rows[i, s] * rows[m, s] + rows[3 + i, s] * rows[3 + m, s]
            for s in range(slots):
                total += rows[6 + i, s] * rows[6 + m, s]
            block[i, m] = total
            block[m, i] = total


@njit(**_FAST)
def _camera_rows(j, slots, centers, pivot, position, rows, columns):
    """Rows by camera, (row, column, slot), from the rows by landmark. centers (3, slots) are from the pivot."""
    d0, d1, d2 = position[j, 0] - pivot[0], position[j, 1] - pivot[1], position[j, 2] - pivot[2]
    for r in range(3):
        for s in range(slots):
            if r == 2:
                d0, d1, d2 = centers[0, s], centers[1, s], centers[2, s]
            a0, a1, a2 = rows[3 * r, s], rows[3 * r + 1, s], rows[3 * r + 2, s]
            columns[r, 0, s] = a1 * d2 - a2 * d1
            columns[r, 1, s] = a2 * d0 - a0 * d2
            columns[r, 2, s] = a0 * d1 - a1 * d0
            columns[r, 3, s], columns[r, 4, s], columns[r, 5, s] = -a0, -a1, -a2
    for s in range(slots):
        columns[2, 6, s], columns[2, 7, s] = rows[12, s], rows[13, s]
        columns[2, 8, s], columns[2, 9, s] = rows[14, s], rows[15, s]


@njit(**_FAST)
def _add_cameras(columns, residual, slots, block, gradient):
    """Adds one landmark's share to the slots' camera blocks (10, 10, slots) and gradients (10, slots)."""
    for c in range(CAMERA_SIZE):
        if c < 6:
            for s in range(slots):
                gradient[c, s] += columns[0, c, s] * residual[0, s] + columns[1, c, s] * residual[1, s]
            for m in range(c + 1):
                for s in range(slots):
                    block[c, m, s] += columns[0, c, s] * columns[0, m, s] + columns[1, c, s] * columns[1, m, s]
        for s in range(slots):
            gradient[c, s] += columns[2, c, s] * residual[2, s]
        for m in range(c + 1):
            for s in range(slots):
                block[c, m, s] += columns[2, c, s] * columns[2, m, s]


@njit(**_FAST)
def _widest(layout):
    """The largest number of slots of any block."""
    widest = 0
    for b in range(layout.landmark_start.size - 1):
        widest = max(widest, layout.slot_start[b + 1] - layout.slot_start[b])
    return widest


@njit(**_FAST)
def _linearize_part(part, parts, layout, measured, cameras, landmarks, pivot, packed, with_jacobian, stored, normal):
    """`linearize` for one thread's share of the blocks."""
    widest = _widest(layout)
    rows = np.zeros((STORED, widest))
    residual = np.zeros((3, widest))
    columns = np.zeros((3, CAMERA_SIZE, widest))
    centers = np.zeros((3, widest))
    camera_block = np.zeros((CAMERA_SIZE, CAMERA_SIZE, widest))
    camera_gradient = np.zeros((CAMERA_SIZE, widest))
    normal.camera_block[part] = 0.0
    normal.camera_gradient[part] = 0.0
    keypoint_cost = brightness_cost = 0.0
    blocks = layout.landmark_start.size - 1
    for b in range(part * blocks // parts, (part + 1) * blocks // parts):
        slots = layout.slot_start[b + 1] - layout.slot_start[b]
        view = layout.slot_view[layout.slot_start[b] : layout.slot_start[b + 1]]
        first = layout.landmark_start[b]
        camera_block[:] = 0.0
        camera_gradient[:] = 0.0
        for s in range(slots):
            for i in range(3):
                centers[i, s] = cameras.center[view[s], i] - pivot[i]
        for j in range(first, layout.landmark_start[b + 1]):
            place = layout.place_start[b] + (j - first) * slots
            keypoint_cost += _keypoint_rows(j, place, view, cameras, landmarks, measured, rows, residual)
            brightness_cost += _brightness_rows(j, place, view, packed, cameras, landmarks, measured, rows, residual)
            if with_jacobian:
                _add_landmark(rows, residual, slots, normal.landmark_block[j], normal.landmark_gradient[j])
                _camera_rows(j, slots, centers, pivot, landmarks.position, rows, columns)
                _add_cameras(columns, residual, slots, camera_block, camera_gradient)
                for g in range(slots // LANES):
                    base = STORED * (place + LANES * g)
                    for i in range(STORED):
                        for lane in range(LANES):
                            stored[base + LANES * i + lane] = rows[i, LANES * g + lane]
        if with_jacobian:
            for s in range(slots):
                for c in range(CAMERA_SIZE):
                    normal.camera_gradient[part, view[s], c] += camera_gradient[c, s]
                    for m in range(c + 1):
                        normal.camera_block[part, view[s], c, m] += camera_block[c, m, s]
    normal.cost[part, 0] = keypoint_cost
    normal.cost[part, 1] = brightness_cost


@njit(parallel=True, **_FAST)
def linearize(layout, measured, cameras, landmarks, pivot, packed, with_jacobian, stored, normal):
    """Cost of projection and brightness and, if asked, their Jacobian (`stored`) and normal equations.

    pivot: (3,) as in `Estimate`. packed: `Reflectance.packed`.
    stored: (16 P,) float32, for every eight places the 16 rows of eight numbers. normal: `Normal`, overwritten.
    """
    parts = normal.cost.shape[0]
    for part in prange(parts):
        _linearize_part(part, parts, layout, measured, cameras, landmarks, pivot, packed, with_jacobian, stored, normal)


@njit(**_FAST)
def _gather(view, center, camera_in, out):
    """Per group of lanes: orbit 0:3, shift 3:6, Sun 6:8, scale 8, bias 9, and how the camera itself moves 10:13."""
    for s in range(view.size):
        k, g, lane = view[s], s // LANES, s % LANES
        for i in range(CAMERA_SIZE):
            out[g, i, lane] = camera_in[k, i]
        c0, c1, c2 = center[k, 0], center[k, 1], center[k, 2]
        w0, w1, w2 = camera_in[k, 0], camera_in[k, 1], camera_in[k, 2]
        out[g, 10, lane] = camera_in[k, 3] + w1 * c2 - w2 * c1
        out[g, 11, lane] = camera_in[k, 4] + w2 * c0 - w0 * c2
        out[g, 12, lane] = camera_in[k, 5] + w0 * c1 - w1 * c0


@njit(**_FAST)
def _scatter(view, center, back, out):
    """The transpose of `_gather`, added to out (K, 10)."""
    for s in range(view.size):
        k, g, lane = view[s], s // LANES, s % LANES
        c0, c1, c2 = center[k, 0], center[k, 1], center[k, 2]
        h0, h1, h2 = back[g, 10, lane], back[g, 11, lane], back[g, 12, lane]
        out[k, 0] += back[g, 0, lane] + (h1 * c2 - h2 * c1)
        out[k, 1] += back[g, 1, lane] + (h2 * c0 - h0 * c2)
        out[k, 2] += back[g, 2, lane] + (h0 * c1 - h1 * c0)
        out[k, 3] -= back[g, 3, lane] + h0
        out[k, 4] -= back[g, 4, lane] + h1
        out[k, 5] -= back[g, 5, lane] + h2
        for i in range(6, CAMERA_SIZE):
            out[k, i] += back[g, i, lane]


@njit(**_FAST)
def _multiply_group(r, c, back, p0, p1, p2, x0, x1, x2, x3, x4, x5):
    """J^T J x of one landmark and LANES slots: returns its part by landmark, adds to `back` by camera.

    r: (16 * LANES,) stored rows; c, back: (13 * LANES,) as in `_gather`; p: position from the pivot. One straight loop
    at fixed strides, which compiles to vector instructions.
    """
    y0 = y1 = y2 = y3 = y4 = y5 = np.float32(0.0)
    for s in range(LANES):
        # how the landmark moves as seen from the camera
        m0 = x0 - c[3 * LANES + s] + p1 * c[2 * LANES + s] - p2 * c[LANES + s]
        m1 = x1 - c[4 * LANES + s] + p2 * c[s] - p0 * c[2 * LANES + s]
        m2 = x2 - c[5 * LANES + s] + p0 * c[LANES + s] - p1 * c[s]
        u = r[s] * m0 + r[LANES + s] * m1 + r[2 * LANES + s] * m2
        v = r[3 * LANES + s] * m0 + r[4 * LANES + s] * m1 + r[5 * LANES + s] * m2
        b = (
            r[6 * LANES + s] * (x0 - c[10 * LANES + s])
            + r[7 * LANES + s] * (x1 - c[11 * LANES + s])
            + r[8 * LANES + s] * (x2 - c[12 * LANES + s])
        )
        b += r[9 * LANES + s] * x3 + r[10 * LANES + s] * x4 + r[11 * LANES + s] * x5
        b += (
            r[12 * LANES + s] * c[6 * LANES + s]
            + r[13 * LANES + s] * c[7 * LANES + s]
            + r[14 * LANES + s] * c[8 * LANES + s]
            + r[15 * LANES + s] * c[9 * LANES + s]
        )
        f0 = r[s] * u + r[3 * LANES + s] * v
        f1 = r[LANES + s] * u + r[4 * LANES + s] * v
        f2 = r[2 * LANES + s] * u + r[5 * LANES + s] * v
        h0, h1, h2 = r[6 * LANES + s] * b, r[7 * LANES + s] * b, r[8 * LANES + s] * b
        y0 += f0 + h0
        y1 += f1 + h1
        y2 += f2 + h2
        y3 += r[9 * LANES + s] * b
        y4 += r[10 * LANES + s] * b
        y5 += r[11 * LANES + s] * b
        back[s] += f1 * p2 - f2 * p1
        back[LANES + s] += f2 * p0 - f0 * p2
        back[2 * LANES + s] += f0 * p1 - f1 * p0
        back[3 * LANES + s] += f0
        back[4 * LANES + s] += f1
        back[5 * LANES + s] += f2
        back[6 * LANES + s] += r[12 * LANES + s] * b
        back[7 * LANES + s] += r[13 * LANES + s] * b
        back[8 * LANES + s] += r[14 * LANES + s] * b
        back[9 * LANES + s] += r[15 * LANES + s] * b
        back[10 * LANES + s] += h0
        back[11 * LANES + s] += h1
        back[12 * LANES + s] += h2
    return y0, y1, y2, y3, y4, y5


@njit(**_FAST)
def _multiply_part(part, parts, layout, stored, position, center, camera_in, landmark_in, camera_out, landmark_out):
    """`multiply` for one thread's share of the blocks."""
    blocks = layout.landmark_start.size - 1
    camera = np.zeros((_widest(layout) // LANES, 13, LANES), np.float32)
    back = np.zeros_like(camera)
    camera_out[part] = 0.0
    for b in range(part * blocks // parts, (part + 1) * blocks // parts):
        view = layout.slot_view[layout.slot_start[b] : layout.slot_start[b + 1]]
        first = layout.landmark_start[b]
        _gather(view, center, camera_in, camera)
        back[:] = np.float32(0.0)
        for j in range(first, layout.landmark_start[b + 1]):
            base = STORED * (layout.place_start[b] + (j - first) * view.size)
            p, x, y = position[j], landmark_in[j], landmark_out[j]
            y[:] = np.float32(0.0)
            for g in range(view.size // LANES):
                r = stored[base + STORED * LANES * g : base + STORED * LANES * (g + 1)]
                t = _multiply_group(
                    r, camera[g].ravel(), back[g].ravel(), p[0], p[1], p[2], x[0], x[1], x[2], x[3], x[4], x[5]
                )
                for i in range(LANDMARK_SIZE):
                    y[i] += t[i]
        _scatter(view, center, back, camera_out[part])


@njit(parallel=True, **_FAST)
def multiply(layout, stored, position, center, camera_in, landmark_in, camera_out, landmark_out):
    """J^T J x for projection and brightness, matrix-free, one pass over the stored rows.

    position: (J, 3), center: (K, 3), both from the pivot, camera_in: (K, 10), landmark_in: (J, 6), all float32;
    camera_out: (threads, K, 10) float64, summed over threads by the caller; landmark_out: (J, 6) float32.
    """
    parts = camera_out.shape[0]
    for part in prange(parts):
        _multiply_part(part, parts, layout, stored, position, center, camera_in, landmark_in, camera_out, landmark_out)
