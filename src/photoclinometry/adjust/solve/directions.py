"""Products with a few directions of all variables, compiled: BLAS would set threads of its own spinning."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.graph.rows import COMPILED


@njit(parallel=True, **COMPILED)
def shares(directions, vector, out):
    """out (threads, T): the products of directions (T, n) with a vector (n,)."""
    parts, count = out.shape
    size = vector.size
    for part in prange(parts):
        for t in range(count):
            total = 0.0
            for i in range(part * size // parts, (part + 1) * size // parts):
                total += directions[t, i] * vector[i]
            out[part, t] = total


@njit(parallel=True, **COMPILED)
def add_combination(directions, factor, out):
    """out (n,) += factor (T,) times directions (T, n)."""
    for i in prange(out.size):
        total = np.float32(0.0)
        for t in range(factor.size):
            total += factor[t] * directions[t, i]
        out[i] += total
