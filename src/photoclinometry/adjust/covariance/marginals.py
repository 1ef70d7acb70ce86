"""How uncertain the joint estimate is: marginal covariances of every view and of every landmark.

With H = J^T J at the minimum, c the local coordinates of the views and of the reflectance parameters that are estimated
along, and l the landmarks',

    S = H_cc - H_cl H_ll^-1 H_lc                 cov(c)   = S^-1
    X_j = (H_ll^-1 H_lc)_j                       cov(l_j) = (H_ll^-1)_jj + X_j cov(c) X_j^T

Exact for small maps. In larger ones smoothness couples too many landmarks, and three things are approximated: S leaves
out the links between patches of landmarks, which makes the views a little less certain than they are; X_j takes the
neighbours to move as the landmark does; (H_ll^-1)_jj is inverted in windows (`windows.py`).
docs/explanation/estimate.md states what that costs in accuracy.

The sigma that weights a measurement in the estimate need not be the sigma of its error: sigmas are enlarged for errors
that neighbours share (`noise.py`), and no ground fulfils smoothness exactly. `ErrorModel` states the errors.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from photoclinometry.adjust.covariance.elimination import Eliminated, coupling_of, eliminate_landmarks, factor_of
from photoclinometry.adjust.covariance.linearized_graph import LinearizedGraph
from photoclinometry.adjust.covariance.windows import RIDGE, Links, covariances_given_views
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE
from photoclinometry.model.threads import in_threads

EXACT = 1000
"""Landmarks up to which nothing is approximated."""

WINDOW, PATCH, LARGE_PATCH = 32, 32, 256
"""Landmarks in a window, and in a patch: 8 x 4 in the solver's order, or, in maps up to LARGE, 16 x 16."""

LARGE = 20_000
"""Landmarks of a map up to which patches are large."""

UNMEASURED = 1e8
"""Ratio of a variance to that with all else known, beyond which it counts as infinite."""

_BATCH = 128
"""Landmarks that are processed at a time where each is treated alone."""

_PHOTOMETRIC = 6
"""First of a view's photometric coordinates: Sun, scale and bias; those before it are its pose."""

ALBEDO = 5
"""Index of the albedo among a landmark's coordinates."""

SAMPLED_BATCHES = 32
"""Most batches of landmarks, evenly chosen, that determine the common relative error of all albedos: thousands of
landmarks. Their responses are computed twice."""

WEIGHT_STEP = 1e-3
"""Relative change of weights in the differences by which the contribution of each kind of measurement is found."""


@dataclass(frozen=True, kw_only=True)
class ErrorModel:
    """Variances of the errors, relative to those that weight the estimate."""

    keypoint: np.ndarray
    """(J,) of each landmark."""
    brightness: float = 1.0
    smoothness: float = 1.0
    keypoint_common: float = 0.0
    """The part of a keypoint's variance that all landmarks nearby share, between 0 and 1."""
    brightness_common: float = 0.0
    position_smoothness: PositionSmoothness | None = None
    """The smoothness that holds positions, where it differs from that of normals and albedos."""

    def common(self, first: int, last: int) -> np.ndarray:
        """(n, 3) variances of u, v and brightness of landmarks first:last that those nearby share."""
        keypoint = self.keypoint[first:last] * self.keypoint_common
        return np.stack([keypoint, keypoint, np.full_like(keypoint, self.brightness * self.brightness_common)], -1)


@dataclass(frozen=True, kw_only=True)
class Marginals:
    """Covariances in the local coordinates of `factors`; infinite variances where nothing was measured."""

    views: np.ndarray
    """(10 K, 10 K) of all views together."""
    landmark: np.ndarray
    """(J, 6, 6)."""
    common: np.ndarray
    """(10 K + T, 10 K + T) of views and reflectance parameters, without errors of the frame where one was asked for;
    nothing is infinite."""
    parameter: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    """(T, T) of the reflectance parameters that are estimated along."""
    albedo_relative: np.ndarray
    """(J,) variances of albedos after the factor that all have in common."""
    albedo_by_common: np.ndarray
    """(J, 2) the parts of the variances of albedos, as in `landmark` and in `albedo_relative`, that are due to errors
    of views and reflectance parameters."""
    of_frame: np.ndarray | None = None
    """(J, 6, 6) the part of `landmark` that is due to errors of the frame; None unless the frame was asked for and
    kept."""
    frame: np.ndarray | None = None
    """(7, 7) covariance of the map's similarity error: rotation, translation and scale about the pivot; None
    likewise."""


@dataclass(frozen=True, kw_only=True)
class PositionSmoothness:
    """Smoothness of positions where it differs from that of normals and albedos."""

    at: LinearizedGraph
    """With other links and the same measurements."""
    errors: ErrorModel


def marginals(
    at: LinearizedGraph,
    errors: ErrorModel | None = None,
    *,
    frame: np.ndarray | None = None,
    keeps_frame: bool = False,
    exact: int = EXACT,
    patch: int | None = None,
) -> Marginals:
    """Marginal covariances of all views and landmarks.

    frame: (J,) bool, landmarks whose positions define the frame: covariances are those after removal of their best
    similarity (an S-transformation, Baarda 1973), as a map made from images alone has no frame of its own. None: the
    frame of the priors, which hold one view and one landmark. keeps_frame: the priors know the frame of these
    landmarks; covariances keep its errors, and their part is returned besides.
    errors: without them, as weighed and independent.
    exact: number of landmarks up to which nothing is approximated; patch: landmarks in a patch of larger maps.
    """
    count = len(at)
    patch = patch or (LARGE_PATCH if count <= LARGE else PATCH)
    patches, windows, batches = (
        [(0, count)] if count <= exact else _runs(count, size) for size in (patch, WINDOW, _BATCH)
    )
    reduced = eliminate_landmarks(at, patches, frame, keeps_frame=keeps_frame)
    of_frame = similarity = None
    if frame is None:
        common = _inverse(reduced.information)
    elif keeps_frame:
        common = _inverse_with_frame(reduced.information, at.view_moves(), reduced.along_similarity)
        similarity = reduced.frame_by_common @ common @ reduced.frame_by_common.T
        move = at.landmark_moves(0, count)
        of_frame = move @ similarity @ np.swapaxes(move, 1, 2)
    else:
        common = _without_frame(_inverse(reduced.information), at, reduced)
    without_frame = _without_frame(common, at, reduced) if keeps_frame and frame is not None else common.copy()
    landmark = _given_views(at, reduced.own, errors, windows)
    held = None if errors is None else errors.position_smoothness
    if held is not None:
        landmark[:, :3, :3] = _given_views(held.at, reduced.own, held.errors, windows)[:, :3, :3]
    relative, by_common = _add_common(landmark, at, errors, common, batches)
    _forget_unmeasured(landmark, reduced.own.sum(1) + at.prior, at.links)
    unmeasured = np.diag(reduced.information) == 0.0
    common[unmeasured, unmeasured] = np.inf
    views = at.of_views
    return Marginals(
        views=common[:views, :views],
        landmark=landmark,
        common=without_frame,
        parameter=common[views:, views:],
        albedo_relative=np.where(np.isfinite(landmark[:, 5, 5]), relative, np.inf),
        albedo_by_common=by_common,
        of_frame=of_frame,
        frame=similarity,
    )


def _without_frame(common: np.ndarray, at: LinearizedGraph, reduced: Eliminated) -> np.ndarray:
    """The covariance (10 K + T, 10 K + T) after the best similarity of the landmarks has been taken out."""
    kept = np.eye(len(common)) - at.view_moves() @ reduced.frame_by_common
    return kept @ common @ kept.T


def _runs(count: int, size: int) -> list[tuple[int, int]]:
    return [(first, min(first + size, count)) for first in range(0, count, size)]


def _inverse(information: np.ndarray) -> np.ndarray:
    """Of S; coordinates that nothing determines are left with a variance of one."""
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0, size, 1.0)
    scaled = information / np.outer(size, size)
    np.fill_diagonal(scaled, 1.0)
    factor = cho_factor(scaled, lower=True, check_finite=False)
    return cho_solve(factor, np.eye(len(size)), check_finite=False) / np.outer(size, size)


def _inverse_with_frame(information: np.ndarray, along: np.ndarray, product: np.ndarray) -> np.ndarray:
    """Of S (n, n), whose product (n, 7) with the directions `along` (n, 7) is known better than S itself.

    It is inverted in a basis of which these directions are the first seven.
    """
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0, size, 1.0)
    basis, triangle = np.linalg.qr(along * size[:, None], mode="complete")
    first, triangle = len(along.T), triangle[: len(along.T)]
    scaled = information / np.outer(size, size)
    np.einsum("aa->a", scaled)[:] = 1.0
    turned = basis.T @ scaled @ basis
    turned[:, :first] = basis.T @ np.linalg.solve(triangle.T, (product / size[:, None]).T).T
    turned[:first, :first] = 0.5 * (turned[:first, :first] + turned[:first, :first].T)
    turned[:first, first:] = turned[first:, :first].T
    back = basis * size[:, None] ** -1
    return back @ _inverse(turned) @ back.T


def _given_views(
    at: LinearizedGraph, own: np.ndarray, errors: ErrorModel | None, windows: list[tuple[int, int]]
) -> np.ndarray:
    """(J, 6, 6) covariances given the views, of all errors but the common ones."""
    information = own.sum(1) + at.prior
    covariance = covariances_given_views(information, at.links, windows)
    if errors is None:
        return covariance
    # A measurement contributes H^-1 J^T J H^-1: the decrease of uncertainty with its weight.
    beyond = errors.keypoint * (1.0 - errors.keypoint_common) - errors.smoothness
    information = information + WEIGHT_STEP * (beyond[:, None, None] * own[:, 0] + (1.0 - errors.smoothness) * at.prior)
    beyond = errors.brightness * (1.0 - errors.brightness_common) - errors.smoothness
    information += WEIGHT_STEP * beyond * own[:, 1]
    changed = covariances_given_views(information, at.links, windows)
    return errors.smoothness * covariance + (covariance - changed) / WEIGHT_STEP


def _add_common(
    landmark: np.ndarray,
    at: LinearizedGraph,
    errors: ErrorModel | None,
    common: np.ndarray,
    batches: list[tuple[int, int]],
) -> tuple[np.ndarray, np.ndarray]:
    """Adds to (J, 6, 6) the effect on landmarks of errors of views and parameters, and of errors that neighbours share.

    common: (10 K + T, 10 K + T) covariance of views and parameters. Returns the variances (J,) that albedos have
    without the relative error that all have in common: that of their mean over every few batches; and the parts (J, 2)
    of both variances that errors of views and parameters make.
    """
    stiffness = None if len(batches) == 1 else stiffness_of(at.links, len(at))
    factor, sampled = np.zeros(len(common)), 0
    for first, last in batches[:: -(-len(batches) // SAMPLED_BATCHES)]:
        index, by_common, _ = responses(at, errors, stiffness, first, last)
        factor[index] += (by_common[ALBEDO::LANDMARK_SIZE] / at.points.albedo[first:last, None]).sum(0)
        sampled += last - first
    factor /= sampled
    of_factor = common @ factor
    relative, of_common = np.empty(len(at)), np.empty((len(at), 2))

    def add(batch: tuple[int, int]) -> None:
        first, last = batch
        index, by_common, shared = responses(at, errors, stiffness, first, last)
        covariance = common[np.ix_(index, index)].astype(by_common.dtype)
        common_part = _products(by_common @ covariance, by_common)
        landmark[first:last] += common_part + _products(shared, shared)
        albedo = at.points.albedo[first:last]
        in_common = albedo**2 * (factor @ of_factor) - 2.0 * albedo * (
            by_common[ALBEDO::LANDMARK_SIZE] @ of_factor[index]
        )
        relative[first:last] = landmark[first:last, ALBEDO, ALBEDO] + in_common
        absolute = common_part[:, ALBEDO, ALBEDO]
        of_common[first:last] = np.stack([absolute, absolute + in_common], -1)

    in_threads(add, batches)
    return np.maximum(relative, 0.0), np.maximum(of_common, 0.0)


def responses(
    at: LinearizedGraph, errors: ErrorModel | None, stiffness: np.ndarray | None, first: int, last: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Responses of landmarks first:last to views and parameters, and to errors that neighbours share.

    stiffness: (J, 6, 6) as of `stiffness_of`; None where all landmarks are treated together. Returns the indices of
    coordinates of views and parameters (c,), the response to these (6 n, c), and that to one standard deviation of
    shared errors (6 n, m).
    """
    patch = at.patch(first, last)
    index, coupling = coupling_of(at, patch)
    parts = [coupling]
    alike = np.zeros(3) if errors is None else errors.common(first, last)
    if alike.any():
        parts.append((patch.shifts * np.sqrt(alike)[:, None, None]).reshape(len(coupling), -1))
    if stiffness is None:
        response = cho_solve((factor_of(at, patch, first, last), True), np.hstack(parts), check_finite=False)
        return index, response[:, : len(index)], response[:, len(index) :]
    alone = _inverse_blocks(patch.own.sum(1) + at.prior[first:last] + stiffness[first:last])
    response = (alone @ np.hstack(parts).reshape(len(alone), LANDMARK_SIZE, -1)).reshape(len(parts[0]), -1)
    response = response.astype(np.float32)
    by_common, shared = response[:, : len(index)], response[:, len(index) :]
    # Errors of brightness that a neighbourhood or a view shares move a landmark by the error over its own image
    # gradient, whose sign changes from one landmark to the next: smoothness, left out here, averages that away.
    photometric = (index % VIEW_SIZE >= _PHOTOMETRIC) | (index >= at.of_views)
    by_common.reshape(last - first, LANDMARK_SIZE, -1)[:, :3, photometric] = 0.0
    if alike.any():
        shared.reshape(last - first, LANDMARK_SIZE, -1, 3)[:, :3, :, 2] = 0.0
    return index, by_common, shared


def stiffness_of(links: Links, count: int) -> np.ndarray:
    """(J, 6, 6) smoothness where neighbours make the same move, as they do when a view moves: it holds the normal
    alone."""
    turn = links.rows[:, 3:]
    out = np.zeros((count, LANDMARK_SIZE, LANDMARK_SIZE))
    np.add.at(out[:, 3:5, 3:5], links.source, turn[:, :, None] * turn[:, None, :])
    return out


def _inverse_blocks(blocks: np.ndarray) -> np.ndarray:
    """Of (n, 6, 6)."""
    size = np.sqrt(np.einsum("naa->na", blocks))
    size = np.where(size > 0, size, 1.0)
    scaled = blocks / (size[:, :, None] * size[:, None, :])
    np.einsum("naa->na", scaled)[:] = 1.0 + RIDGE
    return np.linalg.inv(scaled) / (size[:, :, None] * size[:, None, :])


def _products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of a (6n, m) and b (6n, m): a_j b_j^T (n, 6, 6)."""
    shape = (len(a) // LANDMARK_SIZE, LANDMARK_SIZE, a.shape[1])
    return a.reshape(shape) @ np.swapaxes(b.reshape(shape), 1, 2)


def _forget_unmeasured(landmark: np.ndarray, own: np.ndarray, links: Links) -> None:
    """Variances (J, 6, 6), infinite for coordinates that no factor determines, alone or together with others."""
    information = np.einsum("jaa->ja", own).copy()
    np.add.at(information, (links.source[:, None], np.arange(3, 5)), links.rows[:, 3:] ** 2)
    variance = np.einsum("jaa->ja", landmark)
    j, a = np.nonzero((information == 0.0) | (variance * information > UNMEASURED))
    landmark[j, a, :] = landmark[j, :, a] = 0.0
    landmark[j, a, a] = np.inf
