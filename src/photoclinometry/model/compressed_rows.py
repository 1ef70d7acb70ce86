"""Rows of different lengths in one array (compressed rows): row j is entries start[j]:start[j + 1].

`Tracks`, `SparseModel` and `DenseTracks` keep the observations of each point so.
"""

from __future__ import annotations

import numpy as np


def row_starts(count: np.ndarray) -> np.ndarray:
    """(J + 1,) int64: where each row starts, and where the last one ends, for rows of `count` (J,) entries."""
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


def row_of_entry(start: np.ndarray) -> np.ndarray:
    """(N,) int64: the row that each entry belongs to, for starts (J + 1,)."""
    return np.repeat(np.arange(len(start) - 1), np.diff(start))
