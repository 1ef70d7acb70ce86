"""The compiled pass over keypoints and brightness: cost, rows and normal equations.

Everything is done for one slot at a time: a view and the sixteen landmarks of a group (see `layout`). `slot.py` makes
its rows, here they are summed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.graph.layout import LANES
from photoclinometry.adjust.graph.rows import COMPILED
from photoclinometry.adjust.graph.slot import (
    BY_LANDMARK,
    BY_X,
    BY_Y,
    COST,
    RESIDUAL,
    SCRATCH,
    STORED,
    brightness_geometry,
    brightness_rows,
    dot,
    gather_landmarks,
    keypoint_rows,
    of_brightness,
    of_pixel_and_brightness,
    parameter_rows,
    view_rows,
)
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE

_BLOCK_SIZE = LANDMARK_SIZE * (LANDMARK_SIZE + 1) // 2 + LANDMARK_SIZE


class Normal(NamedTuple):
    """Gradient and diagonal blocks of the normal equations, filled by `linearize`."""

    landmark_block: np.ndarray
    """(J, 6, 6)."""
    landmark_gradient: np.ndarray
    """(J, 6)."""
    view_block: np.ndarray
    """(threads, K, 10, 10), lower triangles, summed over the first axis by the caller."""
    view_gradient: np.ndarray
    """(threads, K, 10), likewise."""
    by_parameter: np.ndarray
    """(J, 6, T) float32, landmarks with reflectance parameters."""
    view_by_parameter: np.ndarray
    """(threads, K, T, 10), views with reflectance parameters, summed over the first axis by the caller."""
    parameter_block: np.ndarray
    """(threads, T, T), lower triangles, likewise."""
    parameter_gradient: np.ndarray
    """(threads, T), likewise."""
    cost: np.ndarray
    """(threads, 2): squared whitened residuals of keypoints and of brightness, after the loss."""
    landmark_cost: np.ndarray
    """(J,) both of each landmark; (0,) where nobody asks."""


@njit(parallel=True, **COMPILED)
def linearize(layout, measured, view_state, landmarks, pivot, parameter_vector, unit, with_jacobian, stored, normal):
    """Cost of keypoints and brightness and, if asked, their Jacobian (`stored`) and normal equations.

    pivot: (3,) as in `Estimate`. parameter_vector: `Reflectance.parameter_vector`; unit: (T,) in which each parameter
    that is estimated changes.
    stored: (STORED P,) float32, filled with the rows of sixteen of every slot if asked. normal: `Normal`, overwritten.
    """
    parts = normal.cost.shape[0]
    for part in prange(parts):
        _linearize_part(
            part,
            parts,
            layout,
            measured,
            view_state,
            landmarks,
            pivot,
            parameter_vector,
            unit,
            with_jacobian,
            stored,
            normal,
        )


@njit(**COMPILED)
def _linearize_part(
    part, parts, layout, measured, view_state, landmarks, pivot, parameter_vector, unit, with_jacobian, stored, normal
):
    """`linearize` for one thread's share of the groups."""
    w, scratch = np.zeros(SCRATCH * LANES), np.zeros(STORED * LANES, np.float32)
    of_landmarks, row, by_parameter = np.zeros(_BLOCK_SIZE * LANES), np.zeros(unit.size), np.zeros(unit.size * LANES)
    with_parameters, cost = np.zeros(unit.size * LANDMARK_SIZE * LANES), np.zeros(LANES)
    normal.view_block[part] = 0.0
    normal.view_gradient[part] = 0.0
    normal.view_by_parameter[part] = 0.0
    normal.parameter_block[part] = 0.0
    normal.parameter_gradient[part] = 0.0
    keypoint_cost = brightness_cost = 0.0
    groups = layout.slot_start.size - 1
    for group in range(part * groups // parts, (part + 1) * groups // parts):
        gather_landmarks(LANES * group, landmarks, measured.keypoint_limit, w)
        of_landmarks[:] = 0.0
        with_parameters[:] = 0.0
        cost[:] = 0.0
        for slot in range(layout.slot_start[group], layout.slot_start[group + 1]):
            k, place = layout.slot_view[slot], LANES * slot
            rows = stored[STORED * place : STORED * (place + LANES)] if with_jacobian else scratch
            keypoint_cost += keypoint_rows(k, place, view_state, measured, w, rows)
            lit = brightness_geometry(k, place, view_state, measured.brightness_weight, parameter_vector, w)
            brightness_cost += brightness_rows(k, place, lit, view_state, measured, w, rows)
            for s in range(LANES):
                cost[s] += w[COST * LANES + s]
            if with_jacobian:
                _add_landmarks(w, of_landmarks)
                view_rows(pivot, w)
                _add_view(w, normal.view_block[part, k], normal.view_gradient[part, k])
                if unit.size and lit:
                    parameter_rows(view_state.scale[k], parameter_vector, unit, w, row, by_parameter)
                    _add_parameters(
                        w, by_parameter, with_parameters, normal.view_by_parameter[part, k],
                        normal.parameter_block[part], normal.parameter_gradient[part],
                    )  # fmt: skip
        for lane in range(min(LANES, normal.landmark_cost.size - LANES * group)):
            normal.landmark_cost[LANES * group + lane] = cost[lane]
        if with_jacobian:
            _scatter_landmarks(LANES * group, of_landmarks, normal.landmark_block, normal.landmark_gradient)
            _scatter_parameters(LANES * group, with_parameters, normal.by_parameter)
    normal.cost[part, 0] = keypoint_cost
    normal.cost[part, 1] = brightness_cost


@njit(**COMPILED)
def _add_landmarks(w, out):
    """Adds a slot's share to its landmarks' gradients (6) and lower triangles (21), one landmark to a lane."""
    n = LANDMARK_SIZE
    for i in range(LANDMARK_SIZE):
        for s in range(LANES):
            out[i * LANES + s] += w[(BY_LANDMARK + i) * LANES + s] * w[(RESIDUAL + 2) * LANES + s]
        for m in range(i + 1):
            for s in range(LANES):
                out[n * LANES + s] += w[(BY_LANDMARK + i) * LANES + s] * w[(BY_LANDMARK + m) * LANES + s]
            if i < 3:
                for s in range(LANES):
                    out[n * LANES + s] += (
                        w[(BY_X + i) * LANES + s] * w[(BY_X + m) * LANES + s]
                        + w[(BY_Y + i) * LANES + s] * w[(BY_Y + m) * LANES + s]
                    )
            n += 1
        if i < 3:
            for s in range(LANES):
                out[i * LANES + s] += (
                    w[(BY_X + i) * LANES + s] * w[RESIDUAL * LANES + s]
                    + w[(BY_Y + i) * LANES + s] * w[(RESIDUAL + 1) * LANES + s]
                )


@njit(**COMPILED)
def _scatter_landmarks(first, of_landmarks, block, gradient):
    """Copies the sums of `_add_landmarks` to the landmarks' blocks (J, 6, 6) and gradients (J, 6)."""
    for lane in range(min(LANES, gradient.shape[0] - first)):
        n = LANDMARK_SIZE
        for i in range(LANDMARK_SIZE):
            gradient[first + lane, i] = of_landmarks[i * LANES + lane]
            for m in range(i + 1):
                block[first + lane, i, m] = block[first + lane, m, i] = of_landmarks[n * LANES + lane]
                n += 1


@njit(**COMPILED)
def _add_view(w, block, gradient):
    """Adds a slot's share to its view's block (10, 10), lower triangle, and gradient (10,)."""
    residuals = w[RESIDUAL * LANES : (RESIDUAL + 3) * LANES]
    residual = residuals[2 * LANES :]  # of brightness
    for i in range(6):
        row = of_pixel_and_brightness(w, i)
        for m in range(i + 1):
            block[i, m] += dot(row, of_pixel_and_brightness(w, m))
        gradient[i] += dot(row, residuals)
    for i in range(6, VIEW_SIZE):
        row = of_brightness(w, i)
        for m in range(i + 1):
            block[i, m] += dot(row, of_brightness(w, m))
        gradient[i] += dot(row, residual)


@njit(**COMPILED)
def _add_parameters(w, rows, of_landmarks, of_view, block, gradient):
    """Adds a slot's products with its rows by T parameters (16 T,): to its landmarks' (6 T rows of sixteen), its view's
    (T, 10), and the parameters' own block (T, T), lower triangle, and gradient (T,)."""
    out, residual = 0, w[(RESIDUAL + 2) * LANES : (RESIDUAL + 3) * LANES]
    for t in range(gradient.size):
        row = rows[t * LANES : (t + 1) * LANES]
        for i in range(LANDMARK_SIZE):
            for s in range(LANES):
                of_landmarks[out + s] += w[(BY_LANDMARK + i) * LANES + s] * row[s]
            out += LANES
        for i in range(VIEW_SIZE):
            of_view[t, i] += dot(row, of_brightness(w, i))
        for u in range(t + 1):
            block[t, u] += dot(row, rows[u * LANES : (u + 1) * LANES])
        gradient[t] += dot(row, residual)


@njit(**COMPILED)
def _scatter_parameters(first, of_landmarks, by_parameter):
    """Copies the landmarks' sums of `_add_parameters` to (J, 6, T)."""
    for lane in range(min(LANES, by_parameter.shape[0] - first)):
        for t in range(by_parameter.shape[2]):
            for i in range(LANDMARK_SIZE):
                by_parameter[first + lane, i, t] = of_landmarks[(LANDMARK_SIZE * t + i) * LANES + lane]
