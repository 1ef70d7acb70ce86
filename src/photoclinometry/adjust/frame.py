"""The frame of a map: the similarity of all of it that what is known of its place, attitude and size fits best.

Images leave a similarity open. Priors, control points and an altimeter tell it, and nothing else does, so that it has a
minimum of its own, of seven numbers and the systematic errors. To the joint estimate it is a slow motion of all
variables together, on whose way the cost hardly falls from step to step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from photoclinometry.adjust.graph.general import FactorGroup, Rows
from photoclinometry.adjust.graph.similarity import SIMILARITY, landmark_moves, view_moves
from photoclinometry.adjust.graph.variables import VIEW_SIZE, Estimate
from photoclinometry.model.geometry import tangent_basis

_ITERATIONS = 30
"""Of Gauss-Newton at most; shots of an altimeter meet other landmarks after each."""
STILL = 1e-3
"""They end where no landmark moves by more than this share of the distance between landmarks."""


def in_its_frame(estimate: Estimate, groups: Callable[[Estimate], Sequence[FactorGroup]], spacing: float) -> Estimate:
    """The estimate turned, shifted and scaled as a whole, and its systematic errors, for the least cost of `groups`.

    groups: those that tell the frame, at an estimate; spacing: of landmarks. What they do not determine stays.
    """
    every = np.arange(len(estimate.landmarks))
    for _ in range(_ITERATIONS):
        size = SIMILARITY + estimate.systematic.size
        information, gradient = np.zeros((size, size)), np.zeros(size)
        by_view = _view_moves(estimate)
        for group in groups(estimate):
            for rows in group.rows(estimate):
                _add(rows, estimate, by_view, information, gradient)
        scale = _scale(information)
        step = -scale * (np.linalg.pinv(information * np.outer(scale, scale), hermitian=True) @ (scale * gradient))
        similarity, systematic = step[:SIMILARITY], step[SIMILARITY:].reshape(-1, VIEW_SIZE)
        landmark = _landmark_moves(estimate, every) @ similarity
        estimate = estimate.step(np.concatenate([by_view @ similarity, systematic]), landmark)
        if np.linalg.norm(landmark[:, :3], axis=1).max() < STILL * spacing:
            break
    return estimate


def _view_moves(estimate: Estimate) -> np.ndarray:
    """(K, 10, 7): how views move with the similarity."""
    sun = estimate.views.sun
    return view_moves(estimate.views.body_from_cam.translation, sun, tangent_basis(sun), estimate.pivot)


def _landmark_moves(estimate: Estimate, which: np.ndarray) -> np.ndarray:
    """(n, 6, 7): how landmarks `which` (n,) do."""
    own = estimate.landmarks[which]
    return landmark_moves(own.position, own.normal, tangent_basis(own.normal), estimate.pivot)


def _add(rows: Rows, estimate: Estimate, by_view: np.ndarray, information: np.ndarray, gradient: np.ndarray) -> None:
    """Adds J^T J and J^T r of factors by similarity and systematic errors."""
    by_frame = np.zeros((*rows.residual.shape, SIMILARITY))
    shared = []
    for touch in rows.touches:
        if touch.variable == "view":
            by_frame += touch.jacobian @ by_view[touch.index]
        elif touch.variable == "landmark":
            by_frame += touch.jacobian @ _landmark_moves(estimate, touch.index)
        elif touch.variable == "systematic":
            shared.append(touch)
    frame = slice(SIMILARITY)
    information[frame, frame] += np.einsum("nri,nrj->ij", by_frame, by_frame)
    gradient[frame] += np.einsum("nri,nr->i", by_frame, rows.residual)
    for touch in shared:
        own = SIMILARITY + VIEW_SIZE * touch.index[:, None] + np.arange(touch.jacobian.shape[2])
        np.add.at(gradient, own, np.einsum("nri,nr->ni", touch.jacobian, rows.residual))
        squares = np.einsum("nri,nrj->nij", touch.jacobian, touch.jacobian)
        np.add.at(information, (own[:, :, None], own[:, None, :]), squares)
        crossed = np.zeros((len(gradient), SIMILARITY))
        np.add.at(crossed, own, np.einsum("nri,nrj->nij", touch.jacobian, by_frame))
        information[:, frame] += crossed
        information[frame] += crossed.T


def _scale(information: np.ndarray) -> np.ndarray:
    """(n,) one over the root of each diagonal element; zero where nothing is told."""
    size = np.sqrt(np.diag(information))
    return np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
