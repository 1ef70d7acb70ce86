"""The product of the observations' part of the normal equations with a vector, from the rows that `linearize` stores.

The rows of keypoints by position are those of a pinhole camera, w / z f (R_x - x / z R_z) and likewise for y, so that
three numbers determine all six; columns by camera follow from the geometry, those by scale and albedo from weight and
rho.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.graph.layout import LANES
from photoclinometry.adjust.graph.rows import COMPILED
from photoclinometry.adjust.graph.slot import STORED, LandmarkState, ViewState
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE

_OF_VIEW = 22
"""Numbers of a view in a product: 12 of `RowOrigin.of_views`, 10 of the vector."""


class RowOrigin(NamedTuple):
    """Where the stored rows were made, in single precision; positions are from the pivot."""

    of_views: np.ndarray
    """(K, 12) rotation 9, focal lengths 2, scale 1."""
    of_landmarks: np.ndarray
    """(J, 4) position 3, albedo 1."""


def row_origin(view_state: ViewState, landmarks: LandmarkState, pivot: np.ndarray) -> RowOrigin:
    """pivot: (3,) as in `Estimate`."""
    rotation = view_state.rotation.reshape(-1, 9)
    of_views = np.column_stack([rotation, view_state.intrinsics[:, :2], view_state.scale])
    of_landmarks = np.column_stack([landmarks.position - pivot, landmarks.albedo])
    return RowOrigin(of_views.astype(np.float32), of_landmarks.astype(np.float32))


@njit(parallel=True, **COMPILED)
def multiply(layout, stored, where, view_in, landmark_in, view_out, landmark_out):
    """J^T J x for projection and brightness, matrix-free, one pass over the stored rows.

    where: `RowOrigin`; view_in: (K, 10), landmark_in: (J, 6), float32; view_out: (threads, K, 10) float64, summed
    over threads by the caller; landmark_out: (J, 6) float32.
    """
    parts = view_out.shape[0]
    for part in prange(parts):
        _multiply_part(part, parts, layout, stored, where, view_in, landmark_in, view_out[part], landmark_out)


@njit(**COMPILED)
def _multiply_part(part, parts, layout, stored, where, view_in, landmark_in, view_out, landmark_out):
    """`multiply` for one thread's share of the groups."""
    views, count = where.of_views.shape[0], where.of_landmarks.shape[0]
    of_view = np.zeros((views, _OF_VIEW), np.float32)
    for k in range(views):
        of_view[k, :12] = where.of_views[k]
        of_view[k, 12:] = view_in[k]
    view_out[:] = 0.0
    x = np.zeros(10 * LANES, np.float32)
    y = np.zeros(LANDMARK_SIZE * LANES, np.float32)
    groups = layout.slot_start.size - 1
    for group in range(part * groups // parts, (part + 1) * groups // parts):
        first = LANES * group
        for lane in range(LANES):
            j = min(first + lane, count - 1)
            for i in range(4):
                x[i * LANES + lane] = where.of_landmarks[j, i]
            for i in range(LANDMARK_SIZE):
                x[(4 + i) * LANES + lane] = landmark_in[j, i]
        y[:] = np.float32(0.0)
        for slot in range(layout.slot_start[group], layout.slot_start[group + 1]):
            k = layout.slot_view[slot]
            rows = stored[STORED * LANES * slot : STORED * LANES * (slot + 1)]
            t = _multiply_slot(rows, of_view[k], x, y)
            for i in range(VIEW_SIZE):
                view_out[k, i] += t[i]
        for lane in range(min(LANES, count - first)):
            for i in range(LANDMARK_SIZE):
                landmark_out[first + lane, i] = y[i * LANES + lane]
    for k in range(views):
        for i in range(3, 6):
            view_out[k, i] *= -1.0  # forces on the landmarks, against the camera's shift


@njit(**COMPILED)
def _multiply_slot(r, c, x, y):
    """J^T J x of one slot: adds to y by landmark, returns the view's orbit, force (the opposite of shift), Sun, scale
    and bias.

    r: stored rows; c: `RowOrigin.of_views` and the view's part of the vector; x: position, albedo, and the landmarks'
    part of the vector.
    """
    n = LANES
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8]
    fx, fy, scale, w0, w1, w2, t0, t1, t2 = c[9], c[10], c[11], c[12], c[13], c[14], c[15], c[16], c[17]
    sun0, sun1, by_scale, by_bias = c[18], c[19], c[20], c[21]
    o0 = o1 = o2 = f0s = f1s = f2s = b0 = b1 = b2 = b3 = np.float32(0.0)
    for s in range(LANES):
        p0, p1, p2, albedo = x[s], x[n + s], x[2 * n + s], x[3 * n + s]
        x0, x1, x2 = x[4 * n + s], x[5 * n + s], x[6 * n + s]
        # how the landmark moves as seen from the camera, in B and in C
        m0 = x0 - t0 + p1 * w2 - p2 * w1
        m1 = x1 - t1 + p2 * w0 - p0 * w2
        m2 = x2 - t2 + p0 * w1 - p1 * w0
        z = r02 * m0 + r12 * m1 + r22 * m2
        gx, gy = r[s] * fx, r[s] * fy
        u = gx * gx * (r00 * m0 + r10 * m1 + r20 * m2 - r[n + s] * z)
        v = gy * gy * (r01 * m0 + r11 * m1 + r21 * m2 - r[2 * n + s] * z)
        z = -(r[n + s] * u + r[2 * n + s] * v)
        b = r[3 * n + s] * m0 + r[4 * n + s] * m1 + r[5 * n + s] * m2
        b += r[12 * n + s] * w0 + r[13 * n + s] * w1 + r[14 * n + s] * w2
        b += r[6 * n + s] * x[7 * n + s] + r[7 * n + s] * x[8 * n + s]
        b += r[8 * n + s] * sun0 + r[9 * n + s] * sun1
        b += r[10 * n + s] * (scale * x[9 * n + s] + albedo * by_scale) + r[11 * n + s] * by_bias
        f0 = r00 * u + r01 * v + r02 * z + r[3 * n + s] * b
        f1 = r10 * u + r11 * v + r12 * z + r[4 * n + s] * b
        f2 = r20 * u + r21 * v + r22 * z + r[5 * n + s] * b
        y[s] += f0
        y[n + s] += f1
        y[2 * n + s] += f2
        y[3 * n + s] += r[6 * n + s] * b
        y[4 * n + s] += r[7 * n + s] * b
        y[5 * n + s] += r[10 * n + s] * scale * b
        o0 += f1 * p2 - f2 * p1 + r[12 * n + s] * b
        o1 += f2 * p0 - f0 * p2 + r[13 * n + s] * b
        o2 += f0 * p1 - f1 * p0 + r[14 * n + s] * b
        f0s, f1s, f2s = f0s + f0, f1s + f1, f2s + f2
        b0 += r[8 * n + s] * b
        b1 += r[9 * n + s] * b
        b2 += r[10 * n + s] * albedo * b
        b3 += r[11 * n + s] * b
    return o0, o1, o2, f0s, f1s, f2s, b0, b1, b2, b3
