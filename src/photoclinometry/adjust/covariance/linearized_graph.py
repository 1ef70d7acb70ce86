"""A factor graph at its minimum: all that its covariances depend on, and the motions that images leave open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from photoclinometry.adjust.covariance.information import EstimatedReflectance, Observed, Patch, observed_patch
from photoclinometry.adjust.covariance.windows import Links, links
from photoclinometry.adjust.graph.general import Rows, Touch, information_of_views
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import states
from photoclinometry.adjust.graph.slot import LandmarkState, ViewState
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE, Estimate
from photoclinometry.model.geometry import skew

SIMILARITY = 7
"""Numbers that images alone leave open: rotation 3, translation 3, scale 1."""

LOOSE = 1e-4
"""In the map's own frame the prior that holds one landmark counts this much: enough for the scale, too little to make
its surroundings look known."""


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
    """(10 K + T, 10 K + T) information on views and reflectance parameters from Suns and priors."""
    prior: np.ndarray
    """(J, 6, 6) information on landmarks from priors."""
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
        return VIEW_SIZE * len(self.view_state.scale)

    def patch(self, first: int, last: int) -> Patch:
        more = [part for rows in self.several if (part := _within(rows, first, last)) is not None]
        views = np.concatenate([np.zeros(0, int), *(touch.index for rows in more for touch in rows.touches[1:])])
        patch = observed_patch(first, last, self.view_state, self.points, self.observed, self.pivot, self.model, views)
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
        prior=rest["landmark"].rest.astype(float),
        several=tuple(rows for rows in several if not rows.couple_views),
        pivot=estimate.pivot,
        model=EstimatedReflectance(observations.parameter_vector_at(estimate), scale),
    )


def loosely_held(at: LinearizedGraph) -> LinearizedGraph:
    """With little of the priors on positions."""
    prior = at.prior.copy()
    prior[:, :3, :3] *= LOOSE
    return replace(at, prior=prior)


def point_moves(points: np.ndarray, about: np.ndarray) -> np.ndarray:
    """(n, 3, 7): how points (n, 3) move by rotation, translation and scale about a point (3,)."""
    arm = points - about
    return np.concatenate([-skew(arm), np.broadcast_to(np.eye(3), (len(arm), 3, 3)), arm[:, :, None]], axis=2)


def landmark_moves(at: LinearizedGraph, first: int, last: int) -> np.ndarray:
    """(n, 6, 7): local coordinates of landmarks first:last by rotation, translation and scale about the pivot."""
    out = np.zeros((last - first, LANDMARK_SIZE, SIMILARITY))
    out[:, :3] = point_moves(at.points.position[first:last], at.pivot)
    turned = skew(at.points.normal[first:last])
    out[:, 3:5, :3] = -np.einsum("jia,jib->jab", at.points.normal_basis[first:last], turned)
    return out


def view_moves(at: LinearizedGraph) -> np.ndarray:
    """(10 K + T, 7): local coordinates of views likewise; reflectance parameters stay as they are."""
    view_state = at.view_state
    moved = np.zeros((len(at.common_prior), SIMILARITY))
    out = moved[: at.of_views].reshape(-1, VIEW_SIZE, SIMILARITY)
    out[:, range(3), range(3)] = 1.0
    out[:, range(3, 6), range(3, 6)] = 1.0
    out[:, 3:6, 6] = view_state.center - at.pivot
    out[:, 6:8, :3] = -np.einsum("kia,kib->kab", view_state.sun_basis, skew(view_state.sun))
    return moved


def _within(rows: Rows, first: int, last: int) -> Rows | None:
    """The factors of landmarks first:last, counted from `first`, the landmark's derivatives first; None without any.

    Raises ValueError for factors that do not touch one landmark and one view.
    """
    by_kind = {touch.variable: touch for touch in rows.touches}
    if len(rows.touches) != 2 or set(by_kind) != {"landmark", "view"}:
        raise ValueError("covariances know general factors of one variable, of views, or of one landmark and one view")
    landmark, view = by_kind["landmark"], by_kind["view"]
    mine = np.flatnonzero((landmark.index >= first) & (landmark.index < last))
    if not len(mine):
        return None
    return Rows(
        rows.residual[mine],
        (
            Touch("landmark", landmark.index[mine] - first, landmark.jacobian[mine]),
            Touch("view", view.index[mine], view.jacobian[mine]),
        ),
    )


def _add_general(rows: Rows, patch: Patch) -> None:
    """Adds the factors of `_within` to a patch's blocks."""
    landmark, view = rows.touches
    slot = np.searchsorted(patch.views, view.index)
    for n in range(len(rows.residual)):
        by_landmark, by_view, j, s = landmark.jacobian[n], view.jacobian[n], landmark.index[n], slot[n]
        patch.own[j, 0] += by_landmark.T @ by_landmark
        patch.coupling[j, :, s, :] += by_landmark.T @ by_view
        patch.view_block[s] += by_view.T @ by_view
