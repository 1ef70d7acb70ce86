"""Medians of compressed rows (`compressed_rows`), compiled."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def row_medians(value: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(J,) the median of each row of values (N,), the upper one of two middle values; NaN of rows without entries."""
    median = np.full(start.size - 1, np.nan)
    for j in range(median.size):
        row = np.sort(value[start[j] : start[j + 1]])
        if row.size:
            median[j] = row[row.size // 2]
    return median
