"""Each landmark's covariance given all views, from a window of the map around it.

Given the views, landmarks are coupled by smoothness alone, which links a landmark's normal with the neighbours'
positions. Normals and albedos are therefore eliminated landmark by landmark, and the remaining equations of a window,
three numbers a landmark, are inverted as a whole. The outside is approximated: links that leave the window have a fifth
of the weight of links with fixed far ends. Without them the depth would be too uncertain, with their full weight too
certain.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from photoclinometry.adjust.graph.smoothness import Neighbours
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE
from photoclinometry.model.cholesky import factorize, invert
from photoclinometry.model.threads import in_threads, runs

OUTSIDE = 0.2
"""Weight of links that leave a window."""

RIDGE, MORE_RIDGE = 1e-10, 100.0
"""Relative information added to every coordinate, so that an undetermined one does not stop the others; and the factor
by which it grows where rounding needs more."""

_COMPILED: dict[str, Any] = dict(cache=True, error_model="numpy", nogil=True)


def with_ridge(diagonal: np.ndarray, ridge: float = RIDGE) -> np.ndarray:
    """The diagonal of an information matrix with the ridge; one where there is nothing."""
    return np.where(diagonal > 0.0, diagonal * (1.0 + ridge), 1.0)


class Links(NamedTuple):
    """The smoothness factors, linearized: `Neighbours` with their whitened rows."""

    start: np.ndarray
    target: np.ndarray
    source: np.ndarray
    incoming_start: np.ndarray
    incoming: np.ndarray
    rows: np.ndarray
    """(P, 5): by the neighbour's position 3 (the landmark's own is the opposite) and by the normal 2."""


def links(neighbours: Neighbours, rows: np.ndarray) -> Links:
    """With signed indices, which NumPy and Numba mix without converting to floats."""
    start, target, source, incoming_start, incoming = (np.asarray(part, np.int64) for part in neighbours)
    return Links(start, target, source, incoming_start, incoming, np.asarray(rows, float))


def covariances_given_views(own: np.ndarray, links: Links, patches: list[tuple[int, int]]) -> np.ndarray:
    """(J, 6, 6) from every landmark's own information (J, 6, 6), everything but smoothness.

    patches: runs of landmarks first:last, each treated in one window with the neighbours of its landmarks.
    """
    out = np.empty_like(own)

    def invert_windows(some: slice) -> None:
        local = np.full(len(own), -1)
        for first, last in patches[some]:
            ids = _window(first, last, links)
            local[ids] = np.arange(len(ids))
            out[first:last] = _invert_window(ids, last - first, local, own, links)
            local[ids] = -1

    in_threads(invert_windows, runs(len(patches)))
    return out


def _window(first: int, last: int, links: Links) -> np.ndarray:
    """Landmarks first:last, then those linked with them."""
    out = links.target[links.start[first] : links.start[last]]
    into = links.source[links.incoming[links.incoming_start[first] : links.incoming_start[last]]]
    around = np.unique(np.concatenate([out, into]))
    return np.concatenate([np.arange(first, last), around[(around < first) | (around >= last)]])


def _invert_window(ids: np.ndarray, core: int, local: np.ndarray, own: np.ndarray, links: Links) -> np.ndarray:
    """Covariances (core, 6, 6) of the window's first `core` landmarks."""
    count = len(ids)
    most = 1 + int(np.max(links.start[ids + 1] - links.start[ids], initial=0))
    positions = np.zeros((3 * count, 3 * count))
    inverse = np.empty((count, 3, 3))
    partner, through = np.full((count, most), -1), np.zeros((count, most, 3, 3))
    _eliminate(ids, local, own, links, OUTSIDE, positions, inverse, partner, through)
    covariance = _inverse(positions)
    out = np.empty((core, LANDMARK_SIZE, LANDMARK_SIZE))
    _substitute(core, covariance, inverse, partner, through, out)
    return out


def _inverse(positions: np.ndarray) -> np.ndarray:
    """Lower triangle of the inverse of an information matrix (3n, 3n), with as much of a ridge as it needs."""
    ridge = RIDGE
    while ridge < 1.0:
        inverse = positions.copy()
        np.einsum("aa->a", inverse)[:] = with_ridge(np.diag(positions), ridge)
        try:
            factorize(inverse)
        except np.linalg.LinAlgError:
            ridge *= MORE_RIDGE
            continue
        invert(inverse)
        return inverse
    raise FloatingPointError("the information of positions is not positive, far beyond rounding")


@njit(**_COMPILED)
def _eliminate(ids, local, own, links, outside, positions, inverse, partner, through):
    """Fills positions (3n, 3n), the information of positions alone; inverse (n, 3, 3), the covariance of normals and
    albedos given positions; and through (n, m, 3, 3), minus their response to positions `partner`."""
    half, at_normal, root = np.empty(through.shape[1:]), np.empty((3, 3)), np.empty((3, 3))
    for a in range(ids.size):
        j = ids[a]
        first = 3 * a
        partner[a, 0] = a
        used = 1
        for x in range(3):
            for y in range(3):
                at_normal[x, y] = own[j, 3 + x, 3 + y]
                through[a, 0, x, y] = own[j, 3 + x, y]
                positions[first + x, first + y] += own[j, x, y]
        for p in range(links.start[j], links.start[j + 1]):
            v, t = links.rows[p, :3], links.rows[p, 3:]
            b = local[links.target[p]]
            weight = 1.0 if b >= 0 else outside
            for x in range(3):
                for y in range(3):
                    positions[first + x, first + y] += weight * v[x] * v[y]
                    if b >= 0:
                        positions[3 * b + x, 3 * b + y] += v[x] * v[y]
                        positions[first + x, 3 * b + y] -= v[x] * v[y]
                        positions[3 * b + x, first + y] -= v[x] * v[y]
                for y in range(2):
                    through[a, 0, y, x] -= weight * t[y] * v[x]
                    if b >= 0:
                        through[a, used, y, x] = t[y] * v[x]
            for x in range(2):
                for y in range(2):
                    at_normal[x, y] += weight * t[x] * t[y]
            if b >= 0:
                partner[a, used] = b
                used += 1
        for e in range(links.incoming_start[j], links.incoming_start[j + 1]):
            p = links.incoming[e]
            if local[links.source[p]] < 0:
                v = links.rows[p, :3]
                for x in range(3):
                    for y in range(3):
                        positions[first + x, first + y] += outside * v[x] * v[y]
        for x in range(3):
            at_normal[x, x] = at_normal[x, x] * (1.0 + RIDGE) if at_normal[x, x] > 0.0 else 1.0
        _inverse_factor(at_normal, root)
        for x in range(3):
            for y in range(3):
                inverse[a, x, y] = root[0, x] * root[0, y] + root[1, x] * root[1, y] + root[2, x] * root[2, y]
        # Squares are subtracted: with an inverse in between, an undetermined direction would leave the square of its #
        # rounding, times 1 / RIDGE.
        for m in range(used):
            _multiply(root, through[a, m], half[m])
        for m in range(used):
            for l in range(used):
                b, c = 3 * partner[a, l], 3 * partner[a, m]
                for x in range(3):
                    for y in range(3):
                        for z in range(3):
                            positions[b + x, c + y] -= half[l, z, x] * half[m, z, y]
        for m in range(used):
            for x in range(3):
                for y in range(3):
                    through[a, m, x, y] = (
                        root[0, x] * half[m, 0, y] + root[1, x] * half[m, 1, y] + root[2, x] * half[m, 2, y]
                    )


@njit(**_COMPILED)
def _inverse_factor(a, out):
    """out = L^-1 of a = L L^T, (3, 3), whose pivots are RIDGE of the diagonal at least."""
    pivot = np.sqrt(a[0, 0])
    l10, l20 = a[1, 0] / pivot, a[2, 0] / pivot
    second = np.sqrt(max(a[1, 1] - l10 * l10, RIDGE * a[1, 1]))
    l21 = (a[2, 1] - l20 * l10) / second
    third = np.sqrt(max(a[2, 2] - l20 * l20 - l21 * l21, RIDGE * a[2, 2]))
    out[:] = 0.0
    out[0, 0], out[1, 1], out[2, 2] = 1.0 / pivot, 1.0 / second, 1.0 / third
    out[1, 0] = -l10 / (pivot * second)
    out[2, 1] = -l21 / (second * third)
    out[2, 0] = -(l20 / pivot + l21 * out[1, 0]) / third


@njit(**_COMPILED)
def _multiply(a, b, out):
    """out = a b, of (3, 3)."""
    for x in range(3):
        for y in range(3):
            out[x, y] = a[x, 0] * b[0, y] + a[x, 1] * b[1, y] + a[x, 2] * b[2, y]


@njit(**_COMPILED)
def _substitute(core, covariance, inverse, partner, through, out):
    """Fills out (core, 6, 6) from the positions' covariance (3n, 3n), of which the lower triangle is given."""
    block, half = np.empty((3, 3)), np.empty((3, 3))
    for a in range(core):
        _block(covariance, a, a, block)
        for x in range(3):
            for y in range(3):
                out[a, x, y] = block[x, y]
                out[a, 3 + x, 3 + y] = inverse[a, x, y]
                out[a, 3 + x, y] = 0.0
        for m in range(partner.shape[1]):
            b = partner[a, m]
            if b < 0:
                break
            _block(covariance, b, a, block)
            _multiply(through[a, m], block, half)
            for x in range(3):
                for y in range(3):
                    out[a, 3 + x, y] -= half[x, y]
            for l in range(partner.shape[1]):
                if partner[a, l] < 0:
                    break
                _block(covariance, b, partner[a, l], block)
                _multiply(through[a, m], block, half)
                for x in range(3):
                    for y in range(3):
                        for z in range(3):
                            out[a, 3 + x, 3 + y] += half[x, z] * through[a, l, y, z]
        for x in range(3):
            for y in range(3):
                out[a, y, 3 + x] = out[a, 3 + x, y]


@njit(**_COMPILED)
def _block(covariance, a, b, out):
    """Block (3, 3) of two landmarks."""
    for x in range(3):
        for y in range(3):
            i, k = 3 * a + x, 3 * b + y
            out[x, y] = covariance[max(i, k), min(i, k)]
