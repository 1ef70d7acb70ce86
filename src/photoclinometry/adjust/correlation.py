"""The size of the ground over which errors are correlated, from the autocorrelation of residuals.

Errors of neighbouring landmarks are not independent (`noise`): if n landmarks share an error, the standard deviation of
each is multiplied by sqrt(n).
"""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from photoclinometry.model.robust import FEWEST_FOR_SIGMA, HUBER_LIMIT, robust_sigma

_MAX_VIEWS = 8
"""Views from which the correlation is measured, evenly chosen."""

_SIDE = 256
"""Side of the square of landmarks in the middle of the map from which the correlation is measured: dozens of times the
side of the squares that share an error."""

MIN_PAIRS = 0.1
"""Least share of the expected number of pairs that a lag must have to count in a correlation."""

_CUT = 0.05
"""Correlation below which lags are left out: beyond, there is mostly the noise of the correlation itself."""

_BEYOND_SMOOTH = 3.0
"""Distance at which errors that are still correlated count as smooth ones, in standard deviations of the Gaussian
average that determines these: averages of noise have a correlation of exp(-9 / 4), a tenth, there."""


def correlation_px(
    values: np.ndarray, view: np.ndarray, pixel: np.ndarray, stride: int = 1, smooth_over: float = np.inf
) -> float:
    """Side of the square of pixels in which observations share an error: the median over views, `stride` at least.

    values: (N,) residuals, or (N, c) of c kinds, of which the most correlated counts; view: (N,); pixel: (N, 2) row and
    column of each one's landmark in the reference image, on a grid of every `stride`-th pixel. The square root of the
    number of landmarks that share an error, times the stride. In a view, the variance of the sum of all residuals over
    the sum of their variances, from their autocorrelation up to the lag at which it has died away. Landmarks in the
    middle of the ground that a view sees determine it (_SIDE).

    smooth_over: standard deviation [landmarks] of the Gaussian average that determined the smooth errors which were
    taken out (`photometry.smooth_errors`). Their remainder is no noise and is not counted: the correlation at
    _BEYOND_SMOOTH times that distance, and all beyond. Counted as noise it would lower the weight of brightness, so
    that more of the smooth errors would remain.
    """
    shared = []
    views = np.unique(view)
    for k in views[np.linspace(0, len(views) - 1, min(len(views), _MAX_VIEWS)).astype(int)]:
        mine = np.flatnonzero(view == k)
        row, col = ((pixel[mine] - pixel[mine].min(0)) // stride).T
        middle = _in_the_middle(row) & _in_the_middle(col)
        if np.count_nonzero(middle) >= FEWEST_FOR_SIGMA:
            shared.append(
                _shared(values[mine[middle]].reshape(middle.sum(), -1), row[middle], col[middle], smooth_over)
            )
    return stride * float(np.sqrt(max(1.0, *np.median(shared, axis=0)))) if shared else float(stride)


def _in_the_middle(cell: np.ndarray) -> np.ndarray:
    """(n,) bool: whether a row or column is among the middle _SIDE of 0 to the last."""
    first = (cell.max() + 1 - _SIDE) // 2
    return (cell >= first) & (cell < first + _SIDE)


def _shared(values: np.ndarray, row: np.ndarray, col: np.ndarray, smooth_over: float) -> np.ndarray:
    """(c,) number of one view's residuals (n, c) that share an error; row, col: (n,) of each in the map's grid."""
    row, col = row - row.min(), col - col.min()
    shape = row.max() + 1, col.max() + 1
    there = np.zeros(shape, np.float32)
    there[row, col] = 1.0
    pairs = np.round(_autocorrelation(there))
    distance = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n, 1 / n) for n in pairs.shape), indexing="ij"))
    enough = pairs >= MIN_PAIRS * len(values) * (len(values) / there.size)
    ring = distance[enough].round().astype(int)
    count = np.bincount(ring, pairs[enough])
    found = np.ones(values.shape[1])
    for c, column in enumerate(values.T):
        middle = np.median(column)
        spread = robust_sigma(column - middle)
        if spread > 0.0:
            there[row, col] = np.clip((column - middle) / spread, -HUBER_LIMIT, HUBER_LIMIT)
            products = _autocorrelation(there)
            total, variance = np.bincount(ring, products[enough]), products[0, 0] / len(values)
            correlation = np.divide(total, count, out=np.zeros_like(total), where=count > 0) / variance
            found[c] = _number(_without_smooth(correlation, smooth_over), count / len(values))
    return found


def _without_smooth(correlation: np.ndarray, smooth_over: float) -> np.ndarray:
    """The correlation by distance after removal of the errors that are still correlated at far distances."""
    far = _BEYOND_SMOOTH * smooth_over
    if far > len(correlation) - 1:
        return correlation
    smooth = max(correlation[round(far)], 0.0)
    return (correlation[: round(far)] - smooth) / (1.0 - smooth)


def _number(correlation: np.ndarray, pairs: np.ndarray) -> float:
    """Number of residuals that share an error: the correlation summed over lags, by distance, until it has died away.

    pairs: number for each distance, per residual.
    """
    died = np.flatnonzero(correlation < _CUT)
    end = died[0] if len(died) else len(correlation)
    return float(correlation[:end] @ pairs[:end])


def _autocorrelation(field: np.ndarray) -> np.ndarray:
    """Sums of products at every lag; lags wrap around an array of twice the size, so that ends do not meet."""
    shape = [next_fast_len(2 * n, real=True) for n in field.shape]
    return np.asarray(irfft2(np.abs(np.asarray(rfft2(field, shape))) ** 2, shape))
