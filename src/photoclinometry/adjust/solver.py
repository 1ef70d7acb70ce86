"""Levenberg-Marquardt with preconditioned conjugate gradients on the full, damped normal equations.

    (H + damping diag(H)) x = -g

H is never formed: observations are multiplied through their stored rows (`kernels.multiply`), smoothness pair
by pair. The preconditioner is each view's 10 x 10 block and, for landmarks, a Chebyshev polynomial that deals
with the coupling of neighbours, which is what makes this problem stiff. (An exact Schur complement onto the
cameras did not lower the count of iterations.)

Two safeguards keep it from stalling. A landmark's step is cut to half a ground sample: the smoothness residual
saturates, and one landmark that leaps becomes a spike that spoils every later step of all. And damping may fall far:
turning and shifting a narrow-field camera are nearly the same. Where a step fails, a shorter one along the same
direction is tried before damping has to rise.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust.problem import COST_TERMS, Estimate, NormalEquations, Problem
from photoclinometry.adjust.smoothing import apply_blocks, multiply_landmarks, solve_approximately
from photoclinometry.errors import NotConvergedError

log = logging.getLogger(__name__)

MAX_TURN = 0.5
"""A normal turns by this at most in one step [rad]."""

MAX_GLOBAL_TURN = 0.05
"""A Sun, or a camera about the map, turns by this at most in one step [rad]."""


@dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """How the minimum is sought; results do not depend on these but for the last digits."""

    max_steps: int = 30
    """Levenberg-Marquardt steps at most."""
    relative_decrease: float = 1e-5
    """Converged when two successive steps lower the cost by less than this share."""
    initial_damping: float = 1e-5
    """Added to the diagonal of the normal equations, relative to it."""
    min_damping: float = 1e-12
    """Damping never falls below this."""
    cg_tolerance: float = 1e-2
    """A linear solve ends when its preconditioned residual has fallen by this factor (0.1 was too lax)."""
    max_cg_iterations: int = 200
    """Conjugate-gradient iterations at most, per step."""
    chebyshev_degree: int = 8
    """Degree of the landmarks' preconditioner."""
    chebyshev_low: float = 0.04
    """Lower end of the eigenvalues that it treats, out of (0, 2]."""


@dataclass(frozen=True)
class Iteration:
    """One line of the convergence log."""

    cost: dict[str, float]
    """By kind of factor, after the step."""
    damping: float
    cg_iterations: int
    accepted: bool
    position_step: float
    """Root mean square of the landmarks' steps, in units of B."""
    wall_s: float
    cpu_s: float

    @property
    def total(self) -> float:
        return sum(self.cost.values())


@dataclass(frozen=True)
class Solution:
    """The estimate and how it was reached. Not converging is a status, not an exception."""

    estimate: Estimate
    converged: bool
    message: str
    log: tuple[Iteration, ...]
    """The first entry is the start."""

    @property
    def cost(self) -> dict[str, float]:
        return [i for i in self.log if i.accepted][-1].cost


def minimize(
    problem: Problem,
    start: Estimate,
    options: SolverOptions | None = None,
    *,
    step_limit: float = np.inf,
    progress: Callable[[Iteration], None] | None = None,
    throw: bool = False,
) -> Solution:
    """The estimate of least cost near `start`.

    step_limit: longest step of a landmark, in units of B (half a ground sample). progress is called after
    every step; what it raises ends the solve. throw: raise NotConvergedError instead of returning a status.
    """
    options = options or SolverOptions()
    estimate, damping = start, options.initial_damping
    cost, equations = problem.linearize(estimate)
    history = [_iteration(cost, damping, 0, True, 0.0, 0.0, 0.0)]
    small, growth = 0, 4.0
    message = f"no convergence within {options.max_steps} steps"
    for _ in range(options.max_steps):
        wall, cpu = time.perf_counter(), time.process_time()
        camera, landmark, iterations = _solve(problem, equations, damping, options)
        promised = _promised_decrease(equations, damping, camera, landmark)
        candidate, new_cost, share, moved = _descend(problem, estimate, float(cost.sum()), camera, landmark, step_limit)
        accepted = bool(new_cost.sum() <= cost.sum())
        if accepted:
            expected = promised * share * (2.0 - share)
            gain = share * (cost.sum() - new_cost.sum()) / expected if expected > 0 else 1.0
            decrease = 1.0 - new_cost.sum() / cost.sum() if cost.sum() > 0 else 0.0
            small = small + 1 if decrease < options.relative_decrease else 0
            estimate, growth = candidate, 4.0
            cost, equations = problem.linearize(estimate)
            used, damping = damping, max(damping * _relief(gain), options.min_damping)
        else:
            used, damping = damping, damping * growth
            growth *= 2.0
        spent = time.perf_counter() - wall, time.process_time() - cpu
        history.append(_iteration(cost if accepted else new_cost, used, iterations, accepted, moved, *spent))
        if progress is not None:
            progress(history[-1])
        log.debug("step %d: %s", len(history) - 1, history[-1])
        if small == 2:
            message = f"converged: two steps lowered the cost by less than {options.relative_decrease:g}"
            break
        if damping > 1e8:
            # no downhill step however short: the cost is flat to rounding
            message, small = "converged: no step lowers the cost", 2
            break
    converged = small == 2
    if throw and not converged:
        raise NotConvergedError(message)
    return Solution(estimate, converged, message, tuple(history))


def _promised_decrease(equations: NormalEquations, damping: float, camera: np.ndarray, landmark: np.ndarray) -> float:
    """By how much the linear model lowers the cost along the solution of the damped equations."""
    damped = np.einsum("kcc,kc->", equations.camera_block, camera**2)
    damped += np.einsum("jcc,jc->", equations.landmark_block, landmark**2)
    return -_dot(equations.camera_gradient, equations.landmark_gradient, camera, landmark) + damping * float(damped)


def _relief(gain: float) -> float:
    """Factor on the damping after a step that lowered the cost by `gain` times what the model promised:
    a tenth where the model holds, up to twice where it does not (Nielsen 1999, IMM-REP-1999-05)."""
    return float(np.clip(1.0 - (2.0 * gain - 1.0) ** 3, 0.1, 2.0))


def _solve(problem: Problem, equations: NormalEquations, damping: float, options: SolverOptions):
    """Camera step (K, 10), landmark step (J, 6) and the conjugate-gradient iterations taken."""
    system = _Damped(problem, equations, damping, options)
    residual_c, residual_l = -equations.camera_gradient, -equations.landmark_gradient
    x_c, x_l = np.zeros_like(residual_c), np.zeros_like(residual_l)
    z_c, z_l = system.precondition(residual_c, residual_l)
    p_c, p_l = z_c.copy(), z_l.astype(float)
    fit = first = _dot(residual_c, residual_l, z_c, z_l)
    iterations = 0
    while iterations < options.max_cg_iterations and fit > options.cg_tolerance**2 * first:
        iterations += 1
        h_c, h_l = system.multiply(p_c, p_l)
        alpha = fit / _dot(p_c, p_l, h_c, h_l)
        x_c += alpha * p_c
        x_l += alpha * p_l
        residual_c = residual_c - alpha * h_c
        residual_l = residual_l - alpha * h_l
        z_c, z_l = system.precondition(residual_c, residual_l)
        fit, last = _dot(residual_c, residual_l, z_c, z_l), fit
        p_c = z_c + (fit / last) * p_c
        p_l *= fit / last
        p_l += z_l
    return x_c, x_l, iterations


class _Damped:
    """The damped normal equations: product and preconditioner."""

    def __init__(self, problem: Problem, equations: NormalEquations, damping: float, options: SolverOptions):
        self.problem, self.equations, self.options = problem, equations, options
        camera, self.camera_damping = _damp(equations.camera_block, damping)
        self.camera_inverse = np.linalg.inv(camera)
        landmark, landmark_damping = _damp(equations.landmark_block, damping)
        self.landmark_inverse = np.linalg.inv(landmark).astype(np.float32)
        self.landmark_rest = equations.landmark_rest.copy()
        np.einsum("jii->ji", self.landmark_rest)[:] += landmark_damping

    def multiply(self, camera: np.ndarray, landmark: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        single = landmark.astype(np.float32)
        out_c, out_l = self.problem.multiply_observations(self.equations, camera, single)
        out_c += np.einsum("kij,kj->ki", self.equations.camera_rest, camera) + self.camera_damping * camera
        rest = np.empty_like(single)
        if self.problem.neighbours is not None:
            rows = self.equations.smooth_rows
            multiply_landmarks(self.problem.neighbours, rows, self.landmark_rest, single, rest)
        else:
            apply_blocks(self.landmark_rest, single, np.float32(1.0), rest)
        return out_c, out_l.astype(float) + rest

    def precondition(self, camera: np.ndarray, landmark: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        single = landmark.astype(np.float32)
        out_c = np.einsum("kij,kj->ki", self.camera_inverse, camera)
        if self.problem.neighbours is None:
            out_l = np.empty_like(single)
            apply_blocks(self.landmark_inverse, single, np.float32(1.0), out_l)
            return out_c, out_l
        return out_c, solve_approximately(
            self.problem.neighbours,
            self.equations.smooth_rows,
            self.landmark_inverse,
            single,
            self.options.chebyshev_degree,
            self.options.chebyshev_low,
        )


def _damp(block: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Blocks (..., n, n) with their diagonal grown by `damping`, and what was added (..., n)."""
    added = damping * np.einsum("...ii->...i", block)
    grown = block.copy()
    np.einsum("...ii->...i", grown)[:] += added
    return grown, added


def _descend(problem: Problem, estimate: Estimate, cost: float, camera, landmark, step_limit: float):
    """The first of the whole step, a quarter and a sixteenth of it that does not raise the cost, else the last.

    Returns the candidate, its cost by term, the share of the step, and how far landmarks moved (root mean square).
    Trying a shorter step costs a thirtieth of solving for another.
    """
    share = _global_share(camera, estimate)
    for trial in (share, share / 4.0, share / 16.0):
        moves = _limited(trial * landmark, step_limit, estimate)
        candidate = estimate.step(trial * camera, moves)
        new_cost = problem.cost(candidate)
        if new_cost.sum() <= cost:
            break
    moved = float(np.sqrt(np.mean(np.sum(moves[:, :3] ** 2, axis=1))))
    return candidate, new_cost, trial, moved


def _global_share(camera: np.ndarray, estimate: Estimate) -> float:
    """Share of a step that turns no camera's orbit and no Sun by more than MAX_GLOBAL_TURN and changes no scale by more
    than a fifth: beyond, the linear model of a whole view's brightness is worth nothing."""
    turn = max(np.linalg.norm(camera[:, :3], axis=1).max(), np.linalg.norm(camera[:, 6:8], axis=1).max())
    gain = np.max(np.abs(camera[:, 8]) / np.abs(estimate.views.scale))
    return 1.0 / max(1.0, turn / MAX_GLOBAL_TURN, gain / 0.2)


def _limited(landmark: np.ndarray, max_move: float, estimate: Estimate) -> np.ndarray:
    """Landmark steps (J, 6), each cut as a whole so that its position moves by `max_move` at most, its normal turns by
    MAX_TURN, and its albedo does not fall below a tenth of what it is."""
    length = np.linalg.norm(landmark[:, :3], axis=1)
    turn = np.linalg.norm(landmark[:, 3:5], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.minimum(1.0, np.minimum(max_move / length, MAX_TURN / turn))
        fall = -landmark[:, 5] / (0.9 * np.maximum(estimate.landmarks.albedo, 1e-12))
        share = np.where(fall * share > 1.0, 1.0 / fall, share)
    return landmark * np.nan_to_num(share, nan=1.0)[:, None]


def _dot(a_c, a_l, b_c, b_l) -> float:
    return float(np.vdot(a_c, b_c) + np.vdot(a_l, b_l))


def _iteration(cost, damping, iterations, accepted, moved, wall_s, cpu_s) -> Iteration:
    by_term = dict(zip(COST_TERMS, map(float, cost), strict=True))
    return Iteration(by_term, damping, iterations, accepted, moved, wall_s, cpu_s)
