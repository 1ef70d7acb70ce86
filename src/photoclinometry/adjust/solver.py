"""Levenberg-Marquardt with preconditioned conjugate gradients on the full, damped normal equations.

    (H + damping diag(H)) x = -g

H is never formed: observations are multiplied through their stored rows (`kernels.multiply`), smoothness pair
by pair. The preconditioner is each view's 10 x 10 block and, for landmarks, a Chebyshev polynomial that deals
with the coupling of neighbours, as much as there is of it. (An exact Schur complement onto the cameras did not lower
the count of iterations, nor did weakly determined directions remembered from earlier solves.)

Two safeguards keep it from stalling. Steps are limited, and shortened where they fail, before damping has to rise (see
`descent`). And damping may fall far: turning and shifting a narrow-field camera are nearly the same.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numba
import numpy as np

from photoclinometry.adjust.blocks import invert_blocks
from photoclinometry.adjust.descent import descend
from photoclinometry.adjust.kernels import CAMERA_SIZE, LANDMARK_SIZE
from photoclinometry.adjust.krylov import conjugate_gradients
from photoclinometry.adjust.parameters import ParameterResponse, add_border, add_combination, shares
from photoclinometry.adjust.problem import COST_TERMS, NormalEquations, Problem
from photoclinometry.adjust.smoothing import add_product, chebyshev_degree, lowest_eigenvalue, solve_approximately
from photoclinometry.adjust.variables import Estimate
from photoclinometry.model.errors import NotConvergedError

log = logging.getLogger(__name__)

FAST = 0.02
"""Share of the cost by which a step lowers it while there is no use in solving the next one well."""

ENOUGH = 1e-3
"""A linear solve ends when what is left to gain is less than this share of what counts as convergence."""

_LIGHT_DAMPING = 1e-4
"""Damping up to which the linear model's promise is that of the problem itself."""

ROUGH_DECREASE, ROUGH_STEPS = 1e-3, 8
"""Relative decrease at which a rough estimate ends, and its steps at most."""

COARSE_ITERATIONS, COARSE_ENOUGH = 40, 0.1
"""Conjugate-gradient iterations at most for how the other variables follow a reflectance parameter; fewer if they would
change less than this share of what the parameter costs when they follow."""
STALE = 10
"""Iterations of a step that tell that they follow otherwise by now."""


@dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """How the minimum is sought; results do not depend on these but for the last digits."""

    max_steps: int = 30
    """Levenberg-Marquardt steps at most."""
    relative_decrease: float = 1e-5
    """Converged when two successive steps lower the cost by less than this share, or one that promised no more ..."""
    absolute_decrease: float = 1.0
    """... or by less than this, in squared standard deviations: no variable then moves by a standard deviation."""
    initial_damping: float = 1e-5
    """Added to the diagonal of the normal equations, relative to it."""
    min_damping: float = 1e-12
    """Damping never falls below this."""
    truncation: float = 0.1
    """A linear solve ends when its last iteration lowered the linear model's cost by less than this share of the mean
    over its iterations (Nash and Sofer 1990, doi:10.1016/0167-6377(90)90064-D), while the cost falls fast ..."""
    final_truncation: float = 1e-3
    """... and by less than this share afterwards: what is weakly determined comes last, after a lull."""
    max_cg_iterations: int = 200
    """Conjugate-gradient iterations at most, per step."""
    chebyshev_low: float = 0.02
    """Lowest eigenvalue that the landmarks' preconditioner treats, out of (0, 2]; fewer where there are none so low."""
    chebyshev_reduction: float = 0.4
    """By how much it shrinks errors; sets the polynomial's degree."""

    def roughly(self) -> SolverOptions:
        """For an estimate that is made again with other weights or matches: without the slow motions at the end."""
        return replace(
            self,
            relative_decrease=max(self.relative_decrease, ROUGH_DECREASE),
            max_steps=min(self.max_steps, ROUGH_STEPS),
            final_truncation=self.truncation,
        )


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
    parameter_moves: np.ndarray | None
    """(T, 10 K + 6 J + T) how all variables follow the reflectance parameters; None where none are estimated."""

    @property
    def cost(self) -> dict[str, float]:
        return [i for i in self.log if i.accepted][-1].cost


def minimize(
    problem: Problem,
    start: Estimate,
    options: SolverOptions | None = None,
    *,
    step_limit: float | np.ndarray = np.inf,
    moves: np.ndarray | None = None,
    progress: Callable[[Iteration], None] | None = None,
    throw: bool = False,
) -> Solution:
    """The estimate of least cost near `start`.

    step_limit: longest step of a landmark, or (J,) of each, against what all do, in units of B. moves: the
    `parameter_moves` of an earlier solution with other weights. progress is called after every step; what it raises
    ends the solve. throw: raise NotConvergedError instead of returning a status.
    """
    options = options or SolverOptions()
    estimate, damping = start, options.initial_damping
    cost, equations = problem.linearize(estimate)
    polynomial = _polynomial(problem, equations, options)
    history = [_iteration(cost, damping, 0, True, 0.0, 0.0, 0.0)]
    small, growth, fast = 0, 4.0, True
    estimated = len(start.parameters) > 0
    stale = estimated and moves is None
    message = f"no convergence within {options.max_steps} steps"
    for _ in range(options.max_steps):
        wall, cpu = time.perf_counter(), time.process_time()
        total = float(cost.sum())
        system = _Damped(problem, equations, damping, *polynomial)
        if stale:
            moves = parameter_moves(system, moves)
        if moves is not None:
            system.treat_exactly(moves)
        gradient = equations.gradient
        solve = conjugate_gradients(
            system.multiply,
            system.precondition,
            -gradient.astype(np.float32),
            max_iterations=options.max_cg_iterations,
            truncation=options.truncation if fast else options.final_truncation,
            enough=ENOUGH * max(options.relative_decrease * total, options.absolute_decrease),
        )
        trial = descend(problem, estimate, total, system.split(solve.x), step_limit)
        new_cost, moved, used = trial.cost, trial.moved, damping
        stale = estimated and solve.iterations > STALE
        accepted = bool(new_cost.sum() <= total) and solve.iterations > 0
        if accepted:
            promised = _promised_decrease(system, gradient, trial.moves)
            gain = (total - new_cost.sum()) / promised if promised > 0 else 1.0
            limit = max(options.relative_decrease * total, options.absolute_decrease)
            small = small + 1 if total - new_cost.sum() <= limit else 0
            fast = total - new_cost.sum() > FAST * total
            if small and trial.whole and promised <= limit and damping <= _LIGHT_DAMPING:
                small = 2
            estimate, cost, growth = trial.estimate, new_cost, 4.0
            damping = max(damping * _relief(gain), options.min_damping)
        else:
            damping, growth = damping * growth, 2.0 * growth
        if trial.equations is not None:
            equations = trial.equations
        else:
            _, equations = problem.linearize(estimate)
        spent = time.perf_counter() - wall, time.process_time() - cpu
        history.append(_iteration(new_cost, used, solve.iterations, accepted, moved, *spent))
        if progress is not None:
            progress(history[-1])
        log.debug("step %d: %s", len(history) - 1, history[-1])
        if small == 2:
            message = "converged: the cost no longer falls"
            break
        if damping > 1e8:
            # no downhill step however short: the cost is flat to rounding
            message, small = "converged: no step lowers the cost", 2
            break
    converged = small == 2
    if throw and not converged:
        raise NotConvergedError(message)
    return Solution(estimate, converged, message, tuple(history), moves)


def parameter_response(problem: Problem, solution: Solution, options: SolverOptions) -> ParameterResponse:
    """At the solution, all other variables estimated along with the parameters.

    The covariance is made of columns of the inverse of the normal equations, by conjugate gradients. What rounding has
    spoiled is as uncertain as the prior says: albedos follow a phase function almost wholly.
    """
    count = len(solution.estimate.parameters)
    _, equations = problem.linearize(solution.estimate)
    system = _Damped(problem, equations, options.min_damping, *_polynomial(problem, equations, options))
    moves = parameter_moves(system, solution.parameter_moves, enough=1e-3)
    system.treat_exactly(moves)
    covariance = np.empty((count, count))
    for t in range(count):
        unit = np.zeros(len(system.added), np.float32)
        unit[len(unit) - count + t] = 1.0
        solve = conjugate_gradients(
            system.multiply, system.precondition, unit, max_iterations=500, truncation=options.final_truncation
        )
        covariance[t] = solve.x[-count:]
    value, vector = np.linalg.eigh(0.5 * (covariance + covariance.T))
    prior = problem.priors.reflectance**2
    value = np.where((value > 0) & (value < prior), value, prior)
    cameras = CAMERA_SIZE * len(equations.camera_block)
    return ParameterResponse(
        covariance=(vector * value) @ vector.T,
        of_cameras=moves[:, :cameras].T.astype(float),
        of_landmarks=np.moveaxis(moves[:, cameras : moves.shape[1] - count].reshape(count, -1, LANDMARK_SIZE), 0, 2),
    )


def _promised_decrease(system: _Damped, gradient: np.ndarray, moves: np.ndarray) -> float:
    """By how much the linear model lowers the cost along the moves made (10 K + 6 J + T,)."""
    product = system.multiply(moves.astype(np.float32)) - system.added * moves
    return -float(np.vdot(moves, product + 2.0 * gradient))


def _relief(gain: float) -> float:
    """Factor on the damping after a step that lowered the cost by `gain` times what the model promised:
    a tenth where the model holds, up to twice where it does not (Nielsen 1999, IMM-REP-1999-05)."""
    return float(np.clip(1.0 - (2.0 * gain - 1.0) ** 3, 0.1, 2.0))


class _Damped:
    """The damped normal equations of one step: product and preconditioner of vectors (10 K + 6 J + T,), float32."""

    def __init__(self, problem: Problem, equations: NormalEquations, damping: float, low: float, degree: int):
        """low, degree: of the Chebyshev polynomial, see `smoothing.solve_approximately`."""
        self.problem, self.equations, self.low, self.degree = problem, equations, low, degree
        border = equations.border.block
        diagonals = [np.einsum("nii->ni", b).ravel() for b in (equations.camera_block, equations.landmark_block)]
        self.added = (damping * np.concatenate([*diagonals, np.diag(border)])).astype(np.float32)
        self.parameter_inverse = np.linalg.inv(border + damping * np.diag(np.diag(border)))
        camera = equations.camera_block.copy()
        np.einsum("kii->ki", camera)[:] *= 1.0 + damping
        self.camera_inverse = np.linalg.inv(camera)
        self.landmark_inverse = np.empty(equations.landmark_block.shape, np.float32)
        invert_blocks(equations.landmark_block, damping, self.landmark_inverse)
        self.threads = numba.get_num_threads()
        self.coarse, self.coarse_inverse = np.zeros((0, len(self.added)), np.float32), np.zeros((0, 0))

    def treat_exactly(self, directions: np.ndarray) -> None:
        """From now on the preconditioner solves for directions (T, 10 K + 6 J + T) exactly."""
        products = np.array([self.multiply(direction) for direction in directions])
        self.coarse = directions
        self.coarse_inverse = np.linalg.inv(np.einsum("tn,un->tu", directions, products, dtype=float))

    def multiply_others(self, vector: np.ndarray) -> np.ndarray:
        """`multiply` with the parameters held."""
        out = self.multiply(vector)
        out[len(out) - len(self.parameter_inverse) :] = 0.0
        return out

    def split(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The cameras' part (K, 10), the landmarks' (J, 6) and the parameters' (T,) of a vector, as views of it."""
        cameras = CAMERA_SIZE * len(self.camera_inverse)
        landmarks = cameras + LANDMARK_SIZE * len(self.landmark_inverse)
        camera, landmark, parameter = np.split(vector, [cameras, landmarks])
        return camera.reshape(-1, CAMERA_SIZE), landmark.reshape(-1, LANDMARK_SIZE), parameter

    def multiply(self, vector: np.ndarray) -> np.ndarray:
        equations, border, out = self.equations, self.equations.border, np.empty_like(vector)
        camera, landmark, parameter = self.split(vector)
        camera_out, landmark_out, parameter_out = self.split(out)
        observed = self.problem.multiply_observations(equations, camera, landmark, landmark_out)
        camera_out[:] = observed + np.einsum("kij,kj->ki", equations.camera_rest, camera)
        add_product(self.problem.neighbours, equations.smooth_rows, equations.landmark_rest, landmark, landmark_out)
        if len(parameter):
            camera_out += border.by_camera @ parameter
            by_landmarks = np.empty((self.threads, len(parameter)))
            add_border(border.by_landmark, landmark, parameter, landmark_out, by_landmarks)
            parameter_out[:] = border.block @ parameter + by_landmarks.sum(0)
            parameter_out += np.einsum("ki,kit->t", camera, border.by_camera)
        out += self.added * vector
        return out

    def precondition(self, vector: np.ndarray) -> np.ndarray:
        out = np.empty_like(vector)
        camera, landmark, parameter = self.split(vector)
        camera_out, landmark_out, parameter_out = self.split(out)
        camera_out[:] = np.einsum("kij,kj->ki", self.camera_inverse, camera)
        rows, inverse = self.equations.smooth_rows, self.landmark_inverse
        landmark_out[:] = solve_approximately(self.problem.neighbours, rows, inverse, landmark, self.degree, self.low)
        parameter_out[:] = self.parameter_inverse @ parameter
        if len(self.coarse):
            along = np.empty((self.threads, len(self.coarse)))
            shares(self.coarse, vector, along)
            add_combination(self.coarse, (self.coarse_inverse @ along.sum(0)).astype(np.float32), out)
        return out


def parameter_moves(system: _Damped, before: np.ndarray | None, enough: float = COARSE_ENOUGH) -> np.ndarray:
    """What all variables (T, 10 K + 6 J + T) do when a parameter moves.

    Directions in which the cost hardly changes, since albedos and scales make up for it. before: what they did at
    another point, from which to start; enough: the share of its cost that is not worth following.
    """
    count = len(system.parameter_inverse)
    moves = np.zeros((count, len(system.added)), np.float32) if before is None else before.copy()
    for t in range(count):
        moves[t, t - count] = 1.0
        pull = system.multiply(moves[t])
        left = max(float(np.vdot(moves[t], pull)), system.problem.priors.reflectance**-2.0)
        pull[-count:] = 0.0
        moves[t] -= conjugate_gradients(
            system.multiply_others,
            system.precondition,
            pull,
            max_iterations=COARSE_ITERATIONS,
            truncation=1e-3,
            enough=enough * left,
        ).x
    return moves


def _polynomial(problem: Problem, equations: NormalEquations, options: SolverOptions) -> tuple[float, int]:
    """Lowest eigenvalue and degree of the landmarks' preconditioner; of degree 1 where nothing couples landmarks."""
    if len(problem.neighbours.target) == 0:
        return 1.0, 1
    block = equations.landmark_block
    inverse = np.empty(block.shape, np.float32)
    invert_blocks(block, 0.0, inverse)
    found = lowest_eigenvalue(problem.neighbours, equations.smooth_rows, block.astype(np.float32), inverse)
    low = min(max(found, options.chebyshev_low), 1.0)
    return low, chebyshev_degree(low, options.chebyshev_reduction)


def _iteration(cost, damping, iterations, accepted, moved, wall_s, cpu_s) -> Iteration:
    by_term = dict(zip(COST_TERMS, map(float, cost), strict=True))
    return Iteration(by_term, damping, iterations, accepted, moved, wall_s, cpu_s)
