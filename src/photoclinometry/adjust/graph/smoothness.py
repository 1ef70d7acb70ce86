"""The smoothness factors (Eq. 35), which couple neighbours: a compiled group of its own.

The residual of landmark j towards its neighbour q is asin(d . n_j) / sigma, with five numbers of Jacobian kept: v by
the neighbour's position (the landmark's own is -v) and two by the normal. A neighbour that lists the landmark back is
another pair; `Neighbours` keeps the pairs that point at each landmark, so that products are gathered, and no two
threads write to the same landmark.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.graph.factors import STEEPEST
from photoclinometry.adjust.graph.rows import COMPILED
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, Estimate
from photoclinometry.model.geometry import tangent_basis


class Neighbours(NamedTuple):
    """P directed pairs, landmark -> neighbour, sorted by landmark, and the same pairs by neighbour.

    Indices are unsigned: compiled code then need not ask whether they count from the end.
    """

    start: np.ndarray
    """(J + 1,) uint32: the pairs of landmark j are start[j]:start[j + 1]."""
    target: np.ndarray
    """(P,) uint32: the neighbour of each pair."""
    source: np.ndarray
    """(P,) uint32: the landmark of each pair."""
    incoming_start: np.ndarray
    """(J + 1,) uint32: the pairs that point at landmark j are incoming[incoming_start[j]:incoming_start[j + 1]]."""
    incoming: np.ndarray
    """(P,) uint32."""


def build_neighbours(index: np.ndarray, present: np.ndarray) -> Neighbours:
    """From neighbour indices (J, M) and a mask of those that count."""
    source, _ = np.nonzero(present)
    target = index[present]

    def starts(of: np.ndarray) -> np.ndarray:
        return np.concatenate([[0], np.cumsum(np.bincount(of, minlength=len(index)))])

    lists = starts(source), target, source, starts(target), np.argsort(target, kind="stable")
    return Neighbours(*(np.ascontiguousarray(values, dtype=np.uint32) for values in lists))


@dataclass(frozen=True)
class Smoothness:
    """(asin(d . n) - bend) / sigma: each landmark's neighbours lie in its tangent plane (Eq. 35), or off it by the bend
    of the ground between them."""

    neighbours: Neighbours
    sigma: float
    """[rad]."""
    bend: np.ndarray | None = None
    """(P,) angles of the neighbours above the tangent planes, as known beforehand [rad]; without it, none."""
    name: str = "smoothness"

    def cost(self, estimate: Estimate) -> tuple[float, np.ndarray]:
        """Of all pairs, and (J,) of those that each landmark is in, so that a pair counts for both."""
        rows, count = self.linearize(estimate), len(estimate.landmarks)
        ends = (self.neighbours.source, self.neighbours.target)
        return rows.cost, np.sum([np.bincount(end, rows.residual**2, count) for end in ends], axis=0)

    def linearize(self, estimate: Estimate, dtype: type = np.float32) -> SmoothnessRows:
        """dtype: of the rows; residuals are in double precision."""
        landmarks, pairs = estimate.landmarks, len(self.neighbours.target)
        rows, residual = np.empty((pairs, 5), dtype), np.empty(pairs)
        position, normal = (np.ascontiguousarray(part) for part in (landmarks.position, landmarks.normal))
        bend = np.zeros(pairs) if self.bend is None else self.bend
        cost = linearize_smoothness(
            self.neighbours, position, normal, tangent_basis(normal), bend, self.sigma, rows, residual
        )
        return SmoothnessRows(self.neighbours, float(cost), rows, residual)


def bend_between(neighbours: Neighbours, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(P,) angles of neighbours above the tangent planes, by both normals [rad].

    The ground between two landmarks runs along the mean of their tangent planes: the angle is half of that between the
    directions in which these rise. With it, smoothness is the trapezoidal rule, and does not flatten curved ground.
    """
    direction = position[neighbours.target] - position[neighbours.source]
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    own, other = (np.sum(direction * normal[of], -1) for of in (neighbours.source, neighbours.target))
    return (np.arcsin(np.clip(own, -STEEPEST, STEEPEST)) - np.arcsin(np.clip(other, -STEEPEST, STEEPEST))) / 2.0


@dataclass(frozen=True)
class SmoothnessRows:
    """Rows of P pairs of neighbours at one estimate."""

    neighbours: Neighbours
    cost: float
    rows: np.ndarray
    """(P, 5): by the neighbour's position 3 (the landmark's own is the opposite), and by the landmark's normal 2."""
    residual: np.ndarray
    """(P,) whitened."""


@njit(parallel=True, **COMPILED)
def linearize_smoothness(neighbours, position, normal, normal_basis, bend, sigma, rows, residual):
    """Fills rows (P, 5) and residual (P,), whitened; returns the cost."""
    cost = 0.0
    for p in prange(residual.size):
        j, q = neighbours.source[p], neighbours.target[p]
        d0 = position[q, 0] - position[j, 0]
        d1 = position[q, 1] - position[j, 1]
        d2 = position[q, 2] - position[j, 2]
        inverse = 1.0 / math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        d0, d1, d2 = d0 * inverse, d1 * inverse, d2 * inverse
        n0, n1, n2 = normal[j, 0], normal[j, 1], normal[j, 2]
        c = min(max(d0 * n0 + d1 * n1 + d2 * n2, -STEEPEST), STEEPEST)
        r = (math.asin(c) - bend[p]) / sigma
        steepness = 1.0 / (math.sqrt(1.0 - c * c) * sigma)
        residual[p] = r
        rows[p, 0] = steepness * (n0 - c * d0) * inverse
        rows[p, 1] = steepness * (n1 - c * d1) * inverse
        rows[p, 2] = steepness * (n2 - c * d2) * inverse
        for i in range(2):
            basis = normal_basis[j, :, i]
            rows[p, 3 + i] = steepness * (d0 * basis[0] + d1 * basis[1] + d2 * basis[2])
        cost += r * r
    return cost


@njit(parallel=True, **COMPILED)
def add_smoothness(neighbours, rows, residual, block, rest, gradient):
    """Adds the smoothness factors to the landmarks' diagonal blocks (J, 6, 6), to the part of these that is not from
    observations, and to their gradients (J, 6)."""
    for j in prange(block.shape[0]):
        for p in range(neighbours.start[j], neighbours.start[j + 1]):
            for i in range(5):
                a = -rows[p, i] if i < 3 else rows[p, i]
                gradient[j, i] += a * residual[p]
                for k in range(5):
                    b = -rows[p, k] if k < 3 else rows[p, k]
                    block[j, i, k] += a * b
                    rest[j, i, k] += a * b
        for e in range(neighbours.incoming_start[j], neighbours.incoming_start[j + 1]):
            p = neighbours.incoming[e]
            for i in range(3):
                gradient[j, i] += rows[p, i] * residual[p]
                for k in range(3):
                    block[j, i, k] += rows[p, i] * rows[p, k]
                    rest[j, i, k] += rows[p, i] * rows[p, k]


@njit(**COMPILED)
def couple(j, neighbours, rows, x):
    """Contribution of the neighbours' x (J, 6) to landmark j: the off-diagonal product, without j's own block."""
    a0 = a1 = a2 = a3 = a4 = np.float32(0.0)
    for p in range(neighbours.start[j], neighbours.start[j + np.uint32(1)]):
        q = neighbours.target[p]
        v0, v1, v2 = rows[p, 0], rows[p, 1], rows[p, 2]
        u = v0 * x[q, 0] + v1 * x[q, 1] + v2 * x[q, 2]
        a0 -= v0 * u
        a1 -= v1 * u
        a2 -= v2 * u
        a3 += rows[p, 3] * u
        a4 += rows[p, 4] * u
    for e in range(neighbours.incoming_start[j], neighbours.incoming_start[j + np.uint32(1)]):
        p = neighbours.incoming[e]
        q = neighbours.source[p]
        v0, v1, v2 = rows[p, 0], rows[p, 1], rows[p, 2]
        u = rows[p, 3] * x[q, 3] + rows[p, 4] * x[q, 4] - v0 * x[q, 0] - v1 * x[q, 1] - v2 * x[q, 2]
        a0 += v0 * u
        a1 += v1 * u
        a2 += v2 * u
    return a0, a1, a2, a3, a4


@njit(parallel=True, **COMPILED)
def add_product(neighbours, rows, block, x, out):
    """out += block x + coupling x: landmarks' diagonal blocks (J, 6, 6) and the smoothness between them; float32."""
    for j in prange(x.shape[0]):
        a = couple(np.uint32(j), neighbours, rows, x)
        for i in range(LANDMARK_SIZE):
            total = block[j, i, 0] * x[j, 0]
            for k in range(1, LANDMARK_SIZE):
                total += block[j, i, k] * x[j, k]
            out[j, i] += total
        out[j, 0] += a[0]
        out[j, 1] += a[1]
        out[j, 2] += a[2]
        out[j, 3] += a[3]
        out[j, 4] += a[4]
