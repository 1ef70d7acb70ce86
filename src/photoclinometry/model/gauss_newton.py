"""Gauss-Newton steps for a few parameters on a manifold (rotations, directions): dense, with normal equations.

The loss's weights are part of the linearization (`robust.huber_weight`): each iteration is one of reweighted least
squares. The joint estimate has its own solver; this one serves fits of a handful of numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np

State = TypeVar("State")

MOST_ITERATIONS = 30
"""Most iterations of fits of a few numbers: the adjustment of a camera's lens, the largest of them, takes 3 to 10."""

SETTLED = 1e-10
"""A step settles the estimate if its square in standard deviations is below this: 1e-5 sigma."""


class Solution(NamedTuple, Generic[State]):
    """The outcome of `gauss_newton`."""

    state: State
    information: np.ndarray
    """(m, m) of the last linearization, at the start of the last step; its inverse is the covariance if residuals are
    whitened."""
    converged: bool
    """The last step was below SETTLED; else `iterations` were used up."""


def gauss_newton(
    start: State,
    linearize: Callable[[State], tuple[np.ndarray, np.ndarray]],
    move: Callable[[State, np.ndarray], State],
    *,
    iterations: int = MOST_ITERATIONS,
    longest: float | np.ndarray = np.inf,
) -> Solution[State]:
    """The state of least cost near `start`, by at most `iterations` steps -information^-1 gradient.

    linearize: state -> gradient (m,) and information (m, m) of half the cost: J^T W r and J^T W J for whitened
    residuals r, their derivatives J and weights W, priors included. move: the state after a step (m,). longest: bound
    on the size of each of the step's components, (m,) or one for all; a longer step is shortened as a whole.
    Raises numpy.linalg.LinAlgError where the information is singular.
    """
    state, converged = start, False
    information = np.empty((0, 0))
    for _ in range(iterations):
        gradient, information = linearize(state)
        step = -np.linalg.solve(information, gradient)
        step = step / max(1.0, float(np.max(np.abs(step) / longest)))
        state = move(state, step)
        # Steps are judged in standard deviations, since the parameters have no unit in common.
        converged = bool(step @ information @ step < SETTLED)
        if converged:
            break
    return Solution(state, information, converged)
