"""Small fully connected networks with rectified linear units, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np


def first_weights(rng: np.random.Generator, widths: Sequence[int]) -> list[np.ndarray]:
    """Matrices (in, out) float32 between layers of these widths, uniform (Glorot and Bengio 2010, Eq. 16)."""
    return [
        rng.uniform(-1.0, 1.0, (a, b)).astype(np.float32) * np.float32(np.sqrt(6.0 / (a + b)))
        for a, b in pairwise(widths)
    ]


def forward(weights: Sequence[np.ndarray], values: np.ndarray) -> list[np.ndarray]:
    """The input (n, widths[0]) and what every layer makes of it; the last is linear."""
    found = [values]
    for k, weight in enumerate(weights):
        values = values @ weight
        if k + 1 < len(weights):
            values = np.maximum(values, 0)
        found.append(values)
    return found


def backward(
    weights: Sequence[np.ndarray], layers: Sequence[np.ndarray], by_last: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Derivatives of a loss by the weights and by the input, from those by the last layer. layers: `forward`'s."""
    found: list[np.ndarray] = []
    by = by_last
    for k in range(len(weights) - 1, -1, -1):
        if k + 1 < len(weights):
            by = np.where(layers[k + 1] > 0, by, 0)
        found.append(layers[k].T @ by)
        by = by @ weights[k].T
    return found[::-1], by
