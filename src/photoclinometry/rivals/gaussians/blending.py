"""Ellipses blended front to back into a picture, in tiles of 16 x 16 pixels, and the derivatives of that.

Kerbl et al. (2023), Eq. 3, for each pixel over the Gaussians in the order of their depths:

    value = sum_i c_i alpha_i T_i,   T_i = prod_{j < i} (1 - alpha_j),   alpha_i = min(0.99, o_i exp(-d' A_i d / 2))

A tile takes its Gaussians one after the other and visits only the pixels of each, with the transmittance of every pixel
at hand: on a CPU that leaves out what a pixel-by-pixel loop would test in vain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from photoclinometry.rivals.gaussians.projection import Ellipses

TILE = 16
"""Pixels along a tile's side."""
LEAST_ALPHA, MOST_ALPHA = 1.0 / 255.0, 0.99
"""Smaller weights are left out, larger ones are cut (Kerbl et al. 2023)."""
LEAST_LEFT = 1e-4
"""Pixels through which less light passes are finished (Kerbl et al. 2023)."""


class Tiles(NamedTuple):
    """The Gaussians that touch each tile, front to back."""

    start: np.ndarray
    """(tiles + 1,) int64: those of tile t are entry[start[t]:start[t + 1]]."""
    entry: np.ndarray
    """(E,) int64 index of a Gaussian."""
    across: int
    """Tiles in a row."""


class Blended(NamedTuple):
    """A picture of Gaussians."""

    value: np.ndarray
    """(height, width, C) blended values, on black."""
    left: np.ndarray
    """(height, width) transmittance behind the last Gaussian; 1 minus it is the coverage."""
    last: np.ndarray
    """(height, width) int64: how many entries of its tile a pixel has gone through."""


def tiles_of(ellipses: Ellipses, shape: tuple[int, int]) -> Tiles:
    """The tiles of a picture (height, width)."""
    rows, cols = -(-shape[0] // TILE), -(-shape[1] // TILE)
    order = np.argsort(ellipses.depth, kind="stable")
    start, entry = _bin(ellipses, order, rows, cols)
    return Tiles(start, entry, cols)


def blend(ellipses: Ellipses, opacity: np.ndarray, value: np.ndarray, tiles: Tiles, shape: tuple[int, int]) -> Blended:
    """Values (N, C) of Gaussians of opacity (N,) blended into a picture (height, width)."""
    out = Blended(np.zeros((*shape, value.shape[1])), np.ones(shape), np.zeros(shape, np.int64))
    _blend(ellipses, opacity, np.ascontiguousarray(value), tiles, out)
    return out


def blend_back(
    ellipses: Ellipses, opacity: np.ndarray, value: np.ndarray, tiles: Tiles, made: Blended, by_picture: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of a loss by center (N, 2), conic (N, 3), opacity (N,) and value (N, C).

    made: what `blend` gave; by_picture: (height, width, C) derivatives by its value.
    """
    count, channels = value.shape
    by_entry = np.zeros((len(tiles.entry), 6 + channels))
    _blend_back(ellipses, opacity, np.ascontiguousarray(value), tiles, made, np.ascontiguousarray(by_picture), by_entry)
    total = np.zeros((count, 6 + channels))
    _sum_entries(tiles.entry, by_entry, total)
    return total[:, :2], total[:, 2:5], total[:, 5], total[:, 6:]


@njit(cache=True)
def _box(center, radius, first, size):
    """First pixel and the one after the last, of those within a radius of a centre and in [first, first + size)."""
    low = int(np.floor(center - radius))
    high = int(np.ceil(center + radius)) + 1
    return max(low, first), min(high, first + size)


@njit(cache=True)
def _bin(ellipses, order, rows, cols):
    count = np.zeros(rows * cols + 1, np.int64)
    for n in order:
        left, right, top, bottom = _tiles_touched(ellipses, n, rows, cols)
        for row in range(top, bottom):
            for col in range(left, right):
                count[row * cols + col + 1] += 1
    start = np.cumsum(count)
    entry, place = np.empty(start[-1], np.int64), start[:-1].copy()
    for n in order:
        left, right, top, bottom = _tiles_touched(ellipses, n, rows, cols)
        for row in range(top, bottom):
            for col in range(left, right):
                tile = row * cols + col
                entry[place[tile]] = n
                place[tile] += 1
    return start, entry


@njit(cache=True)
def _tiles_touched(ellipses, n, rows, cols):
    """Columns and rows of tiles, first and after the last, of a Gaussian; none behind the camera."""
    radius = ellipses.radius[n]
    if radius <= 0.0:
        return 0, 0, 0, 0
    x, y = ellipses.center[n, 0], ellipses.center[n, 1]
    left, right = max(int(np.floor((x - radius) / TILE)), 0), min(int(np.floor((x + radius) / TILE)) + 1, cols)
    top, bottom = max(int(np.floor((y - radius) / TILE)), 0), min(int(np.floor((y + radius) / TILE)) + 1, rows)
    return left, right, top, bottom


@njit(cache=True, parallel=True, error_model="numpy")
def _blend(ellipses, opacity, value, tiles, out):
    """`blend` into `out`, whose values are 0 and transmittances 1 before. value: (N, C); tiles run in parallel."""
    # Arrays are taken out of their tuples, since Numba's parallel loops do not write into tuples.
    center, conic, reach = ellipses.center, ellipses.conic, ellipses.radius
    start, entry, across = tiles.start, tiles.entry, tiles.across
    drawn, left_over, last = out.value, out.left, out.last
    height, width, channels = drawn.shape
    for tile in prange(len(start) - 1):
        row, col = TILE * (tile // across), TILE * (tile % across)
        for e in range(start[tile], start[tile + 1]):
            n = entry[e]
            u, v, radius = center[n, 0] - 0.5, center[n, 1] - 0.5, reach[n]
            a, b, c = conic[n, 0], conic[n, 1], conic[n, 2]
            o = opacity[n]
            least = np.log(LEAST_ALPHA / o)
            left, right = _box(u, radius, col, min(TILE, width - col))
            top, bottom = _box(v, radius, row, min(TILE, height - row))
            for y in range(top, bottom):
                dy = y - v
                for x in range(left, right):
                    dx = x - u
                    power = -0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy
                    through = left_over[y, x]
                    if power < least or through < LEAST_LEFT:
                        continue
                    alpha = min(MOST_ALPHA, o * np.exp(power))
                    weight = alpha * through
                    for k in range(channels):
                        drawn[y, x, k] += weight * value[n, k]
                    left_over[y, x] = through * (1.0 - alpha)
                    last[y, x] = e - start[tile] + 1


@njit(cache=True, parallel=True, error_model="numpy")
def _blend_back(ellipses, opacity, value, tiles, made, by_picture, by_entry):
    """Derivatives of a loss into by_entry (E, 6 + C), zero before: by center (2), conic (3), opacity and value (C) of
    each Gaussian in each of its tiles.

    Gaussians are visited back to front: the transmittance in front of one is that behind it over 1 - alpha, and
    `behind` is the derivative of what lies behind it. A weight that is cut at MOST_ALPHA depends on neither shape nor
    opacity.
    """
    center, conic, reach = ellipses.center, ellipses.conic, ellipses.radius
    start, entry, across = tiles.start, tiles.entry, tiles.across
    left_over, last = made.left, made.last
    height, width, channels = by_picture.shape
    for tile in prange(len(start) - 1):
        row, col = TILE * (tile // across), TILE * (tile % across)
        through = np.empty((TILE, TILE))
        behind = np.zeros((TILE, TILE))  # by the picture, of what lies behind
        rows, cols = min(TILE, height - row), min(TILE, width - col)
        for y in range(rows):
            for x in range(cols):
                through[y, x] = left_over[row + y, col + x]
        for e in range(start[tile + 1] - 1, start[tile] - 1, -1):
            n, number = entry[e], e - start[tile] + 1
            u, v, radius = center[n, 0] - 0.5, center[n, 1] - 0.5, reach[n]
            a, b, c = conic[n, 0], conic[n, 1], conic[n, 2]
            o = opacity[n]
            least = np.log(LEAST_ALPHA / o)
            left, right = _box(u, radius, col, cols)
            top, bottom = _box(v, radius, row, rows)
            for y in range(top, bottom):
                dy = y - v
                for x in range(left, right):
                    dx = x - u
                    power = -0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy
                    if power < least or number > last[y, x]:
                        continue
                    shape = np.exp(power)
                    alpha = min(MOST_ALPHA, o * shape)
                    before = through[y - row, x - col] / (1.0 - alpha)
                    through[y - row, x - col] = before
                    own = 0.0
                    for k in range(channels):
                        own += by_picture[y, x, k] * value[n, k]
                        by_entry[e, 6 + k] += by_picture[y, x, k] * alpha * before
                    rear = behind[y - row, x - col]
                    by_alpha = before * (own - rear)
                    behind[y - row, x - col] = alpha * own + (1.0 - alpha) * rear
                    if o * shape >= MOST_ALPHA:
                        continue
                    by_power = by_alpha * alpha
                    by_entry[e, 0] += by_power * (a * dx + b * dy)
                    by_entry[e, 1] += by_power * (b * dx + c * dy)
                    by_entry[e, 2] -= 0.5 * by_power * dx * dx
                    by_entry[e, 3] -= by_power * dx * dy
                    by_entry[e, 4] -= 0.5 * by_power * dy * dy
                    by_entry[e, 5] += by_alpha * shape


@njit(cache=True)
def _sum_entries(entry, by_entry, total):
    for e in range(len(entry)):
        for k in range(by_entry.shape[1]):
            total[entry[e], k] += by_entry[e, k]
