"""Statistics of residuals and estimates: a standard deviation from the median, the weights of Huber's loss, and the
jackknife."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.tiny import TINY

SIGMA_PER_MEDIAN = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute values, 1 / Phi^-1(3/4)."""

REWEIGHTINGS = 6
"""Iterations of reweighted least squares from equal weights: the weights then change in the third digit."""

SIGNIFICANT = 5.0
"""Standard deviations beyond which a difference does not count as chance. Sigmas are known roughly: with errors twice
as large as stated the limit is still 2.5, exceeded by chance once in a hundred."""

FEWEST_FOR_SIGMA = 100
"""Fewest values that determine a standard deviation: to 7 per cent, 1 / sqrt(2 n)."""

HUBER_LIMIT = 3.0
"""Residuals beyond this many standard deviations count linearly: 0.3 % of normal errors."""


def robust_sigma(residual: np.ndarray) -> float:
    """Standard deviation of residuals (n,) about zero, from their median size: up to half may be outliers."""
    return SIGMA_PER_MEDIAN * float(np.median(np.abs(residual)))


def huber_weight(residual: np.ndarray, limit: float | np.ndarray = HUBER_LIMIT) -> np.ndarray:
    """Weights (...,) of reweighted least squares for Huber's loss, of residuals of either sign (...,) in units of their
    standard deviation: 1 up to a size of `limit`, then limit / size."""
    return np.minimum(1.0, limit / np.maximum(np.abs(residual), TINY))


def jackknife_sigma(values: np.ndarray) -> np.ndarray:
    """(...,) standard deviations from estimates (n, ...) that lack one of n parts of the data each (Efron and Stein
    1981, doi:10.1214/aos/1176345462)."""
    count = len(values)
    return np.sqrt((count - 1) / count * np.sum((values - values.mean(0)) ** 2, axis=0))
