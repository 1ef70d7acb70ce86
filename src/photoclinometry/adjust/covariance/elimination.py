"""The normal equations of views and reflectance parameters after elimination of the landmarks.

S = H_cc - H_cl H_ll^-1 H_lc, see `marginals`; landmarks are taken a patch at a time, without links between patches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from photoclinometry.adjust.covariance.information import Patch
from photoclinometry.adjust.covariance.linearized_graph import LinearizedGraph
from photoclinometry.adjust.covariance.windows import with_ridge
from photoclinometry.adjust.graph.similarity import SIMILARITY
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE
from photoclinometry.model.cholesky import factorize, solve_lower
from photoclinometry.model.threads import in_threads, runs


@dataclass(frozen=True)
class Eliminated:
    """The landmarks eliminated."""

    information: np.ndarray
    """(10 K + T, 10 K + T) S, of views and reflectance parameters."""
    along_similarity: np.ndarray
    """(10 K + T, 7) its product with a similarity of views (`LinearizedGraph.view_moves`), computed from the only
    factors that determine a similarity. Computed from S, it would be a small difference of large numbers, smaller than
    the errors by rounding and by the ridge under landmarks. Zero without a frame that is kept."""
    own: np.ndarray
    """(J, 2, 6, 6) of each landmark, by keypoints and by brightness."""
    frame_by_common: np.ndarray
    """(7, 10 K + T) response of the similarity that fits the landmarks best to errors of views and reflectance
    parameters; zero without one."""


def eliminate_landmarks(
    at: LinearizedGraph, patches: list[tuple[int, int]], frame: np.ndarray | None, *, keeps_frame: bool = False
) -> Eliminated:
    """The landmarks eliminated, patch (first, last) by patch; frame: (J,) bool, landmarks to which the similarity is
    fitted; keeps_frame: whether it is the frame of priors, which alone determine it."""
    own, by_view = np.empty((len(at), 2, LANDMARK_SIZE, LANDMARK_SIZE)), at.view_moves()

    def eliminate(some: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For some of the patches: the remaining equations (lower triangle), their product with a similarity of views,
        and the response of the similarity's fit to them."""
        total, moved = np.zeros_like(at.common_prior), np.zeros((SIMILARITY, len(at.common_prior)))
        pulled = np.zeros_like(by_view)
        for first, last in patches[some]:
            patch = at.patch(first, last)
            own[first:last] = patch.own
            _add_patch(total, patch, at.of_views)
            factor = factor_of(at, patch, first, last)
            index, half = coupling_of(at, patch)
            solve_lower(factor, half)
            _subtract(total, index, half.T @ half)
            if keeps_frame and (pull := at.landmark_pull(first, last, by_view)).any():
                solve_lower(factor, pull)
                pulled[index] -= half.T @ pull
            if frame is not None:
                move = _frame_moves(at, frame, first, last)
                solve_lower(factor, move)
                moved[:, index] -= move.T @ half
        return total, pulled, moved

    parts = in_threads(eliminate, runs(len(patches)))
    total = at.common_prior + sum(part for part, *_ in parts)
    total = np.tril(total) + np.tril(total, -1).T
    pulled = sum((part for _, part, _ in parts), np.zeros_like(by_view))
    if keeps_frame:
        pulled += at.common_prior @ by_view + at.common_pull(by_view)
    moved = sum((part for *_, part in parts), np.zeros((SIMILARITY, len(total))))
    if frame is None:
        return Eliminated(total, pulled, own, moved)
    move = at.landmark_moves(0, len(at))[frame, :3].reshape(-1, SIMILARITY)
    return Eliminated(total, pulled, own, np.linalg.solve(move.T @ move, moved))


def _add_patch(total: np.ndarray, patch: Patch, of_views: int) -> None:
    """Adds the information of a patch's measurements on views and reflectance parameters if its landmarks were known;
    of_views: 10 K."""
    for k, block, border in zip(patch.views, patch.view_block, patch.border, strict=True):
        here = slice(VIEW_SIZE * k, VIEW_SIZE * (k + 1))
        total[here, here] += block
        total[of_views:, here] += border.T
    total[of_views:, of_views:] += patch.parameter


def _frame_moves(at: LinearizedGraph, frame: np.ndarray, first: int, last: int) -> np.ndarray:
    """(6 n, 7) moves of the positions of landmarks first:last to which the similarity is fitted."""
    move = at.landmark_moves(first, last)
    move[:, 3:] = 0.0
    move[~frame[first:last]] = 0.0
    return move.reshape(-1, SIMILARITY)


@njit(cache=True, nogil=True)
def _subtract(total, index, part):
    """total[index, index] -= part, lower triangles; index ascends."""
    for b in range(index.size):
        for a in range(b, index.size):
            total[index[a], index[b]] -= part[a, b]


def coupling_of(at: LinearizedGraph, patch: Patch) -> tuple[np.ndarray, np.ndarray]:
    """The coordinates of views and parameters (c,) on which a patch depends, and its information (6 n, c) with them."""
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
    np.einsum("aa->a", dense)[:] = with_ridge(np.diag(dense))
    factorize(dense)
    return dense


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
