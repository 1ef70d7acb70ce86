"""A factor graph at its minimum, with all inputs of its covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from photoclinometry.adjust.covariance.information import EstimatedReflectance, Observed, Patch, observed_patch
from photoclinometry.adjust.covariance.windows import Links, links
from photoclinometry.adjust.graph.general import JacobianBlock, Rows, information_of_views
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import states
from photoclinometry.adjust.graph.similarity import SIMILARITY, landmark_moves, view_moves
from photoclinometry.adjust.graph.slot import LandmarkState, ViewState
from photoclinometry.adjust.graph.variables import VIEW_SIZE, Estimate

LOOSE = 1e-4
"""Weight, in the map's own frame, of the prior that holds one landmark: enough to fix the scale, too little to make the
landmark's surroundings look known."""


@dataclass(frozen=True, kw_only=True)
class LinearizedGraph:
    """A joint estimate at its minimum: all that its covariances depend on."""

    view_state: ViewState
    points: LandmarkState
    observed: Observed
    links: Links
    """Smoothness."""
    smooth_residual: np.ndarray
    """(P,) of smoothness, whitened."""
    common_prior: np.ndarray
    """(10 K + T, 10 K + T) information on views and reflectance parameters from Suns and priors. Systematic errors
    count among the K views here, after those."""
    prior: np.ndarray
    """(J, 6, 6) information on landmarks from general factors, such as priors."""
    several: tuple[Rows, ...]
    """General factors that touch a landmark and a view."""
    pivot: np.ndarray
    """(3,) as in `Estimate`."""
    model: EstimatedReflectance

    def __len__(self) -> int:
        return len(self.prior)

    @property
    def of_views(self) -> int:
        """10 K, the numbers of all views; those of the T estimated reflectance parameters follow them."""
        return len(self.common_prior) - len(self.model.scale)

    def landmark_moves(self, first: int, last: int) -> np.ndarray:
        """(n, 6, 7): local coordinates of landmarks first:last by a similarity about the pivot."""
        own = slice(first, last)
        return landmark_moves(
            self.points.position[own], self.points.normal[own], self.points.normal_basis[own], self.pivot
        )

    def view_moves(self) -> np.ndarray:
        """(10 K + T, 7): local coordinates of views likewise; systematic errors and reflectance parameters stay."""
        state, out = self.view_state, np.zeros((len(self.common_prior), SIMILARITY))
        moves = view_moves(state.center, state.sun, state.sun_basis, self.pivot)
        out[: VIEW_SIZE * len(moves)] = moves.reshape(-1, SIMILARITY)
        return out

    def landmark_pull(self, first: int, last: int, by_view: np.ndarray) -> np.ndarray:
        """(6 n, 7): J^T J times a similarity of views and landmarks, at landmarks first:last.

        Only general factors contribute, since images do not change under a similarity. by_view: `view_moves`.
        """
        by_landmark = self.landmark_moves(first, last)
        pull = self.prior[first:last] @ by_landmark
        for rows in self.several:
            mine = _within(rows, first, last)
            if mine is not None:
                landmark, view = mine.touches
                along = view.jacobian @ _of_views(by_view, view.index)
                np.add.at(pull, landmark.index, np.swapaxes(landmark.jacobian, 1, 2) @ along)
        return pull.reshape(-1, SIMILARITY)

    def common_pull(self, by_view: np.ndarray) -> np.ndarray:
        """(10 K + T, 7): likewise at views, of general factors that touch landmarks, too."""
        out = np.zeros_like(by_view)
        if not self.several:
            return out
        by_landmark = self.landmark_moves(0, len(self))
        for rows in self.several:
            mine = _within(rows, 0, len(self))
            if mine is not None:
                landmark, view = mine.touches
                along = view.jacobian @ _of_views(by_view, view.index) + landmark.jacobian @ by_landmark[landmark.index]
                pull = out[: self.of_views].reshape(-1, VIEW_SIZE, SIMILARITY)
                np.add.at(pull, view.index, np.swapaxes(view.jacobian, 1, 2) @ along)
        return out

    def patch(self, first: int, last: int) -> Patch:
        more = [part for rows in self.several if (part := _within(rows, first, last)) is not None]
        views = np.concatenate([np.zeros(0, int), *(touch.index for rows in more for touch in rows.touches[1:])])
        count = self.of_views // VIEW_SIZE
        patch = observed_patch(
            first, last, self.view_state, self.points, self.observed, self.pivot, self.model, views, count
        )
        for rows in more:
            _add_general(rows, patch)
        return patch


def linearized_graph(graph: FactorGraph, estimate: Estimate) -> LinearizedGraph:
    """A graph at an estimate: all that its covariances depend on."""
    view_state, landmarks = states(estimate.views, estimate.landmarks)
    observations, tracks = graph.observations, graph.observations.table.tracks
    smooth = graph.smoothness.linearize(estimate, float)
    brightness, gradient = observations.brightness_at_origin_and_gradient
    rest, several = graph.general_part(estimate)
    of_views = information_of_views(rest["view"].rest, [rows for rows in several if rows.couple_views])
    with_landmarks = tuple(rows for rows in several if not rows.couple_views)
    prior = rest["landmark"].rest.astype(float)
    _add_landmark_blocks(with_landmarks, prior)
    reflectance, plain = graph.reflectance, np.ascontiguousarray
    scale = np.zeros(0) if reflectance is None or not len(estimate.parameters) else reflectance.parameter_scale
    return LinearizedGraph(
        view_state=view_state,
        points=landmarks,
        observed=Observed(
            plain(tracks.start),
            plain(tracks.view),
            plain(tracks.keypoint),
            plain(brightness),
            plain(gradient),
            observations.keypoint_weight,
            observations.brightness_weight,
            observations.keypoint_limit,
            observations.brightness_limit,
        ),
        links=links(smooth.neighbours, smooth.rows),
        smooth_residual=smooth.residual,
        common_prior=np.asarray(block_diag(of_views, rest["parameter"].rest[0])),
        prior=prior,
        several=with_landmarks,
        pivot=estimate.pivot,
        model=EstimatedReflectance(observations.parameter_vector_at(estimate), scale),
    )


def loosely_held(at: LinearizedGraph) -> LinearizedGraph:
    """With little of the priors on positions."""
    prior = at.prior.copy()
    prior[:, :3, :3] *= LOOSE
    return replace(at, prior=prior)


def _of_views(moves: np.ndarray, index: np.ndarray) -> np.ndarray:
    """(n, 10, 7) of views `index` (n,) of moves (10 K + T, 7)."""
    return moves[VIEW_SIZE * index[:, None] + np.arange(VIEW_SIZE)]


def _within(rows: Rows, first: int, last: int) -> Rows | None:
    """The factors of landmarks first:last, counted from `first`, the landmark's derivatives first; None without any.

    Raises ValueError for factors that do not touch one landmark and one view or systematic error.
    """
    by_kind = {touch.variable: touch for touch in rows.touches}
    if len(rows.touches) != 2 or set(by_kind) != {"landmark", "view"}:
        raise ValueError(
            "covariances know general factors of one variable, of views and systematic errors, or of one landmark and "
            "one of these"
        )
    landmark, view = by_kind["landmark"], by_kind["view"]
    mine = np.flatnonzero((landmark.index >= first) & (landmark.index < last))
    if not len(mine):
        return None
    return Rows(
        rows.residual[mine],
        (
            JacobianBlock("landmark", landmark.index[mine] - first, landmark.jacobian[mine]),
            JacobianBlock("view", view.index[mine], view.jacobian[mine]),
        ),
    )


def _add_landmark_blocks(several: Sequence[Rows], prior: np.ndarray) -> None:
    """Adds the landmarks' own blocks (J, 6, 6) of factors that touch a landmark and something else."""
    for rows in several:
        for touch in rows.touches:
            if touch.variable == "landmark":
                np.add.at(prior, touch.index, np.einsum("nri,nrj->nij", touch.jacobian, touch.jacobian))


def _add_general(rows: Rows, patch: Patch) -> None:
    """Adds the factors of `_within` to a patch's blocks, but for the landmarks' own (`LinearizedGraph.prior`)."""
    landmark, view = rows.touches
    slot = np.searchsorted(patch.views, view.index)
    for n in range(len(rows.residual)):
        by_landmark, by_view, j, s = landmark.jacobian[n], view.jacobian[n], landmark.index[n], slot[n]
        patch.coupling[j, :, s, :] += by_landmark.T @ by_view
        patch.view_block[s] += by_view.T @ by_view
