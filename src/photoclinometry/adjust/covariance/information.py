"""The information matrix J^T J of the joint estimate, in double precision, for any run of landmarks.

The solver never forms it. The covariances need it, a patch of the map at a time: each landmark's own block, its
coupling with the views that see it, and its contribution to those views' blocks. `graph.rows` states the rows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from photoclinometry.adjust.graph.rows import (
    COMPILED,
    along_basis,
    angles,
    brightness_by_vectors,
    direction,
    huber,
    orbit_of,
    pixel_by_position,
    view_numbers,
)
from photoclinometry.adjust.graph.slot import LandmarkState, ViewState
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE
from photoclinometry.model.projection import project_point
from photoclinometry.model.reflectance import continued_function, continued_parameters


class Observed(NamedTuple):
    """N observations, landmark by landmark, with their weights."""

    start: np.ndarray
    """(J + 1,) as in `Tracks`."""
    seen_by: np.ndarray
    """(N,) int32, the view of each."""
    keypoint: np.ndarray
    """(N, 2) [px]."""
    brightness: np.ndarray
    """(N,) at pixel (0, 0), by the gradient; the brightness itself where that is zero."""
    gradient: np.ndarray
    """(N, 2) derivative of brightness by the projected pixel [1/px]."""
    keypoint_weight: np.ndarray
    """(N,) 1 / sigma [1/px] as the estimate has it."""
    brightness_weight: np.ndarray
    """(N,) 1 / sigma as the estimate has it, zero where brightness does not count."""
    keypoint_limit: np.ndarray
    """(J,) Huber limit, in sigmas."""
    brightness_limit: float


class EstimatedReflectance(NamedTuple):
    """A reflectance and the T of its parameters that are estimated."""

    parameter_vector: np.ndarray
    """`Reflectance.parameter_vector`."""
    scale: np.ndarray
    """(T,) `Reflectance.parameter_scale`; of none where the parameters are known."""


@njit(**COMPILED)
def _set_rows(j, i, k, view_state, points, observed, pivot, model, by_landmark, by_view, by_parameter):
    """Rows of observation i, of landmark j in view k: 0 and 1 of its keypoint, 2 of its brightness (`rows`).

    by_parameter: (T,) of row 2, the only one that depends on the reflectance.
    """
    p, c = points.position[j], view_state.center[k]
    intrinsics, rotation = view_numbers(k, view_state)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    inverse, x, y = project_point(r00, r01, r02, r10, r11, r12, r20, r21, r22, p[0] - c[0], p[1] - c[1], p[2] - c[2])
    pixel = intrinsics[0] * x + intrinsics[2], intrinsics[1] * y + intrinsics[3]
    by_x, by_y = pixel_by_position(intrinsics, rotation, inverse, x, y)
    weight, arm = observed.keypoint_weight[i], (p[0] - pivot[0], p[1] - pivot[1], p[2] - pivot[2])
    off = math.hypot(weight * (pixel[0] - observed.keypoint[i, 0]), weight * (pixel[1] - observed.keypoint[i, 1]))
    weight *= huber(off, observed.keypoint_limit[j])[1]
    for m in range(3):
        by_landmark[0, m], by_landmark[1, m] = weight * by_x[m], weight * by_y[m]
    for r in range(2):
        _set_pose(by_landmark[r], arm, by_view[r])
    by_landmark[2] = 0.0
    by_view[2] = 0.0
    by_parameter[:] = 0.0
    if observed.brightness_weight[i] != 0.0:
        _set_brightness_row(
            j, i, k, view_state, points, observed, arm, model, pixel, by_x, by_y, by_landmark, by_view, by_parameter
        )


@njit(**COMPILED)
def _set_pose(a, arm, out):
    """The row by pose (orbit 3, shift 3) that belongs to the row a by position."""
    turn = orbit_of(a, arm)
    for m in range(3):
        out[m], out[3 + m] = turn[m], -a[m]


@njit(**COMPILED)
def _set_brightness_row(
    j, i, k, view_state, points, observed, arm, model, pixel, by_x, by_y, by_landmark, by_view, by_parameter
):
    """Row 2 of observation i, scaled down beyond Huber's limit."""
    p, c, scale, albedo = points.position[j], view_state.center[k], view_state.scale[k], points.albedo[j]
    sun = view_state.sun[k, 0], view_state.sun[k, 1], view_state.sun[k, 2]
    normal = points.normal[j, 0], points.normal[j, 1], points.normal[j, 2]
    e, inverse_range = direction(c[0] - p[0], c[1] - p[1], c[2] - p[2])
    mu0, mu, cosine, sine = angles(sun, e, normal)
    phase = math.atan2(sine, cosine)
    rho, by_mu0, by_mu, by_phase = continued_function(model.parameter_vector, mu0, mu, phase)
    gx, gy = observed.gradient[i, 0], observed.gradient[i, 1]
    predicted = scale * albedo * rho + view_state.bias[k] - gx * pixel[0] - gy * pixel[1]
    weight = observed.brightness_weight[i]
    weight *= huber(abs(weight * (predicted - observed.brightness[i])), observed.brightness_limit)[1]
    by_position, by_normal, by_sun, turn = brightness_by_vectors(
        weight * scale * albedo, by_mu0, by_mu, by_phase, sine, sun, e, normal, inverse_range
    )
    for m in range(3):
        by_landmark[2, m] = by_position[m] - weight * (gx * by_x[m] + gy * by_y[m])
    _set_pose(by_landmark[2], arm, by_view[2])
    for m in range(3):
        by_view[2, m] += turn[m]
    basis, sun_basis = points.normal_basis[j], view_state.sun_basis[k]
    by_landmark[2, 3], by_landmark[2, 4] = along_basis(
        by_normal, (basis[0, 0], basis[0, 1], basis[1, 0], basis[1, 1], basis[2, 0], basis[2, 1])
    )
    by_view[2, 6], by_view[2, 7] = along_basis(
        by_sun,
        (sun_basis[0, 0], sun_basis[0, 1], sun_basis[1, 0], sun_basis[1, 1], sun_basis[2, 0], sun_basis[2, 1]),
    )
    by_landmark[2, 5] = weight * scale * rho
    by_view[2, 8] = weight * albedo * rho
    by_view[2, 9] = weight
    if by_parameter.size:
        continued_parameters(model.parameter_vector, mu0, mu, phase, by_parameter)
        for t in range(by_parameter.size):
            by_parameter[t] *= weight * scale * albedo * model.scale[t]


@njit(nogil=True, **COMPILED)
def _add_patch(first, last, slot, view_state, points, observed, pivot, model, patch):
    """Fills `patch` with the rows of landmarks first:last; slot: (K,) the place of each view in it."""
    by_landmark, by_view = np.zeros((3, LANDMARK_SIZE)), np.zeros((3, VIEW_SIZE))
    by_parameter = np.zeros(model.scale.size)
    for j in range(first, last):
        n = j - first
        for i in range(observed.start[j], observed.start[j + 1]):
            k = observed.seen_by[i]
            s = slot[k]
            _set_rows(j, i, k, view_state, points, observed, pivot, model, by_landmark, by_view, by_parameter)
            for r in range(3):
                touched, moved = (3, 6) if r < 2 else (LANDMARK_SIZE, VIEW_SIZE)
                for a in range(touched):
                    x = by_landmark[r, a]
                    patch.shifts[n, a, s, r] += x
                    for b in range(touched):
                        patch.own[n, r // 2, a, b] += x * by_landmark[r, b]
                    for b in range(moved):
                        patch.coupling[n, a, s, b] += x * by_view[r, b]
                for a in range(moved):
                    for b in range(a + 1):
                        patch.view_block[s, a, b] += by_view[r, a] * by_view[r, b]
            for t in range(by_parameter.size):
                x = by_parameter[t]
                for a in range(LANDMARK_SIZE):
                    patch.by_parameter[n, a, t] += by_landmark[2, a] * x
                for a in range(VIEW_SIZE):
                    patch.border[s, a, t] += by_view[2, a] * x
                for u in range(by_parameter.size):
                    patch.parameter[t, u] += x * by_parameter[u]


class Patch(NamedTuple):
    """J^T J from the observations of a run of n landmarks, which m views see; and their rows."""

    views: np.ndarray
    """(m,) indices."""
    own: np.ndarray
    """(n, 2, 6, 6) each landmark's block, by keypoints and by brightness."""
    coupling: np.ndarray
    """(n, 6, m, 10) landmark with view."""
    shifts: np.ndarray
    """(n, 6, m, 3) rows by landmark: the contribution of a unit whitened error of u, v and brightness in a view to
    -gradient."""
    view_block: np.ndarray
    """(m, 10, 10) each view's block."""
    by_parameter: np.ndarray
    """(n, 6, T) landmark with reflectance parameters."""
    border: np.ndarray
    """(m, 10, T) view with reflectance parameters."""
    parameter: np.ndarray
    """(T, T) the reflectance parameters' block."""


def observed_patch(
    first: int,
    last: int,
    view_state: ViewState,
    points: LandmarkState,
    observed: Observed,
    pivot: np.ndarray,
    model: EstimatedReflectance,
    others: np.ndarray,
    count_of_views: int,
) -> Patch:
    """The patch of landmarks first:last. pivot: (3,) of `Estimate`; others: views and systematic errors, of
    `count_of_views`, that general factors couple with these landmarks."""
    views = np.unique(np.concatenate([observed.seen_by[observed.start[first] : observed.start[last]], others]))
    slot = np.zeros(count_of_views, np.int64)
    slot[views] = np.arange(len(views))
    n, m, count = last - first, len(views), len(model.scale)
    patch = Patch(
        views,
        np.zeros((n, 2, LANDMARK_SIZE, LANDMARK_SIZE)),
        np.zeros((n, LANDMARK_SIZE, m, VIEW_SIZE)),
        np.zeros((n, LANDMARK_SIZE, m, 3)),
        np.zeros((m, VIEW_SIZE, VIEW_SIZE)),
        np.zeros((n, LANDMARK_SIZE, count)),
        np.zeros((m, VIEW_SIZE, count)),
        np.zeros((count, count)),
    )
    _add_patch(first, last, slot, view_state, points, observed, pivot, model, patch)
    patch.view_block[:] += np.swapaxes(np.tril(patch.view_block, -1), 1, 2)
    return patch
