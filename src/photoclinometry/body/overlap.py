"""Comparison of tiles where they overlap: the factors of their albedos, and factors on their sigmas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.model.robust import FEWEST_FOR_SIGMA

FACING = 0.5
"""Least cosine between the normals of landmarks of the same ground: thin necks have two sides."""
NEIGHBOURS = 9
"""Number of nearest landmarks among which those of other tiles are sought: two tiles have about as many in reach."""
MOST_SHARED = 0.95
"""Tiles that share more of their images than this do not show each other's errors."""
_MEDIAN_SQUARE = {"height": 0.455, "normal": 0.693, "albedo": 0.455}
"""Medians of squared errors over their expectations: of one Gaussian number, and of a vector of two."""


@dataclass(frozen=True, kw_only=True)
class Overlap:
    """Pairs of landmarks of two tiles each, at the same place of the ground."""

    first: np.ndarray
    """(p,) rows; of the tile of the smaller number."""
    second: np.ndarray
    """(p,)."""


def overlap_of(position: np.ndarray, normal: np.ndarray, tile: np.ndarray, gsd: float) -> Overlap:
    """Pairs among landmarks (n, 3) of tiles (n,) that are nearer to each other than the ground sample distance."""
    from scipy.spatial import KDTree

    distance, near = KDTree(position).query(position, NEIGHBOURS, distance_upper_bound=gsd)
    first, column = np.nonzero(np.isfinite(distance))
    second = np.asarray(near)[first, column]
    pair = (tile[first] < tile[second]) & (np.sum(normal[first] * normal[second], -1) > FACING)
    return Overlap(first=first[pair], second=second[pair])


def albedo_factors(overlap: Overlap, albedo: np.ndarray, tile: np.ndarray, count: int) -> np.ndarray:
    """(count,) factors of the tiles' albedos, one in the geometric mean, by which they differ where they overlap.

    A tile's factor follows from its own reflectance parameters, which its images determine by a per cent or so.
    """
    known = (albedo[overlap.first] > 0) & (albedo[overlap.second] > 0)
    first, second = overlap.first[known], overlap.second[known]
    ratio = np.log(albedo[first] / albedo[second])
    key = tile[first] * count + tile[second]
    rows, right, weight = [], [], []
    for each in np.unique(key):
        own = key == each
        a, b = divmod(int(each), count)
        row = np.zeros(count)
        row[a], row[b] = 1.0, -1.0
        rows.append(row)
        right.append(np.median(ratio[own]))
        weight.append(np.sqrt(own.sum()))
    rows.append(np.ones(count))  # the mean is one
    right.append(0.0)
    weight.append(1.0)
    by = np.array(weight)
    log_factor = np.linalg.lstsq(np.array(rows) * by[:, None], np.array(right) * by, rcond=None)[0]
    return np.exp(log_factor)


def shared_images(views: Sequence[np.ndarray]) -> np.ndarray:
    """(T, T) correlations of the tiles' errors, if each image has independent ones: the share of common images.

    views: numbers of the views of each tile. The correlation is |A and B| / sqrt(|A| |B|), 1 of a tile with itself.
    """
    count = 1 + max((int(each.max()) for each in views if len(each)), default=0)
    used = np.zeros((len(views), count))
    for number, each in enumerate(views):
        used[number, each] = 1.0
    size = np.sqrt(np.maximum(used.sum(1), 1.0))
    return used @ used.T / size[:, None] / size + np.diag(np.where(used.any(1), 0.0, 1.0))


def sigma_factors(
    overlap: Overlap,
    position: np.ndarray,
    normal: np.ndarray,
    albedo: np.ndarray,
    sigmas: np.ndarray,
    correlation: np.ndarray,
) -> np.ndarray:
    """(3,) ratios of the errors of heights, normals and albedos to the stated ones; 1 at least.

    Two tiles differ by the errors of both, except those from common images: the variance of a difference is (1 - c)
    (s1^2 + s2^2), c being the correlation of the two tiles. sigmas: (n, 3) as stated; correlation: (p,) of each pair.
    Medians keep boulders' edges from deciding.
    """
    first, second = overlap.first, overlap.second
    up = unit(normal[first] + normal[second])
    with np.errstate(divide="ignore", invalid="ignore"):
        differences = {
            "height": np.sum((position[first] - position[second]) * up, -1),
            "normal": angle_between(normal[first], normal[second]),
            "albedo": np.log(albedo[first] / albedo[second]),
        }
    found = np.ones(len(differences))
    for column, (name, difference) in enumerate(differences.items()):
        both = sigmas[first, column] ** 2 + sigmas[second, column] ** 2
        usable = np.isfinite(difference) & np.isfinite(both) & (both > 0) & (correlation < MOST_SHARED)
        variance = (1.0 - correlation[usable]) * both[usable]
        if usable.sum() >= FEWEST_FOR_SIGMA:
            square = float(np.median(difference[usable] ** 2 / variance))
            found[column] = max(1.0, np.sqrt(square / _MEDIAN_SQUARE[name]))
    return found
