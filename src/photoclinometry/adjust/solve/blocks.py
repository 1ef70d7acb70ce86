"""Landmarks' 6 x 6 diagonal blocks: inverted and applied, one landmark after the other, over all threads."""

from __future__ import annotations

import math

from numba import njit, prange

from photoclinometry.adjust.graph.rows import COMPILED
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE

_SMALLEST_PIVOT = 1e-10
"""Pivots are kept above this share of their diagonal element: below, rounding alone decides on their sign."""


@njit(parallel=True, **COMPILED)
def invert_blocks(block, damping, out):
    """Inverses (J, 6, 6) float32 of symmetric blocks (J, 6, 6) whose diagonals have grown by the shares `damping` (J,).

    From their Cholesky factors L: the inverse is L^-T L^-1.
    """
    for j in prange(block.shape[0]):
        lower = block[j].copy()
        for i in range(LANDMARK_SIZE):
            lower[i, i] *= 1.0 + damping[j]
        _factorize(lower)
        _invert_triangle(lower)
        for i in range(LANDMARK_SIZE):
            for k in range(i + 1):
                total = 0.0
                for m in range(i, LANDMARK_SIZE):
                    total += lower[m, i] * lower[m, k]
                out[j, i, k] = out[j, k, i] = total


@njit(**COMPILED)
def _factorize(a):
    """The Cholesky factor of a symmetric matrix, in its lower triangle."""
    for k in range(a.shape[0]):
        pivot = a[k, k]
        for m in range(k):
            pivot -= a[k, m] * a[k, m]
        a[k, k] = math.sqrt(max(pivot, _SMALLEST_PIVOT * a[k, k]))
        for i in range(k + 1, a.shape[0]):
            total = a[i, k]
            for m in range(k):
                total -= a[i, m] * a[k, m]
            a[i, k] = total / a[k, k]


@njit(**COMPILED)
def _invert_triangle(a):
    """A lower triangular matrix to its inverse, in place."""
    for k in range(a.shape[0]):
        a[k, k] = 1.0 / a[k, k]
        for i in range(k + 1, a.shape[0]):
            total = 0.0
            for m in range(k, i):
                total -= a[i, m] * a[m, k]
            a[i, k] = total / a[i, i]


@njit(parallel=True, **COMPILED)
def apply_blocks(inverse, x, factor, out):
    """out = factor * inverse x, block by block (J, 6, 6)."""
    for j in prange(x.shape[0]):
        for i in range(LANDMARK_SIZE):
            total = inverse[j, i, 0] * x[j, 0]
            for k in range(1, LANDMARK_SIZE):
                total += inverse[j, i, k] * x[j, k]
            out[j, i] = factor * total
