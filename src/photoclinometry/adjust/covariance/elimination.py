"""The landmarks eliminated from the normal equations: what is left is of views and reflectance parameters alone.

S = H_cc - H_cl H_ll^-1 H_lc, see `marginals`; landmarks are taken a patch at a time, without links between patches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve, get_blas_funcs, solve_triangular

from photoclinometry.adjust.covariance.information import Patch
from photoclinometry.adjust.covariance.linearized_graph import SIMILARITY, LinearizedGraph, landmark_moves
from photoclinometry.adjust.covariance.windows import hold
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE

(_syrk,) = get_blas_funcs(("syrk",), dtype=np.float64)


@dataclass(frozen=True)
class Eliminated:
    """The landmarks eliminated."""

    information: np.ndarray
    """(10 K + T, 10 K + T) S, of views and reflectance parameters."""
    own: np.ndarray
    """(J, 2, 6, 6) of each landmark, by keypoints and by brightness."""
    frame_by_common: np.ndarray
    """(7, 10 K + T) how the similarity that fits the landmarks best follows from errors of views and reflectance
    parameters; zero without one."""


def eliminated(at: LinearizedGraph, patches: list[tuple[int, int]], frame: np.ndarray | None) -> Eliminated:
    """The landmarks eliminated, patch (first, last) by patch; frame: (J,) bool, those that the similarity fits."""
    total = at.common_prior.copy()
    own = np.empty((len(at), 2, LANDMARK_SIZE, LANDMARK_SIZE))
    moved = np.zeros((SIMILARITY, len(total)))
    for first, last in patches:
        patch = at.patch(first, last)
        own[first:last] = patch.own
        for k, block, border in zip(patch.views, patch.view_block, patch.border, strict=True):
            here = slice(VIEW_SIZE * k, VIEW_SIZE * (k + 1))
            total[here, here] += block
            total[at.of_views :, here] += border.T
        total[at.of_views :, at.of_views :] += patch.parameter
        index, coupling = coupling_of(at, patch)
        factor = factor_of(at, patch, first, last)
        half = solve_triangular(factor, coupling, lower=True, check_finite=False)
        _subtract(total, index, _syrk(1.0, half, trans=1, lower=1))
        if frame is not None:
            move = landmark_moves(at, first, last)
            move[:, 3:] = 0.0
            move[~frame[first:last]] = 0.0
            moved[:, index] -= cho_solve((factor, True), move.reshape(-1, SIMILARITY), check_finite=False).T @ coupling
    total = np.tril(total) + np.tril(total, -1).T
    if frame is None:
        return Eliminated(total, own, moved)
    move = landmark_moves(at, 0, len(at))[frame, :3].reshape(-1, SIMILARITY)
    return Eliminated(total, own, np.linalg.solve(move.T @ move, moved))


@njit(cache=True, nogil=True)
def _subtract(total, index, part):
    """total[index, index] -= part, lower triangles; index ascends."""
    for b in range(index.size):
        for a in range(b, index.size):
            total[index[a], index[b]] -= part[a, b]


def coupling_of(at: LinearizedGraph, patch: Patch) -> tuple[np.ndarray, np.ndarray]:
    """Which of all coordinates of views and parameters (c,) a patch depends on, and its information (6 n, c) with
    them."""
    of_views = (VIEW_SIZE * patch.views[:, None] + np.arange(VIEW_SIZE)).ravel()
    coupling = [part.reshape(LANDMARK_SIZE * len(patch.own), -1) for part in (patch.coupling, patch.by_parameter)]
    return np.concatenate([of_views, np.arange(at.of_views, len(at.common_prior))]), np.hstack(coupling)


def factor_of(at: LinearizedGraph, patch: Patch, first: int, last: int) -> np.ndarray:
    """Lower Cholesky factor (6n, 6n) of a patch's H_ll, without the links to other patches."""
    blocks = patch.own.sum(1) + at.prior[first:last]
    dense = np.zeros((last - first, LANDMARK_SIZE, last - first, LANDMARK_SIZE))
    _add_links(first, last, at.links, dense)
    dense[range(last - first), :, range(last - first), :] += blocks
    dense = dense.reshape(LANDMARK_SIZE * (last - first), -1)
    np.einsum("aa->a", dense)[:] = hold(np.diag(dense))
    return cho_factor(dense, lower=True, overwrite_a=True, check_finite=False)[0]


@njit(cache=True, nogil=True)
def _add_links(first, last, links, dense):
    row = np.zeros((2, 5))
    for p in range(links.start[first], links.start[last]):
        a, b = links.source[p] - first, links.target[p] - first
        if b < 0 or b >= last - first:
            continue
        for x in range(5):
            row[0, x] = links.rows[p, x] if x >= 3 else -links.rows[p, x]
            row[1, x] = links.rows[p, x] if x < 3 else 0.0
        for x in range(5):
            for y in range(5):
                dense[a, x, a, y] += row[0, x] * row[0, y]
                dense[a, x, b, y] += row[0, x] * row[1, y]
                dense[b, x, a, y] += row[1, x] * row[0, y]
                dense[b, x, b, y] += row[1, x] * row[1, y]
