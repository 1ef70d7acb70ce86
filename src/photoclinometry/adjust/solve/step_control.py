"""The length of a step along the direction of the linear model.

A landmark's own move is cut to half a ground sample: the smoothness residual saturates, and one landmark that leaps
becomes a spike that spoils every later step of all. The own move is the difference from the motion of the whole map. A
map that tilts, stretches or shears together with its cameras, as in the weakly determined motions of shape from
shading, is not limited, since cuts landmark by landmark would separate it from the cameras. Where a step raises the
cost, landmarks that it makes worse are held back, and shorter steps along the same direction are tried, before damping
has to rise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.model.tiny import TINY

MAX_TURN = 0.5
"""A normal turns by this at most in one step [rad]."""

MAX_GLOBAL_TURN = 0.05
"""A Sun, or a camera about the map, turns by this at most in one step [rad]."""

MAX_GAIN = 0.2
"""A scale or a reflectance parameter changes by this share at most in one step."""

MAX_FALL = 0.9
"""An albedo falls by this share at most in one step, so that it stays positive."""

SHORTER = 0.25
"""Share of a step that is tried where the whole of it fails, twice, before damping rises."""

WORSE = 9.0
"""Increase of a landmark's own squared residuals from which on it is held back: three standard deviations of one."""

MAX_HOLDS = 5
"""Times that landmarks are held back before the step of all is shortened. Neighbours of those that are held may have
to be held, too."""

_ROBUST_ITERATIONS = 10
"""Reweighted fits of the motion that all landmarks share."""
_SAMPLE = 10_000
"""Landmarks that this motion, of twelve numbers, is fitted to at most."""
_RIDGE = 1e-12
"""Share of the trace that is added to the diagonal, far below the contribution of a map's relief."""


class Trial(NamedTuple):
    """A step tried."""

    estimate: Estimate
    cost: np.ndarray
    """(C,) by `FactorGraph.cost_names`."""
    of_landmarks: np.ndarray
    """(J,) as of `FactorGraph.costs`."""
    moves: np.ndarray
    """(10 K + 6 J + T,) made."""
    moved: float
    """Root mean square of the landmarks' moves."""
    held: np.ndarray
    """(J,) how many times each landmark was held back."""
    whole: bool
    """Whether all variables may take the whole step of the linear model; single landmarks may have been held back."""


def descend(
    graph: FactorGraph,
    estimate: Estimate,
    cost: float,
    step: tuple[np.ndarray, np.ndarray, np.ndarray],
    step_limit: float | np.ndarray,
) -> Trial:
    """The first of these that does not raise the cost, else the last: the whole step; the step without the landmarks
    that it makes worse; a quarter and a sixteenth of that.

    A few landmarks for which the linear model is wrong, such as spikes, would otherwise stop all the others. A trial
    costs a thirtieth of solving for another step. (The lowest point of the parabola through the known costs gives steps
    shorter than a quarter, and three times as many: along a curved valley the cost rises with the fourth power.)
    """
    view, landmark, parameter = (part.astype(float) for part in step)
    if graph.reflectance is not None:
        parameter = graph.reflectance.limit_step(estimate.parameters, parameter)
    whole = _global_share(view, parameter, estimate)

    def along(share: float, own: np.ndarray, held: np.ndarray) -> Trial:
        """share: of all; own: (J,) of that, of each landmark, which was held back `held` (J,) times."""
        moves = limited(share * own[:, None] * landmark, step_limit, estimate)
        candidate = estimate.step(share * view, moves, share * parameter)
        moved = float(np.sqrt(np.mean(np.sum(moves[:, :3] ** 2, axis=1))))
        made = np.concatenate([share * view.ravel(), moves.ravel(), share * parameter])
        return Trial(candidate, *graph.costs(candidate), made, moved, held, share == 1.0)

    own, held = np.ones(len(landmark)), np.zeros(len(landmark), int)
    trial = along(whole, own, held)
    if trial.cost.sum() <= cost:
        return trial
    before = graph.costs(estimate)[1]
    for less in (SHORTER, SHORTER, *(MAX_HOLDS - 2) * (0.0,)):
        worse = trial.of_landmarks > before + WORSE
        if trial.cost.sum() <= cost or not worse.any():
            break
        own, held = np.where(worse, less * own, own), held + worse
        trial = along(whole, own, held)
    for share in (SHORTER * whole, SHORTER**2 * whole):
        if trial.cost.sum() <= cost:
            break
        trial = along(share, own, held)
    return trial


def _global_share(view: np.ndarray, parameter: np.ndarray, estimate: Estimate) -> float:
    """Share of a step that turns no camera's orbit and no Sun by more than MAX_GLOBAL_TURN and changes no scale and no
    reflectance parameter by more than MAX_GAIN: beyond, the linear model of a view's brightness is useless."""
    view = view[: len(estimate.views)]
    turn = max(np.linalg.norm(view[:, :3], axis=1).max(), np.linalg.norm(view[:, 6:8], axis=1).max())
    gain = np.max(np.abs(view[:, 8]) / np.abs(estimate.views.scale))
    return 1.0 / max(1.0, turn / MAX_GLOBAL_TURN, gain / MAX_GAIN, *np.abs(parameter) / MAX_GAIN)


def limited(landmark: np.ndarray, max_move: float | np.ndarray, estimate: Estimate) -> np.ndarray:
    """Landmark steps (J, 6), each cut as a whole so that its position moves by `max_move` at most, or no more than that
    against the common motion, its normal turns by MAX_TURN, and its albedo does not fall by more than MAX_FALL.

    max_move: of all, or (J,) of each.
    """
    length, common = np.linalg.norm(landmark[:, :3], axis=1), np.zeros((len(landmark), 3))
    if np.any(length > max_move):
        common = common_motion(landmark[:, :3], estimate.landmarks.position, np.min(max_move))
        length = np.minimum(length, np.linalg.norm(landmark[:, :3] - common, axis=1))
    turn = np.linalg.norm(landmark[:, 3:5], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.minimum(1.0, np.minimum(max_move / length, MAX_TURN / turn))
        fall = -landmark[:, 5] / (MAX_FALL * np.maximum(estimate.landmarks.albedo, TINY))
        share = np.nan_to_num(np.where(fall * share > 1.0, 1.0 / fall, share), nan=1.0)[:, None]
    moves = share * landmark
    moves[:, :3] += (1.0 - share) * common
    return moves


def common_motion(moves: np.ndarray, position: np.ndarray, own: float) -> np.ndarray:
    """The affine motion (J, 3) of the whole map in moves (J, 3) of landmarks at `position` (J, 3).

    A least-squares fit, to a sample, in which moves that differ from it by more than `own` weigh less (Huber).
    """
    centred = position - position.mean(0)
    columns = np.column_stack([np.ones(len(position)), centred / max(np.abs(centred).max(), TINY)])
    some = slice(None, None, max(1, len(moves) // _SAMPLE))
    known, wanted = columns[some], moves[some]
    fitted = np.median(wanted, axis=0)
    coefficients = np.zeros((4, 3))
    for _ in range(_ROBUST_ITERATIONS):
        weighted = known / np.maximum(np.linalg.norm(wanted - fitted, axis=1) / own, 1.0)[:, None]
        information = known.T @ weighted
        np.einsum("ii->i", information)[:] += _RIDGE * np.trace(information)  # landmarks may lie in a plane
        coefficients = np.linalg.solve(information, weighted.T @ wanted)
        fitted = known @ coefficients
    return columns @ coefficients
