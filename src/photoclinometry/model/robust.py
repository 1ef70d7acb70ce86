"""Robust statistics: a standard deviation from the median, and the weights of Huber's loss."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.tiny import TINY

SIGMA_PER_MEDIAN = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute values, 1 / Phi^-1(3/4)."""

REWEIGHTINGS = 6
"""Iterations of reweighted least squares from equal weights: the weights then change in the third digit."""

HUBER_LIMIT = 3.0
"""Residuals beyond this many standard deviations count linearly: few of normal errors (0.3 %) do."""


def robust_sigma(residual: np.ndarray) -> float:
    """Standard deviation of residuals (n,) about zero, from their median size: up to half may be outliers."""
    return SIGMA_PER_MEDIAN * float(np.median(np.abs(residual)))


def huber_weight(size: np.ndarray, limit: float | np.ndarray = HUBER_LIMIT) -> np.ndarray:
    """Weights (...,) of reweighted least squares for Huber's loss: 1 up to `limit`, then limit / size (sizes >= 0)."""
    return np.minimum(1.0, limit / np.maximum(size, TINY))
