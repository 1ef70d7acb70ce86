"""Features of places by grids of several resolutions, whose nodes share the entries of hash tables.

Mueller et al. (2022), ACM Transactions on Graphics 41(4), doi:10.1145/3528223.3530127, section 3 (arXiv:2201.05989).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

import photoclinometry.model.kernel_cache  # noqa: F401

FEATURES = 2
"""Numbers per entry (Mueller et al. 2022, Table 1)."""
_PRIMES = (np.uint32(1), np.uint32(2654435761), np.uint32(805459861))
"""Factors of the hash function (Mueller et al. 2022, Eq. 4)."""


def resolutions(levels: int, coarsest: int, finest: int) -> np.ndarray:
    """(L,) cells along the unit cube's side, growing geometrically (Mueller et al. 2022, Eqs. 2 and 3)."""
    growth = (finest / coarsest) ** (np.arange(levels) / max(levels - 1, 1))
    return np.floor(coarsest * growth + 1e-9).astype(np.int64)


@njit(cache=True)
def _entry(x, y, z, cells, size):
    """The table's entry of a node: every node has its own where the table is large enough, else by a hash."""
    side = cells + 1
    if side * side * side <= size:
        return (z * side + y) * side + x
    mixed = np.uint32(x) * _PRIMES[0] ^ np.uint32(y) * _PRIMES[1] ^ np.uint32(z) * _PRIMES[2]
    return np.int64(mixed % np.uint32(size))


@njit(cache=True)
def _cell(value, cells):
    """The cell of a coordinate in [0, 1], and the share of the cell that lies below it."""
    at = min(max(value, 0.0), 1.0) * cells
    low = min(np.int64(at), cells - 1)
    return low, np.float32(at - low)


@njit(cache=True)
def _corner(place, cells, size, corner):
    """The table's entry and the weight of one of the eight corners of a place's cell."""
    x, part_x = _cell(place[0], cells)
    y, part_y = _cell(place[1], cells)
    z, part_z = _cell(place[2], cells)
    one = np.float32(1.0)
    up_x, up_y, up_z = corner & 1, (corner >> 1) & 1, (corner >> 2) & 1
    weight = (part_x if up_x else one - part_x) * (part_y if up_y else one - part_y)
    weight *= part_z if up_z else one - part_z
    return _entry(x + up_x, y + up_y, z + up_z, cells, size), weight


@njit(cache=True, parallel=True)
def encode(places, cells, table):
    """Features (n, L * FEATURES) float32 of places (n, 3) in the unit cube: trilinear between the nodes of L levels.

    cells: (L,); table: (L, T, FEATURES) float32.
    """
    count, levels, size = len(places), len(cells), table.shape[1]
    found = np.zeros((count, levels * FEATURES), np.float32)
    for level in prange(levels):
        for n in range(count):
            for corner in range(8):
                entry, weight = _corner(places[n], cells[level], size, corner)
                for f in range(FEATURES):
                    found[n, level * FEATURES + f] += weight * table[level, entry, f]
    return found


@njit(cache=True, parallel=True)
def encode_back(places, cells, size, by_features):
    """Derivatives of a loss by the table (L, T, FEATURES), from those by the features (n, L * FEATURES).

    Levels are apart from each other, so that no two threads write to one entry.
    """
    count, levels = len(places), len(cells)
    found = np.zeros((levels, size, FEATURES), np.float32)
    for level in prange(levels):
        for n in range(count):
            for corner in range(8):
                entry, weight = _corner(places[n], cells[level], size, corner)
                for f in range(FEATURES):
                    found[level, entry, f] += weight * by_features[n, level * FEATURES + f]
    return found
