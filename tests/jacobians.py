"""One helper that checks every derivative of the project against central differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def numerical_jacobian(
    function: Callable[[np.ndarray], np.ndarray], size: int, steps: np.ndarray | float
) -> np.ndarray:
    """Derivative (m, size) at zero of a function of local coordinates (size,), by fourth-order differences."""
    steps = np.broadcast_to(steps, size)
    columns = []
    for i, h in enumerate(steps):
        axis = np.eye(size)[i] * h
        far = np.atleast_1d(function(2 * axis)) - np.atleast_1d(function(-2 * axis))
        near = np.atleast_1d(function(axis)) - np.atleast_1d(function(-axis))
        columns.append((8 * near - far) / (12 * h))
    return np.stack(columns, axis=-1)
