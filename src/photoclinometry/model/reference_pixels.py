"""Reference pixels for landmarks that were not made from pixels."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.region import Region


def pixels_of_landmarks(xy: np.ndarray, camera: Camera) -> tuple[np.ndarray, Region]:
    """(J, 2) int32 (row, col): a reference pixel for each landmark; and the region around all of them.

    For landmarks that were not made from pixels. xy: (J, 2) their positions in the reference image [px]. A landmark
    gets the pixel it lies in. Of several in one pixel, the nearest to its centre gets it; the others get the nearest
    free one of the eight around it. If none is free, the landmark shares its pixel and is hidden in gridded maps.
    Raises InputError for landmarks farther outside of the image than its size.
    """
    size = np.array([camera.width, camera.height])
    outside = np.flatnonzero(~np.all((xy > -size) & (xy < 2 * size), axis=-1))
    if len(outside):
        raise InputError(
            f"{len(outside)} of {len(xy)} landmarks lie far outside of the reference image, the first at "
            f"({xy[outside[0], 0]:.6g}, {xy[outside[0], 1]:.6g}) px; choose a reference that sees them"
        )
    pixel = _distinct_pixels(xy)
    row, col = pixel.min(0)
    height, width = pixel.max(0) - (row, col) + 1
    return pixel.astype(np.int32), Region(row=int(row), col=int(col), height=int(height), width=int(width))


def _distinct_pixels(xy: np.ndarray) -> np.ndarray:
    """(J, 2) (row, col) of `pixels_of_landmarks`: candidates are tried in the order of their distance."""
    containing = np.floor(xy[:, ::-1]).astype(np.int64)
    around = np.array([(0, 0), (-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)])
    distance = np.linalg.norm(containing[:, None] + around + 0.5 - xy[:, None, ::-1], axis=-1)
    order = np.argsort(distance, axis=1, kind="stable")
    corner = containing.min(0) - 1
    free = np.ones(containing.max(0) + 2 - corner, bool)
    pixel, unassigned = containing.copy(), np.arange(len(containing))
    for rank in range(len(around)):
        choice = order[unassigned, rank]
        wanted = containing[unassigned] + around[choice]
        cell = np.asarray(np.ravel_multi_index(tuple((wanted - corner).T), free.shape))
        by_distance = np.argsort(distance[unassigned, choice], kind="stable")
        _, first = np.unique(cell[by_distance], return_index=True)
        assigned = by_distance[first]
        assigned = assigned[free.flat[cell[assigned]]]
        free.flat[cell[assigned]] = False
        pixel[unassigned[assigned]] = wanted[assigned]
        unassigned = np.delete(unassigned, assigned)
    return pixel
