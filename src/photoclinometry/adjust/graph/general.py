"""A general group of factors: it returns residuals and Jacobian blocks as arrays, with the variables that they touch.

A group needs nothing else, no kernel and no change elsewhere: the graph adds its rows to gradient, blocks and products.
Groups of a factor for each of millions of observations are compiled instead (`observations`, `smoothness`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from photoclinometry.adjust.graph.variables import VIEW_SIZE, Estimate

Variable = Literal["view", "landmark", "parameter", "systematic"]


@dataclass(frozen=True)
class JacobianBlock:
    """Derivatives of n factors of r residuals by one variable each, in the local coordinates of `factors`."""

    variable: Variable
    index: np.ndarray
    """(n,) index of the view, landmark or systematic error; the reflectance parameters are one set, 0."""
    jacobian: np.ndarray
    """(n, r, 10) by view, (n, r, 6) by landmark, (n, r, T) by the parameters, (n, r, s) by the first s numbers of a
    systematic error."""


@dataclass(frozen=True)
class Rows:
    """Whitened residuals of n factors, with their Jacobian blocks.

    A factor that touches several variables may touch views, systematic errors and landmarks, none of them twice;
    reflectance parameters are touched alone.
    """

    residual: np.ndarray
    """(n, r)."""
    touches: tuple[JacobianBlock, ...]

    @property
    def cost(self) -> float:
        """Squared residuals, summed."""
        return float(np.sum(self.residual**2))

    @property
    def couple_views(self) -> bool:
        """Whether these factors touch several views and nothing else."""
        return len(self.touches) > 1 and all(touch.variable == "view" for touch in self.touches)


class FactorGroup(Protocol):
    """A group of factors with one kind of residual; it owns its measurements and their noise."""

    @property
    def name(self) -> str:
        """The name under which its cost is listed."""
        ...

    def rows(self, estimate: Estimate) -> Sequence[Rows]:
        """Whitened residuals and Jacobians at an estimate."""
        ...


@dataclass
class Sums:
    """Gradient and diagonal blocks, J^T r and J^T J, of the variables of one kind."""

    gradient: np.ndarray
    """(n, size)."""
    block: np.ndarray
    """(n, size, size) everything included."""
    rest: np.ndarray
    """(n, size, size) of factors that touch no other variable: their whole contribution to a product."""

    def add(self, touch: JacobianBlock, residual: np.ndarray, *, alone: bool) -> None:
        """The rows of factors, which touch nothing else if `alone`."""
        np.add.at(self.gradient, touch.index, np.einsum("nri,nr->ni", touch.jacobian, residual))
        squares = np.einsum("nri,nrj->nij", touch.jacobian, touch.jacobian)
        np.add.at(self.block, touch.index, squares)
        if alone:
            np.add.at(self.rest, touch.index, squares.astype(self.rest.dtype))


def beside_views(rows: Rows, views: int) -> Rows:
    """The same factors, with systematic errors in the solver's order: after the `views` views, of the same size."""
    return Rows(rows.residual, tuple(_beside_views(touch, views) for touch in rows.touches))


def _beside_views(touch: JacobianBlock, views: int) -> JacobianBlock:
    if touch.variable != "systematic":
        return touch
    jacobian = np.zeros((*touch.jacobian.shape[:2], VIEW_SIZE))
    jacobian[..., : touch.jacobian.shape[2]] = touch.jacobian
    return JacobianBlock("view", touch.index + views, jacobian)


def add_product(rows: Rows, parts: dict[Variable, np.ndarray], out: dict[Variable, np.ndarray]) -> None:
    """out += J^T J x of factors that touch several variables; x and out by kind of variable, (K + M, 10) and (J, 6)."""
    along = sum(np.einsum("nri,ni->nr", t.jacobian, parts[t.variable][t.index]) for t in rows.touches)
    for touch in rows.touches:
        change = np.einsum("nri,nr->ni", touch.jacobian, along)
        np.add.at(out[touch.variable], touch.index, change.astype(out[touch.variable].dtype))


def information_of_views(own: np.ndarray, several: Sequence[Rows]) -> np.ndarray:
    """(10 K, 10 K) J^T J of factors of one view each (K, 10, 10), and of those that touch several views alone."""
    count, size = own.shape[:2]
    out = np.zeros((count, count, size, size))
    out[range(count), range(count)] = own
    for rows in several:
        for a, b in itertools.product(rows.touches, repeat=2):
            np.add.at(out, (a.index, b.index), np.einsum("nri,nrj->nij", a.jacobian, b.jacobian))
    return out.swapaxes(1, 2).reshape(count * size, -1)
