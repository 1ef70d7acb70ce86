"""The reflectance parameters, on which every brightness depends: a border of the normal equations.

They are few, so their rows and columns are kept as they are, (J, 6, T) and (K, 10, T). A parameter's coordinate is its
change from the start, in units of `Reflectance.parameter_scale`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.adjust.graph.rows import COMPILED
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE


class Border(NamedTuple):
    """The contribution of T parameters to the normal equations."""

    by_landmark: np.ndarray
    """(J, 6, T) float32."""
    by_view: np.ndarray
    """(K, 10, T)."""
    block: np.ndarray
    """(T, T)."""
    gradient: np.ndarray
    """(T,)."""


@njit(parallel=True, **COMPILED)
def add_border(by_landmark, landmark, parameter, landmark_out, parameter_out):
    """landmark_out += border parameter, and parameter_out (threads, T) its transpose times landmark (J, 6); float32.

    Compiled, as BLAS would set threads of its own spinning for products this thin.
    """
    parts, count = parameter_out.shape
    landmarks = landmark.shape[0]
    for part in prange(parts):
        total = np.zeros(count)
        for j in range(part * landmarks // parts, (part + 1) * landmarks // parts):
            for i in range(LANDMARK_SIZE):
                x, change = landmark[j, i], np.float32(0.0)
                for t in range(count):
                    change += by_landmark[j, i, t] * parameter[t]
                    total[t] += by_landmark[j, i, t] * x
                landmark_out[j, i] += change
        parameter_out[part] = total
