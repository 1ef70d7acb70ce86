"""Volume, area, centre of mass and inertia of a homogeneous closed mesh, with standard deviations.

An error h of a vertex along its normal changes the integral of f over the body. The change is h times an integral over
the faces around the vertex: of f, the vertex's share of the surface, and the cosine between both normals. Standard
deviations follow from these first derivatives, the standard deviations of heights, and the assumption that errors of
two vertices at a distance d are correlated by exp(-d^2 / (2 L^2)). L = 0 means independent errors, L = inf one error
that all share. First derivatives do not contain the enlargement of the area by rough errors: its mean is too large by a
share of the squared slopes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

import photoclinometry.model.kernel_cache  # noqa: F401
from photoclinometry.surface.closed_mesh import surface_area, vertex_normals

DEFAULT_CORRELATION = 0.1
"""Correlation length of height errors where none is given [mean radii]: the size of a landform that images resolve."""
UNKNOWN_PERCENT = 99.0
"""Heights without a standard deviation get this percentile of the others. The largest one belongs to a single vertex:
520 m on a simulated body of 900 m whose 99th percentile is 5 m."""
_REACH = 4.0
"""Correlations beyond this many lengths, 0.0003 and less, are left out."""
_CLUSTER = 0.25
"""Vertices within this many correlation lengths are combined: their correlation is above 0.97."""
_FINEST = 1.0 / 32.0
"""Vertices farther apart than this share of the body are not combined: the centre of mass depends only on the
differences of errors that nearly all vertices share."""
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Places of second moments."""
# Points and weights that are exact for polynomials of degree 4 on a triangle (Strang & Fix 1973).
_NEAR, _FAR = 0.445948490915965, 0.091576213509771
_WEIGHT_NEAR, _WEIGHT_FAR = 0.223381589678011, 0.109951743655322


def _rule() -> np.ndarray:
    rows = []
    for a, weight in ((_NEAR, _WEIGHT_NEAR), (_FAR, _WEIGHT_FAR)):
        b = 1.0 - 2.0 * a
        rows += [[a, a, b, weight], [a, b, a, weight], [b, a, a, weight]]
    return np.array(rows)


_RULE = _rule()
"""(6, 4): weights of a triangle's corners, and of the point."""


@dataclass(frozen=True, kw_only=True)
class MassProperties:
    """Of a homogeneous body, in the unit of the mesh. Standard deviations are NaN where none of heights are known."""

    volume: float
    area: float
    center: np.ndarray
    """(3,) centre of mass."""
    inertia: np.ndarray
    """(3, 3) inertia tensor about the centre of mass, over the mass."""
    sigma_volume: float
    sigma_area: float
    sigma_center: np.ndarray
    """(3,)."""
    sigma_inertia: np.ndarray
    """(3, 3)."""

    @property
    def mean_radius(self) -> float:
        """Of the sphere of the same volume."""
        return mean_radius(self.volume)


def mean_radius(volume: float) -> float:
    """Of the sphere of a volume."""
    return math.cbrt(0.75 / math.pi * volume)


def mass_properties(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    normals: np.ndarray | None = None,
    sigma_height: np.ndarray | None = None,
    correlation_length: float = 0.0,
) -> MassProperties:
    """Of a closed mesh of vertices (V, 3) and faces (F, 3) that look outwards.

    normals: (V, 3) directions of the height errors, by default the mesh's; sigma_height: (V,) standard deviations, NaN
    where unknown, which counts as their UNKNOWN_PERCENT percentile; correlation_length: L above, 0 to infinity.
    """
    lengths = (correlation_length,)
    return properties_by_length(vertices, faces, lengths, normals=normals, sigma_height=sigma_height)[0]


def properties_by_length(
    vertices: np.ndarray,
    faces: np.ndarray,
    correlation_lengths: Sequence[float],
    *,
    normals: np.ndarray | None = None,
    sigma_height: np.ndarray | None = None,
) -> list[MassProperties]:
    """As `mass_properties`, for each of several correlation lengths; the derivatives are computed once."""
    normals = vertex_normals(vertices, faces) if normals is None else normals
    # About the mean vertex: second moments about a far origin would lose their digits.
    origin = vertices.mean(0)
    values, slopes = _moments(vertices - origin, faces, normals)
    center = values[1:4] / values[0]
    inertia, to_center, to_inertia = _about_center(values, slopes, center)
    derivatives = np.concatenate([slopes[:, :1], slopes[:, 10:], to_center, to_inertia.reshape(-1, 9)], axis=1)
    area = surface_area(vertices, faces)
    found = []
    for length in correlation_lengths:
        sigma = _sigmas(vertices, derivatives, sigma_height, length)
        found.append(
            MassProperties(
                volume=float(values[0]),
                area=area,
                center=center + origin,
                inertia=inertia,
                sigma_volume=float(sigma[0]),
                sigma_area=float(sigma[1]),
                sigma_center=sigma[2:5],
                sigma_inertia=sigma[5:].reshape(3, 3),
            )
        )
    return found


def _about_center(
    values: np.ndarray, slopes: np.ndarray, center: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The inertia tensor (3, 3) about the centre of mass over the mass, and the derivatives of the centre (V, 3) and of
    the tensor (V, 3, 3) by each vertex's height; values and slopes: of `_moments`."""
    volume = values[0]
    to_center = (slopes[:, 1:4] - slopes[:, :1] * center) / volume
    second, to_second = np.empty((3, 3)), np.empty((len(slopes), 3, 3))
    for n, (i, j) in enumerate(_PAIRS):
        mean = values[4 + n] / volume
        second[i, j] = second[j, i] = mean - center[i] * center[j]
        step = (slopes[:, 4 + n] - slopes[:, 0] * mean) / volume
        to_second[:, i, j] = to_second[:, j, i] = step - to_center[:, i] * center[j] - to_center[:, j] * center[i]
    trace = np.trace(to_second, axis1=1, axis2=2)[:, None, None]
    return np.trace(second) * np.eye(3) - second, to_center, trace * np.eye(3) - to_second


def _moments(vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(10,) integrals of 1, x, y, z, xx, yy, zz, xy, xz, yz over the body, and (V, 11) the derivatives of these and of
    the area by each vertex's height."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    six = np.einsum("ij,ij->i", a, np.cross(b, c))
    total = a + b + c
    stacked = np.stack([total, a, b, c])
    second = np.einsum("n,kni,knj->ij", six, stacked, stacked) / 120.0
    values = [six.sum() / 6.0, *((six[:, None] * total).sum(0) / 24.0), *(second[i, j] for i, j in _PAIRS)]
    slopes = np.zeros((len(vertices), 11))
    _add_slopes(np.ascontiguousarray(vertices, float), faces, np.ascontiguousarray(normals, float), _RULE, slopes)
    return np.array(values), slopes


@njit(cache=True)
def _add_slopes(vertices, faces, normals, rule, slopes):
    """Adds to slopes (V, 11) the derivatives of `_moments` by each vertex's height along its normal (V, 3).

    A rise of a vertex adds a layer that is linear on each triangle around it: its integrals are those of the products
    with the triangle's areas by a rule (n, 4) of barycentric points and weights. The last column is of the area.
    """
    f_value = np.empty(10)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        area = 0.5 * np.cross(b - a, c - a)
        size = math.sqrt(np.sum(area * area))
        for n in range(len(rule)):
            p = rule[n, 0] * a + rule[n, 1] * b + rule[n, 2] * c
            f_value[0] = 1.0
            f_value[1:4] = p
            f_value[4], f_value[5], f_value[6] = p[0] * p[0], p[1] * p[1], p[2] * p[2]
            f_value[7], f_value[8], f_value[9] = p[0] * p[1], p[0] * p[2], p[1] * p[2]
            for k in range(3):
                vertex = faces[f, k]
                share = rule[n, 3] * rule[n, k] * np.sum(area * normals[vertex])
                for m in range(10):
                    slopes[vertex, m] += share * f_value[m]
        if size > 0.0:
            for k in range(3):
                vertex = faces[f, k]
                opposite = vertices[faces[f, (k + 2) % 3]] - vertices[faces[f, (k + 1) % 3]]
                slopes[vertex, 10] += 0.5 / size * np.sum(np.cross(area, opposite) * normals[vertex])


def _sigmas(
    vertices: np.ndarray, derivatives: np.ndarray, sigma_height: np.ndarray | None, length: float
) -> np.ndarray:
    """(n,) standard deviations of quantities with derivatives (V, n) by the heights of vertices (V, 3)."""
    if sigma_height is None or not np.isfinite(sigma_height).any():
        return np.full(derivatives.shape[1], np.nan)
    known = np.isfinite(sigma_height)
    sigma = np.where(known, sigma_height, np.percentile(sigma_height[known], UNKNOWN_PERCENT, method="lower"))
    moves = derivatives * sigma[:, None]
    if length == 0.0:
        return np.sqrt((moves**2).sum(0))
    if math.isinf(length):
        return np.abs(moves.sum(0))
    extent = float(np.ptp(vertices, axis=0).max())
    place, moves = _clustered(vertices, moves, min(_CLUSTER * length, _FINEST * extent))
    place, moves, first, boxes = _boxed(place, moves, _REACH * length)
    return np.sqrt(np.maximum(_correlated(place, moves, first, boxes, length), 0.0))


def _clustered(place: np.ndarray, moves: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean places and summed moves of the points within each cube of a size."""
    _, index, count = np.unique(np.floor(place / size), axis=0, return_inverse=True, return_counts=True)
    index = index.ravel()
    mean = np.stack([np.bincount(index, axis) for axis in place.T], -1) / count[:, None]
    return mean, np.stack([np.bincount(index, column) for column in moves.T], -1)


def _boxed(place: np.ndarray, moves: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points sorted by boxes of a size; the first point (B + 1,) of each box, and its 27 neighbours (B, 27), -1 where
    there is no box."""
    box = np.floor((place - place.min(0)) / size).astype(np.int64) + 1
    side = box.max() + 2
    key = (box[:, 0] * side + box[:, 1]) * side + box[:, 2]
    order = np.argsort(key, kind="stable")
    keys, first = np.unique(key[order], return_index=True)
    step = np.array([(i * side + j) * side + k for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
    near = keys[:, None] + step
    index = np.minimum(np.searchsorted(keys, near), len(keys) - 1)
    return place[order], moves[order], np.r_[first, len(place)], np.where(keys[index] == near, index, -1)


@njit(cache=True)
def _correlated(place, moves, first, boxes, length):
    """(n,) sums over pairs of points of the product of their moves times their correlation."""
    total = np.zeros(moves.shape[1])
    for box in range(len(boxes)):
        for other in boxes[box]:
            if other < 0:
                continue
            for i in range(first[box], first[box + 1]):
                for j in range(first[other], first[other + 1]):
                    square = 0.0
                    for d in range(3):
                        square += (place[i, d] - place[j, d]) ** 2
                    share = math.exp(-0.5 * square / (length * length))
                    for n in range(len(total)):
                        total[n] += share * moves[i, n] * moves[j, n]
    return total
