"""The frame of a map: the similarity that best fits the known place, attitude and size of the map.

Images leave a similarity open. Only priors, control points and an altimeter determine it, so that it has a minimum of
its own, of seven numbers and the systematic errors. In the joint estimate it is a slow motion of all variables
together, along which the cost hardly falls from step to step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust.graph.general import FactorGroup, JacobianBlock, Rows
from photoclinometry.adjust.graph.similarity import SIMILARITY, landmark_moves, view_moves
from photoclinometry.adjust.graph.variables import VIEW_SIZE, Estimate
from photoclinometry.model.gauss_newton import MOST_ITERATIONS
from photoclinometry.model.geometry import tangent_basis

STILL = 1e-3
"""Gauss-Newton ends where no landmark moves by more than this share of the distance between landmarks."""


def in_its_frame(estimate: Estimate, groups: Callable[[Estimate], Sequence[FactorGroup]], spacing: float) -> Estimate:
    """The estimate turned, shifted and scaled as a whole, and its systematic errors, for the least cost of `groups`.

    groups: those that determine the frame, at an estimate; spacing: of landmarks. Numbers that they leave undetermined
    stay.
    """
    every = np.arange(len(estimate.landmarks))
    for _ in range(MOST_ITERATIONS):
        equations, by_view = _Equations.none(len(estimate.systematic)), _view_moves(estimate)
        for group in groups(estimate):
            for rows in group.rows(estimate):
                _add(rows, estimate, by_view, equations)
        similarity, systematic = equations.solved()
        landmark = _landmark_moves(estimate, every) @ similarity
        estimate = estimate.step(np.concatenate([by_view @ similarity, systematic]), landmark)
        if np.linalg.norm(landmark[:, :3], axis=1).max() < STILL * spacing:
            break
    return estimate


@dataclass(frozen=True)
class _Equations:
    """J^T J and J^T r by the similarity, and by systematic errors, each of which is coupled with the similarity alone:
    a factor touches one of them at most."""

    frame: np.ndarray
    """(7, 7)."""
    frame_gradient: np.ndarray
    """(7,)."""
    shared: np.ndarray
    """(M, 10, 10)."""
    crossed: np.ndarray
    """(M, 10, 7)."""
    gradient: np.ndarray
    """(M, 10)."""

    @classmethod
    def none(cls, count: int) -> _Equations:
        return cls(
            np.zeros((SIMILARITY, SIMILARITY)),
            np.zeros(SIMILARITY),
            np.zeros((count, VIEW_SIZE, VIEW_SIZE)),
            np.zeros((count, VIEW_SIZE, SIMILARITY)),
            np.zeros((count, VIEW_SIZE)),
        )

    def solved(self) -> tuple[np.ndarray, np.ndarray]:
        """The step of the similarity (7,), and of the systematic errors (M, 10), which are eliminated first.

        Undetermined numbers stay.
        """
        inverse = _inverses(self.shared)
        through = inverse @ self.crossed
        own = np.einsum("mij,mj->mi", inverse, self.gradient)
        left = self.frame - np.einsum("mia,mib->ab", self.crossed, through)
        pull = self.frame_gradient - np.einsum("mia,mi->a", self.crossed, own)
        similarity = -_inverses(left[None])[0] @ pull
        return similarity, -own - through @ similarity


def _view_moves(estimate: Estimate) -> np.ndarray:
    """(K, 10, 7): moves of views with the similarity."""
    sun = estimate.views.sun
    return view_moves(estimate.views.body_from_cam.translation, sun, tangent_basis(sun), estimate.pivot)


def _landmark_moves(estimate: Estimate, which: np.ndarray) -> np.ndarray:
    """(n, 6, 7): moves of landmarks `which` (n,) with it."""
    own = estimate.landmarks[which]
    return landmark_moves(own.position, own.normal, tangent_basis(own.normal), estimate.pivot)


def _add(rows: Rows, estimate: Estimate, by_view: np.ndarray, equations: _Equations) -> None:
    """Adds the factors of `rows` to the equations."""
    by_frame = np.zeros((*rows.residual.shape, SIMILARITY))
    shared: JacobianBlock | None = None
    for touch in rows.touches:
        if touch.variable == "view":
            by_frame += touch.jacobian @ by_view[touch.index]
        elif touch.variable == "landmark":
            by_frame += touch.jacobian @ _landmark_moves(estimate, touch.index)
        elif touch.variable == "systematic":
            shared = touch
    equations.frame[:] += np.einsum("nri,nrj->ij", by_frame, by_frame)
    equations.frame_gradient[:] += np.einsum("nri,nr->i", by_frame, rows.residual)
    if shared is not None:
        own, index = slice(shared.jacobian.shape[2]), shared.index
        squares = np.einsum("nri,nrj->nij", shared.jacobian, shared.jacobian)
        np.add.at(equations.shared[:, own, own], index, squares)
        np.add.at(equations.crossed[:, own], index, np.einsum("nri,nrj->nij", shared.jacobian, by_frame))
        np.add.at(equations.gradient[:, own], index, np.einsum("nri,nr->ni", shared.jacobian, rows.residual))


def _inverses(blocks: np.ndarray) -> np.ndarray:
    """Pseudoinverses (n, d, d) of symmetric blocks, of any units."""
    size = np.sqrt(np.einsum("naa->na", blocks))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    outer = scale[:, :, None] * scale[:, None, :]
    return outer * np.linalg.pinv(blocks * outer, hermitian=True)
