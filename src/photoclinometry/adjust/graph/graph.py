"""The factor graph: groups of factors over views, landmarks and reflectance parameters.

    graph = FactorGraph([Keypoints(...), Brightness(...), SunDirections(...), Smoothness(...), Gauge(...), ...])
    at = graph.linearize(estimate) # H = J^T J and g = J^T r there, a value that is never changed

Two speeds keep it fast and open. `Keypoints`, `Brightness` and `Smoothness` have millions of factors and are compiled.
Every other group is general (`general.FactorGroup`): it gives residuals and Jacobian blocks as arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from photoclinometry.adjust.graph.general import FactorGroup, Rows, Sums, Variable, add_product, beside_views
from photoclinometry.adjust.graph.observations import Brightness, Keypoints, ObservationRows, Observations
from photoclinometry.adjust.graph.reflectance_parameters import Border, add_border
from photoclinometry.adjust.graph.smoothness import (
    Neighbours,
    Smoothness,
    SmoothnessRows,
    add_smoothness,
    build_neighbours,
)
from photoclinometry.adjust.graph.smoothness import add_product as add_smooth_product
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE, Estimate
from photoclinometry.model.reflectance import Reflectance

Group = Keypoints | Brightness | Smoothness | FactorGroup


class FactorGraph:
    """Factors as a list of groups, with their cost and normal equations."""

    def __init__(self, groups: Sequence[Group]):
        """At least one `Keypoints`, one `Brightness` and one `Smoothness` at most. Raises ValueError otherwise."""
        keypoints = [group for group in groups if isinstance(group, Keypoints)]
        brightness = [group for group in groups if isinstance(group, Brightness)]
        smoothness = [group for group in groups if isinstance(group, Smoothness)]
        if not keypoints or len(brightness) > 1 or len(smoothness) > 1:
            raise ValueError("a graph has keypoints, and one group each of brightness and smoothness at most")
        self.observations = Observations(keypoints, brightness[0] if brightness else None)
        count = len(self.observations.table.tracks.start) - 1
        nobody = build_neighbours(np.zeros((count, 0), int), np.zeros((count, 0), bool))
        self.smoothness = smoothness[0] if smoothness else Smoothness(nobody, 1.0)
        compiled = (Keypoints, Brightness, Smoothness)
        self.general = tuple(group for group in groups if not isinstance(group, compiled))

    @property
    def cost_names(self) -> tuple[str, ...]:
        """Names of the entries of a cost: keypoints, brightness, smoothness, and each general group."""
        return "keypoint", "brightness", "smoothness", *(group.name for group in self.general)

    @property
    def with_brightness(self) -> bool:
        return bool(np.any(self.observations.brightness_weight))

    @property
    def reflectance(self) -> Reflectance | None:
        """From which the estimate's differs by its parameters; None without brightness."""
        return self.observations.reflectance

    def reflectance_at(self, estimate: Estimate) -> Reflectance | None:
        """The reflectance with the parameters of an estimate."""
        return self.observations.reflectance_at(estimate)

    def cost(self, estimate: Estimate) -> np.ndarray:
        """Squared whitened residuals by `cost_names` (C,), after the loss; the objective is their sum."""
        return self.costs(estimate)[0]

    def costs(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """`cost`, and (J,) the contribution of each landmark's observations and neighbours. General groups do not count
        for landmarks."""
        observed, of_landmarks = self.observations.cost(estimate)
        smooth, of_pairs = self.smoothness.cost(estimate)
        general = [_cost(group.rows(estimate)) for group in self.general]
        return np.array([*observed, smooth, *general]), of_landmarks + of_pairs

    def linearize(self, estimate: Estimate) -> Linearization:
        """The normal equations at an estimate."""
        observed, block, gradient = self.observations.linearize(estimate)
        smooth = self.smoothness.linearize(estimate)
        rows = self._general_rows(estimate)
        cost = np.array([*observed.cost, smooth.cost, *map(_cost, rows)])
        sums = self._sums(estimate, rows)
        block += sums["landmark"].block
        gradient += sums["landmark"].gradient
        landmarks = Sums(gradient, block, sums["landmark"].rest)
        add_smoothness(
            smooth.neighbours, smooth.rows, smooth.residual, landmarks.block, landmarks.rest, landmarks.gradient
        )
        _make_invertible(landmarks)
        views, seen = sums["view"], len(estimate.views)
        views.gradient[:seen] += observed.view_gradient
        views.block[:seen] += observed.view_block
        _make_invertible(views)
        parameters, border = sums["parameter"], observed.border
        border = border._replace(
            block=border.block + parameters.block[0], gradient=border.gradient + parameters.gradient[0]
        )
        return Linearization(
            cost=cost,
            views=views,
            landmarks=landmarks,
            parameter_rest=parameters.rest[0],
            border=border,
            observed=observed,
            smooth=smooth,
            several=_touching_several(rows),
        )

    def general_part(self, estimate: Estimate) -> tuple[dict[Variable, Sums], tuple[Rows, ...]]:
        """Of the general groups alone: their sums, and the rows of factors that touch several variables."""
        rows = self._general_rows(estimate)
        return self._sums(estimate, rows), _touching_several(rows)

    def _general_rows(self, estimate: Estimate) -> list[list[Rows]]:
        """Of each general group."""
        views = len(estimate.views)
        return [[beside_views(rows, views) for rows in group.rows(estimate)] for group in self.general]

    @staticmethod
    def _sums(estimate: Estimate, rows: Sequence[Sequence[Rows]]) -> dict[Variable, Sums]:
        parameters = len(estimate.parameters)
        sums: dict[Variable, Sums] = {
            "view": _no_sums(len(estimate.views) + len(estimate.systematic), VIEW_SIZE, float),
            "landmark": _no_sums(len(estimate.landmarks), LANDMARK_SIZE, np.float32),
            "parameter": _no_sums(1, parameters, float),
        }
        for each in (each for group in rows for each in group):
            alone = len(each.touches) == 1
            for touch in each.touches:
                sums[touch.variable].add(touch, each.residual, alone=alone)
        return sums


@dataclass(frozen=True)
class Linearization:
    """H x = -g at one estimate, from `FactorGraph.linearize`. A vector has 10 K + 6 J + T numbers.

    K counts the views, and after them the systematic errors, if there are any.
    """

    cost: np.ndarray
    """(C,) by `FactorGraph.cost_names`."""
    views: Sums
    """(K, 10)."""
    landmarks: Sums
    """(J, 6); `rest` is float32 and has the smoothness's own part in it."""
    parameter_rest: np.ndarray
    """(T, T) the part of the parameters' block that is not from observations."""
    border: Border
    """The reflectance parameters' rows and columns."""
    observed: ObservationRows
    smooth: SmoothnessRows
    several: tuple[Rows, ...]
    """Of general groups whose factors touch several variables."""

    @property
    def neighbours(self) -> Neighbours:
        return self.smooth.neighbours

    @property
    def gradient(self) -> np.ndarray:
        """(10 K + 6 J + T,)."""
        return np.concatenate([self.views.gradient.ravel(), self.landmarks.gradient.ravel(), self.border.gradient])

    @property
    def diagonal(self) -> np.ndarray:
        """(10 K + 6 J + T,) of H."""
        blocks = (np.einsum("nii->ni", sums.block).ravel() for sums in (self.views, self.landmarks))
        return np.concatenate([*blocks, np.diag(self.border.block)])

    def split(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The views' part (K, 10), the landmarks' (J, 6) and the parameters' (T,) of a vector, as views of it."""
        end_of_views = self.views.gradient.size
        end = end_of_views + self.landmarks.gradient.size
        view, landmark = vector[:end_of_views], vector[end_of_views:end]
        return view.reshape(-1, VIEW_SIZE), landmark.reshape(-1, LANDMARK_SIZE), vector[end:]

    def multiply(self, vector: np.ndarray) -> np.ndarray:
        """H x, of a float32 vector."""
        out, border = np.empty_like(vector), self.border
        view, landmark, parameter = self.split(vector)
        view_out, landmark_out, parameter_out = self.split(out)
        seen = len(self.observed.view_gradient)
        of_views = np.einsum("kij,kj->ki", self.views.rest, view)
        of_views[:seen] += self.observed.multiply(view[:seen], landmark, landmark_out)
        view_out[:] = of_views
        add_smooth_product(self.neighbours, self.smooth.rows, self.landmarks.rest, landmark, landmark_out)
        for rows in self.several:
            add_product(rows, {"view": view, "landmark": landmark}, {"view": view_out, "landmark": landmark_out})
        if len(parameter):
            view_out[:seen] += border.by_view @ parameter
            by_landmarks = np.empty((numba.get_num_threads(), len(parameter)))
            add_border(border.by_landmark, landmark, parameter, landmark_out, by_landmarks)
            parameter_out[:] = border.block @ parameter + by_landmarks.sum(0)
            parameter_out += np.einsum("ki,kit->t", view[:seen], border.by_view)
        return out

    def decrease(self, moves: np.ndarray) -> float:
        """Decrease of the cost of the linear model by moves (10 K + 6 J + T,)."""
        return -float(np.vdot(moves, self.multiply(moves.astype(np.float32)) + 2.0 * self.gradient))


def _cost(rows: Sequence[Rows]) -> float:
    return sum(each.cost for each in rows)


def _touching_several(rows: Sequence[Sequence[Rows]]) -> tuple[Rows, ...]:
    """Of the rows of groups, those whose factors touch several variables."""
    return tuple(each for group in rows for each in group if len(each.touches) > 1)


def _no_sums(count: int, size: int, rest: type) -> Sums:
    return Sums(np.zeros((count, size)), np.zeros((count, size, size)), np.zeros((count, size, size), rest))


def _make_invertible(sums: Sums) -> None:
    """Ones on the diagonal where no factor touches a variable: it then stays where it is."""
    diagonal = np.einsum("...ii->...i", sums.block)
    untouched = diagonal == 0.0
    diagonal[untouched] = 1.0
    np.einsum("...ii->...i", sums.rest)[untouched] = 1.0
