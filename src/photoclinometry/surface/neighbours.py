"""Neighbouring points: planes through them, and the limit of their distance."""

from __future__ import annotations

import numpy as np

PLANE_NEIGHBOURS = 32
"""Points to which the plane of a normal is fitted: about six by six, a width of several times the noise of points."""

_BLOCK = 20_000
"""Points whose neighbours are handled at a time: limits the memory to 100 MB."""

_FARTHEST = 3.0
"""Points farther apart than the mean plus this many standard deviations of all distances are no neighbours: they lie
across a hole of the map (the paper's configuration)."""


def normals_from_neighbours(position: np.ndarray, viewpoint: np.ndarray, count: int = PLANE_NEIGHBOURS) -> np.ndarray:
    """(J, 3) unit normals of planes through each point's `count` nearest neighbours, itself included.

    position: (J, 3), J >= 3; viewpoint: (3,) or (J, 3), from where the points are seen, in the same frame. The normal
    is the eigenvector of the neighbours' scatter with the least eigenvalue, turned towards the viewpoint.
    Raises ValueError for fewer than 3 points.
    """
    from scipy.spatial import KDTree

    position = np.asarray(position, float)
    if len(position) < 3:
        raise ValueError(f"a plane needs 3 points, got {len(position)}")
    _, near = KDTree(position).query(position, k=min(count, len(position)), workers=-1)
    normal = np.empty_like(position)
    for part in np.array_split(np.arange(len(position)), max(1, len(position) // _BLOCK)):
        around = position[np.asarray(near)[part]]
        around = around - around.mean(1, keepdims=True)
        normal[part] = np.linalg.eigh(np.einsum("jni,jnk->jik", around, around))[1][..., 0]
    away = np.sum(normal * (viewpoint - position), -1) < 0
    normal[away] *= -1
    return normal


def neighbours(position: np.ndarray, count: int, nearest: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The nearest other points: (J, count) int32 indices and (J, count) bool, which of them are near enough.

    position: (J, 3). Pairs across the holes of a map are dropped (_FARTHEST), and those nearer than `nearest`. Raises
    ValueError unless J > count.
    """
    from scipy.spatial import KDTree

    if len(position) <= count:
        raise ValueError(f"{count} neighbours need more than {count} points, got {len(position)}")
    distance, near = KDTree(position).query(position, k=count + 1, workers=-1)
    # Where points coincide, the point itself need not be in the first column.
    itself = near == np.arange(len(position))[:, None]
    itself[~itself.any(1), -1] = True
    near, distance = np.asarray(near)[~itself].reshape(-1, count), np.asarray(distance)[~itself].reshape(-1, count)
    farthest = distance.mean() + _FARTHEST * distance.std()
    return near.astype(np.int32), (distance >= nearest) & (distance <= farthest)
