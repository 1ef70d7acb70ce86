"""Levenberg-Marquardt with preconditioned conjugate gradients on the full, damped normal equations.

    (H + damping diag(H)) x = -g

H is never formed: observations are multiplied through their stored rows (`product.multiply`), smoothness pair
by pair. The preconditioner inverts each view's 10 x 10 block, or all views together where factors couple them; for
landmarks it is a Chebyshev polynomial that deals with the coupling of neighbours (`preconditioner`). Directions in
which reflectance parameters move are treated exactly (`damped.treat_exactly`).

Three safeguards keep it from stalling. Steps are limited, and shortened where they fail, before damping has to rise
(see `step_control`). Landmarks that a step makes worse are held back, and then damped more than the others. And damping
may fall far: turning and shifting a narrow-field camera are nearly the same.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from photoclinometry.adjust.graph.graph import FactorGraph, Linearization
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, Estimate
from photoclinometry.adjust.solve.blocks import invert_blocks
from photoclinometry.adjust.solve.damped import SINGLE_EPSILON, DampedSystem, parameter_moves
from photoclinometry.adjust.solve.krylov import Krylov, conjugate_gradients
from photoclinometry.adjust.solve.preconditioner import chebyshev_degree, lowest_eigenvalue
from photoclinometry.adjust.solve.step_control import Trial, descend
from photoclinometry.model.errors import InputError
from photoclinometry.model.ranges import Range, Ranged

log = logging.getLogger(__name__)

FAST = 0.02
"""While a step lowers the cost by more than this share, the next one is not solved well."""

ENOUGH = 1e-3
"""A linear solve ends when the remaining gain is less than this share of the limit of convergence."""

SMALL_STEPS = 2
"""Small steps one after the other (`_State.small_steps`) with which a minimisation has converged."""

_LIGHT_DAMPING = 1e-4
"""Damping up to which the linear model predicts the decrease of the problem itself."""

ROUGH_DECREASE, ROUGH_STEPS = 1e-3, 8
"""Relative decrease at which a rough estimate ends, and its steps at most."""

UNSETTLED_SHARE = 0.1
"""Share of landmarks that `SolverOptions.settled` does not count. Where few views light the ground at the border of a
map, single landmarks keep moving for as many steps again, while the map no longer changes."""

STALE = 10
"""Iterations of a step from which on the moves that follow the reflectance parameters are found anew."""

MAX_DAMPING = 1e8
"""Damping at which no downhill step exists however short: the cost is flat to rounding."""

ALONE, HELD_GROWTH, MOST_ALONE = 1e-2, 10.0, 1e4
"""Damping of a single landmark before it is held back, its factor at each time, and its largest value, at which a
landmark does not move."""

MIN_RELIEF, MAX_RELIEF = 0.1, 2.0
"""Least and largest factor on the damping after an accepted step."""


@dataclass(frozen=True, kw_only=True)
class SolverOptions(Ranged):
    """Search for the minimum. Estimates end within about half a standard deviation of it; with `settled=0` and a
    smaller `relative_decrease` they go on to it."""

    max_steps: Annotated[int, Range(least=1, most=100_000)] = 100
    """Levenberg-Marquardt steps at most. Most estimates take 5 to 15; of 60 of few views, 4 to 12, 24 took more than
    30, for slow motions of the whole."""
    relative_decrease: Annotated[float, Range(least=0, below=1)] = 1e-4
    """Converged when two successive steps lower the cost by less than this share, or one that promised no more ..."""
    absolute_decrease: Annotated[float, Range(least=0)] = 1.0
    """... or by less than this, in squared standard deviations: no variable then moves by a standard deviation ..."""
    settled: Annotated[float, Range(least=0)] = 0.5
    """... or when two whole steps under light damping, solved well, move nine landmarks of ten by less than this, in
    standard deviations of each with all else held; 0 for never."""
    initial_damping: Annotated[float, Range(above=0)] = 1e-5
    """Added to the diagonal of the normal equations, relative to it."""
    min_damping: Annotated[float, Range(above=0)] = 1e-12
    """Damping never falls below this."""
    truncation: Annotated[float, Range(above=0, below=1)] = 0.1
    """A linear solve ends when its last iteration lowered the linear model's cost by less than this share of the mean
    over its iterations (Nash and Sofer 1990, doi:10.1016/0167-6377(90)90064-D), while the cost falls fast ..."""
    final_truncation: Annotated[float, Range(above=0, below=1)] = 1e-3
    """... and by less than this share afterwards: weakly determined variables converge last, after a lull."""
    max_cg_iterations: Annotated[int, Range(least=1, most=100_000)] = 200
    """Conjugate-gradient iterations at most, per step."""
    chebyshev_low: Annotated[float, Range(above=0, most=2)] = 0.02
    """Lowest eigenvalue that the landmarks' preconditioner treats; a higher one where none is so low."""
    chebyshev_reduction: Annotated[float, Range(above=0, below=1)] = 0.4
    """Factor by which it reduces errors; sets the polynomial's degree."""

    def roughly(self, *, all_steps: bool = False) -> SolverOptions:
        """Options for an estimate that is made again with other weights or matches: without the slow motions at the
        end.

        all_steps: with as many steps as these options allow.
        """
        return replace(
            self,
            relative_decrease=max(self.relative_decrease, ROUGH_DECREASE),
            max_steps=self.max_steps if all_steps else min(self.max_steps, ROUGH_STEPS),
            final_truncation=self.truncation,
        )


@dataclass(frozen=True)
class Iteration:
    """One line of the convergence log."""

    cost: dict[str, float]
    """By kind of factor, after the step."""
    damping: float
    """Of all variables, as a share of the diagonal of the normal equations."""
    cg_iterations: int
    accepted: bool
    """Whether the step was taken: it lowered the cost."""
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
    """How the descent ended."""
    log: tuple[Iteration, ...]
    """The first entry is the start."""
    parameter_moves: np.ndarray | None
    """(T, 10 K + 6 J + T) how all variables follow the reflectance parameters; None where none are estimated."""

    @property
    def cost(self) -> dict[str, float]:
        return [i for i in self.log if i.accepted][-1].cost


@dataclass
class _State:
    """Where the descent is."""

    estimate: Estimate
    at: Linearization
    damping: float
    of_landmarks: np.ndarray
    """(J,) damping of each landmark, where it is more than that of all."""
    growth: float = 4.0
    """Factor on the damping after the next step that fails."""
    fast: bool = True
    """Whether the cost falls fast, so that solving well is of no use."""
    small_steps: int = 0
    """Successive steps that lowered the cost, or moved landmarks, by no more than the limits of convergence."""
    ended: str | None = None
    """The reason why the descent has converged; None where it goes on."""


def minimize(
    graph: FactorGraph,
    start: Estimate,
    options: SolverOptions | None = None,
    *,
    step_limit: float | np.ndarray = np.inf,
    moves: np.ndarray | None = None,
    on_step: Callable[[Iteration], None] | None = None,
) -> Solution:
    """The estimate of least cost near `start`.

    step_limit: longest step of a landmark, or (J,) of each, relative to the common move, in units of B. moves: the
    `parameter_moves` of an earlier solution with other weights. on_step is called after every step; an exception in it
    ends the solve. Raises InputError where the cost of the start is no number.
    """
    options = options or SolverOptions()
    state = _State(start, graph.linearize(start), options.initial_damping, np.zeros(len(start.landmarks)))
    history = [Iteration(_by_group(graph, state.at.cost), state.damping, 0, True, 0.0, 0.0, 0.0)]
    _require_finite(history[0].cost)
    polynomial = _polynomial(state.at, options)
    estimated = len(start.parameters) > 0
    stale = estimated and moves is None
    for _ in range(options.max_steps):
        wall, cpu, used = time.perf_counter(), time.process_time(), state.damping
        system = DampedSystem(state.at, state.damping, state.of_landmarks, *polynomial)
        if stale:
            moves = parameter_moves(system, moves)
        if moves is not None:
            system.treat_exactly(moves)
        solve = _solve(system, options, fast=state.fast)
        trial = descend(graph, state.estimate, float(state.at.cost.sum()), state.at.split(solve.x), step_limit)
        state.of_landmarks = _damped_alone(state.of_landmarks, trial.held)
        stale = estimated and solve.iterations > STALE
        accepted = bool(trial.cost.sum() <= state.at.cost.sum()) and solve.iterations > 0
        if accepted:
            _accept(state, trial, options, solved=not solve.broke_down)
            del system, state.at  # the rows of one linearization at a time: a quarter of a gigabyte for four million
            if state.ended is None:
                state.at = graph.linearize(state.estimate)
        else:
            state.damping, state.growth = state.damping * state.growth, 2.0 * state.growth
        spent = time.perf_counter() - wall, time.process_time() - cpu
        found = _by_group(graph, trial.cost)
        history.append(Iteration(found, used, solve.iterations, accepted, trial.moved, *spent))
        if on_step is not None:
            on_step(history[-1])
        log.debug("step %d: %s", len(history) - 1, history[-1])
        if state.ended is None and state.damping > MAX_DAMPING:
            state.ended = "no step lowers the cost"
        if state.ended is not None:
            break
    message = f"no convergence within {options.max_steps} steps" if state.ended is None else f"converged: {state.ended}"
    return Solution(state.estimate, state.ended is not None, message, tuple(history), moves)


def _require_finite(cost: Mapping[str, float]) -> None:
    """Raises InputError that names the groups whose cost is no number."""
    wrong = [name for name, value in cost.items() if not np.isfinite(value)]
    if wrong:
        raise InputError(
            f"the residuals of {' and '.join(wrong)} are no numbers at the start of the estimate: a measurement, a "
            "pose, a Sun, a landmark or a reflectance parameter is NaN, infinite, or outside of its bounds"
        )


def _solve(system: DampedSystem, options: SolverOptions, *, fast: bool) -> Krylov:
    """The step, solved less well while the cost falls fast."""
    return conjugate_gradients(
        system.multiply,
        system.precondition,
        -system.at.gradient.astype(np.float32),
        max_iterations=options.max_cg_iterations,
        truncation=options.truncation if fast else options.final_truncation,
        enough=ENOUGH * _limit(float(system.at.cost.sum()), options),
    )


def _limit(total: float, options: SolverOptions) -> float:
    """The decrease of the cost that counts as convergence."""
    return max(options.relative_decrease * total, options.absolute_decrease)


def _accept(state: _State, trial: Trial, options: SolverOptions, *, solved: bool) -> None:
    """Goes to a trial that lowers the cost, and sets the damping by the gain ratio.

    The decrease that the linear model predicted holds for the linearization at the start of the step. Where its solve
    broke down (not `solved`), it does not show the distance of the minimum: damping rises instead.
    """
    total = float(state.at.cost.sum())
    fell, promised, limit = total - float(trial.cost.sum()), state.at.decrease(trial.moves), _limit(total, options)
    reliable = solved and trial.whole and state.damping <= _LIGHT_DAMPING
    settles = reliable and not state.fast and _usual_move(state.at, trial) < options.settled
    state.fast = fell > FAST * total
    state.estimate = trial.estimate
    if not solved:
        state.small_steps = 0
        state.damping, state.growth = max(state.damping, SINGLE_EPSILON) * state.growth, 2.0 * state.growth
        return
    state.small_steps = state.small_steps + 1 if fell <= limit or settles else 0
    if state.small_steps == SMALL_STEPS or (fell <= limit and promised <= limit and reliable):
        state.ended = "the cost no longer falls" if fell <= limit else "landmarks no longer move"
    relief = _relief(fell / promised if promised > 0 else 1.0)
    state.growth = 4.0
    state.damping = max(state.damping * (min(relief, 1.0) if trial.whole else relief), options.min_damping)


def _damped_alone(before: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(J,) damping of single landmarks after a step that held each of them back `held` (J,) times.

    A landmark that its part of a step makes worse is damped alone. Otherwise the damping of all landmarks would have to
    rise, and their common motion would come to a halt.
    """
    more = np.minimum(np.maximum(before, ALONE) * HELD_GROWTH**held, MOST_ALONE)
    less = np.where(before > ALONE, MIN_RELIEF * before, 0.0)
    return np.where(held > 0, more, less)


def _usual_move(at: Linearization, trial: Trial) -> float:
    """The longest move of a landmark but for the share UNSETTLED_SHARE that moves most, in its standard deviations."""
    moves, block = at.split(trial.moves)[1], at.landmarks.block
    squared = np.einsum("ji,jik,jk->j", moves, block, moves) / LANDMARK_SIZE
    return float(np.sqrt(np.quantile(squared, 1.0 - UNSETTLED_SHARE)))


def _relief(gain: float) -> float:
    """Factor on the damping after a step that lowered the cost by `gain` times the model's prediction: a tenth where
    the model holds, up to twice where it does not (Nielsen 1999, IMM-REP-1999-05)."""
    return float(np.clip(1.0 - (2.0 * gain - 1.0) ** 3, MIN_RELIEF, MAX_RELIEF))


def _polynomial(at: Linearization, options: SolverOptions) -> tuple[float, int]:
    """Lowest eigenvalue and degree of the landmarks' preconditioner; of degree 1 where nothing couples landmarks."""
    if len(at.neighbours.target) == 0:
        return 1.0, 1
    block = at.landmarks.block
    inverse = np.empty(block.shape, np.float32)
    invert_blocks(block, np.zeros(len(block)), inverse)
    found = lowest_eigenvalue(at.neighbours, at.smooth.rows, block.astype(np.float32), inverse)
    low = min(max(found, options.chebyshev_low), 1.0)
    return low, chebyshev_degree(low, options.chebyshev_reduction)


def _by_group(graph: FactorGraph, cost: np.ndarray) -> dict[str, float]:
    return dict(zip(graph.cost_names, map(float, cost), strict=True))
