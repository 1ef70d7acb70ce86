"""Correlation of the errors of the positions of different landmarks, by distance.

It is found from some runs of landmarks, whose joint covariance is that of `marginals`. It has three parts: given the
views, smoothness in each run; errors of views and reflectance parameters, between all landmarks; and errors that
neighbours share.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import nnls

from photoclinometry.adjust.covariance.elimination import factor_of
from photoclinometry.adjust.covariance.information import Patch
from photoclinometry.adjust.covariance.linearized_graph import LinearizedGraph
from photoclinometry.adjust.covariance.marginals import (
    WEIGHT_STEP,
    ErrorModel,
    PositionSmoothness,
    responses,
    stiffness_of,
)
from photoclinometry.adjust.covariance.windows import OUTSIDE
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE

LENGTHS = tuple(2.0**n for n in range(11))
"""Lengths of the exponentials of the distance, in the spacing of landmarks: from neighbours to more than a map. A sum
of such exponentials with shares that are not negative is a valid correlation: it gives no negative variance."""
RUNS, RUN = 6, 128
"""Runs of landmarks, spread over the map, and landmarks in each: a second of inverses."""
BINS = 24
"""Number of bins of distance, a constant factor apart."""


def correlation_by_distance(
    at: LinearizedGraph,
    errors: ErrorModel,
    common: np.ndarray,
    cell: np.ndarray,
    *,
    exact: bool,
    shared_side: float,
) -> np.ndarray:
    """Shares (n,) of the exponentials of LENGTHS in the variance of positions; the rest belongs to each landmark alone.

    common: (10 K + T, 10 K + T) covariance of views and parameters, errors of the frame taken out. cell: (J', 2) of the
    map's landmarks in its grid; they come first. exact: as `marginals` has treated the map; shared_side: of the square
    of landmarks that share an error of keypoints.
    """
    count = len(cell)
    run = min(RUN, count)
    firsts = np.unique(np.linspace(0, count - run, RUNS).astype(int))
    stiffness = None if exact else stiffness_of(at.links, len(at))
    held = errors.position_smoothness or PositionSmoothness(at=at, errors=errors)
    value, vector = np.linalg.eigh(common)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    parts, by_common, shared, cells = [], [], [], []
    for first in firsts.tolist():
        last = first + run
        parts.append(_given_views(held, first, last))
        of_views, alike = _of_common(at, errors, stiffness, root, first, last)
        by_common.append(of_views)
        shared.append(alike)
        cells.append(cell[first:last])
    place = np.concatenate(cells).astype(float)
    distance = np.hypot(*(place[:, None] - place[None]).transpose(2, 0, 1))
    covariance = _traces(np.concatenate(by_common)) + _traces(np.concatenate(shared)) * np.exp(-distance / shared_side)
    for number, part in enumerate(parts):
        own = slice(number * run, (number + 1) * run)
        covariance[own, own] += part
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = size > 0.0
    correlation = covariance[np.ix_(known, known)] / np.outer(size[known], size[known])
    return _by_distance(distance[np.ix_(known, known)], correlation)


def _by_distance(distance: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    """Shares (n,), by least squares, from (n, n) distances and correlations of pairs."""
    pair = np.triu_indices(len(distance), 1)
    far, alike = distance[pair], np.clip(correlation[pair], -1.0, 1.0)
    known = np.isfinite(alike) & (far > 0.0)
    far, alike = far[known], alike[known]
    if not len(far):
        return np.zeros(len(LENGTHS))
    edges = np.geomspace(1.0 - 1e-9, far.max() * (1.0 + 1e-9), BINS + 1)
    number = np.clip(np.searchsorted(edges, far, side="right") - 1, 0, BINS - 1)
    pairs = np.bincount(number, minlength=BINS)
    some = pairs > 0
    of_bin, mean = (np.bincount(number, values, BINS)[some] / pairs[some] for values in (far, alike))
    share, _ = nnls(np.exp(-of_bin[:, None] / np.array(LENGTHS)), mean)
    return share / max(share.sum(), 1.0)


def _given_views(held: PositionSmoothness, first: int, last: int) -> np.ndarray:
    """(n, n) traces of the covariances of positions of landmarks first:last with each other, given the views.

    As in windows, links that leave the run count with the weight OUTSIDE relative to links with fixed far ends.
    """
    at, errors = held.at, held.errors
    patch, prior, around = at.patch(first, last), at.prior[first:last], _links_that_leave(at, first, last)
    covariance = _inverse(at, patch, prior + around, first, last)
    beyond = errors.keypoint[first:last] * (1.0 - errors.keypoint_common) - errors.smoothness
    of_brightness = errors.brightness * (1.0 - errors.brightness_common) - errors.smoothness
    more = np.stack([beyond, np.full_like(beyond, of_brightness)], 1)
    heavier = patch._replace(own=patch.own * (1.0 + WEIGHT_STEP * more)[:, :, None, None])
    changed = (1.0 + WEIGHT_STEP * (1.0 - errors.smoothness)) * prior
    difference = covariance - _inverse(at, heavier, changed + around, first, last)
    return errors.smoothness * covariance + difference / WEIGHT_STEP


def _links_that_leave(at: LinearizedGraph, first: int, last: int) -> np.ndarray:
    """(n, 6, 6) contributions to landmarks first:last of links from and to landmarks beyond."""
    links, out = at.links, np.zeros((last - first, LANDMARK_SIZE, LANDMARK_SIZE))
    source, target = ((ends >= first) & (ends < last) for ends in (links.source, links.target))
    leaving, coming = np.flatnonzero(source & ~target), np.flatnonzero(target & ~source)
    own = np.zeros((len(leaving), LANDMARK_SIZE))
    own[:, :3], own[:, 3:5] = -links.rows[leaving, :3], links.rows[leaving, 3:]
    np.add.at(out, links.source[leaving] - first, OUTSIDE * own[:, :, None] * own[:, None])
    far = links.rows[coming, :3]
    np.add.at(out[:, :3, :3], links.target[coming] - first, OUTSIDE * far[:, :, None] * far[:, None])
    return out


def _inverse(at: LinearizedGraph, patch: Patch, prior: np.ndarray, first: int, last: int) -> np.ndarray:
    """(n, n) traces of the blocks (3, 3) of positions in the inverse of a run's information; prior: (n, 6, 6)."""
    on_all = np.zeros_like(at.prior)
    on_all[first:last] = prior
    factor, size = factor_of(replace(at, prior=on_all), patch, first, last), LANDMARK_SIZE * (last - first)
    positions = (LANDMARK_SIZE * np.arange(last - first)[:, None] + np.arange(3)).ravel()
    unit = np.zeros((size, len(positions)))
    unit[positions, np.arange(len(positions))] = 1.0
    inverse = cho_solve((factor, True), unit, check_finite=False)[positions]
    return np.einsum("nimi->nm", inverse.reshape(last - first, 3, last - first, 3))


def _of_common(
    at: LinearizedGraph, errors: ErrorModel, stiffness: np.ndarray | None, root: np.ndarray, first: int, last: int
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3, c) responses of positions of landmarks first:last to one standard deviation of errors of views and
    parameters, and (n, 3, 3 K) to errors that neighbours share. root: (10 K + T, c), root @ root.T is the covariance of
    views and parameters."""
    index, by_common, shared = responses(at, errors, stiffness, first, last)
    shape = (last - first, LANDMARK_SIZE, -1)
    of_views = (by_common @ root[index].astype(by_common.dtype)).reshape(shape)[:, :3]
    alike = np.zeros((last - first, 3, at.of_views // VIEW_SIZE, 3))
    if shared.size:
        seen_by = index[: VIEW_SIZE * (shared.shape[1] // 3) : VIEW_SIZE] // VIEW_SIZE
        alike[:, :, seen_by] = shared.reshape(last - first, LANDMARK_SIZE, -1, 3)[:, :3]
    return of_views, alike.reshape(last - first, 3, -1)


def _traces(by: np.ndarray) -> np.ndarray:
    """(n, n) traces of by_j by_k^T, of by (n, 3, m)."""
    return np.add.reduce([by[:, axis] @ by[:, axis].T for axis in range(3)])
