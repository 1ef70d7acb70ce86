"""The damped normal equations of one step: product and preconditioner, and how all else follows the parameters."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np

from photoclinometry.adjust.graph.general import Rows, information_of_views
from photoclinometry.adjust.graph.graph import Linearization
from photoclinometry.adjust.solve.blocks import invert_blocks
from photoclinometry.adjust.solve.directions import add_combination, shares
from photoclinometry.adjust.solve.krylov import conjugate_gradients
from photoclinometry.adjust.solve.preconditioner import solve_approximately

COARSE_ITERATIONS, COARSE_ENOUGH = 40, 0.1
"""Most conjugate-gradient iterations for the response of the other variables to a reflectance parameter; they end
earlier if they would change less than this share of the parameter's cost with that response."""

COARSE_TRUNCATION = 1e-3
"""Share of the mean gain of an iteration below which those iterations end."""

SINGLE_EPSILON = float(np.finfo(np.float32).eps)
"""Rounding of single precision."""


class DampedSystem:
    """(H + damping diag(H)) of one linearization, for vectors (10 K + 6 J + T,), float32."""

    def __init__(self, at: Linearization, damping: float, of_landmarks: np.ndarray, low: float, degree: int):
        """of_landmarks: (J,) damping of each landmark, where it is more than that of all. low, degree: of the Chebyshev
        polynomial, see `preconditioner.solve_approximately`."""
        self.at, self.low, self.degree = at, low, degree
        border, diagonal, of_landmarks = at.border.block, at.diagonal, np.maximum(of_landmarks, damping)
        share = np.full(len(diagonal), damping)
        at.split(share)[1][:] = of_landmarks[:, None]
        self.added = (share * diagonal).astype(np.float32)
        self.parameter_inverse = np.linalg.inv(border + damping * np.diag(np.diag(border)))
        self.view_inverse, self.coupled = _inverse_of_views(at, damping)
        self.landmark_inverse = np.empty(at.landmarks.block.shape, np.float32)
        invert_blocks(at.landmarks.block, of_landmarks, self.landmark_inverse)
        self.coarse, self.coarse_inverse = np.zeros((0, len(self.added)), np.float32), np.zeros((0, 0))

    def treat_exactly(self, directions: np.ndarray) -> None:
        """From now on the preconditioner solves for directions (T, 10 K + 6 J + T) exactly.

        Along them the cost hardly changes, so that single precision may make this small change negative. It is never
        less than the information of the parameters' priors.
        """
        information = self.along(directions)
        value, vector = np.linalg.eigh(0.5 * (information + information.T))
        least = max(np.min(np.diag(self.at.parameter_rest)), SINGLE_EPSILON * value[-1])
        self.coarse, self.coarse_inverse = directions, (vector / np.maximum(value, least)) @ vector.T

    def along(self, directions: np.ndarray) -> np.ndarray:
        """The equations (T, T) of the steps along directions (T, 10 K + 6 J + T)."""
        products = np.array([self.multiply(direction) for direction in directions])
        return np.einsum("tn,un->tu", directions, products, dtype=float)

    def multiply(self, vector: np.ndarray) -> np.ndarray:
        return self.at.multiply(vector) + self.added * vector

    def multiply_others(self, vector: np.ndarray) -> np.ndarray:
        """`multiply` with the parameters held."""
        out = self.multiply(vector)
        out[len(out) - len(self.parameter_inverse) :] = 0.0
        return out

    def precondition(self, vector: np.ndarray) -> np.ndarray:
        out = np.empty_like(vector)
        view, landmark, parameter = self.at.split(vector)
        view_out, landmark_out, parameter_out = self.at.split(out)
        view_out[:] = np.einsum("kij,kj->ki", self.view_inverse, view)
        if self.coupled is not None:
            which, inverse = self.coupled
            view_out[which] = (inverse @ view[which].ravel()).reshape(-1, view.shape[1])
        rows, inverse = self.at.smooth.rows, self.landmark_inverse
        landmark_out[:] = solve_approximately(self.at.neighbours, rows, inverse, landmark, self.degree, self.low)
        parameter_out[:] = self.parameter_inverse @ parameter
        if len(self.coarse):
            along = np.empty((numba.get_num_threads(), len(self.coarse)))
            shares(self.coarse, vector, along)
            add_combination(self.coarse, (self.coarse_inverse @ along.sum(0)).astype(np.float32), out)
        return out


def _inverse_of_views(at: Linearization, damping: float) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None]:
    """Of the views' damped blocks (K, 10, 10); and the views (n,) that factors couple with each other, with the inverse
    (10 n, 10 n) of all these together, None where there are none.

    The information of such factors on all views at once may be far weaker than on each alone, and this part then
    converges last.
    """
    block = at.views.block.copy()
    np.einsum("kii->ki", block)[:] *= 1.0 + damping
    coupling = [rows for rows in at.several if rows.couple_views]
    if not coupling:
        return np.linalg.inv(block), None
    which = np.unique(np.concatenate([touch.index for rows in coupling for touch in rows.touches]))
    place = np.zeros(len(block), int)
    place[which] = np.arange(len(which))
    among = [
        Rows(rows.residual, tuple(replace(touch, index=place[touch.index]) for touch in rows.touches))
        for rows in coupling
    ]
    alone = at.views.block[which]
    for rows in among:
        for touch in rows.touches:
            np.subtract.at(alone, touch.index, np.einsum("nri,nrj->nij", touch.jacobian, touch.jacobian))
    whole = information_of_views(alone, among)
    np.einsum("ii->i", whole)[:] *= 1.0 + damping
    return np.linalg.inv(block), (which, np.linalg.inv(whole))


def parameter_moves(system: DampedSystem, before: np.ndarray | None) -> np.ndarray:
    """Moves of all variables (T, 10 K + 6 J + T) in response to a reflectance parameter.

    These are directions in which the cost hardly changes, since albedos and scales compensate for the parameter.
    before: the moves at another point, from which to start.
    """
    count = len(system.parameter_inverse)
    moves = np.zeros((count, len(system.added)), np.float32) if before is None else before.copy()
    for t in range(count):
        moves[t, t - count] = 1.0
        pull = system.multiply(moves[t])
        left = max(float(np.vdot(moves[t], pull)), float(system.at.parameter_rest[t, t]))
        pull[-count:] = 0.0
        moves[t] -= conjugate_gradients(
            system.multiply_others,
            system.precondition,
            pull,
            max_iterations=COARSE_ITERATIONS,
            truncation=COARSE_TRUNCATION,
            enough=COARSE_ENOUGH * left,
        ).x
    return moves
