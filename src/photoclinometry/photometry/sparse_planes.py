"""The ground of a sparse model: planes through neighbouring points, and images as blurred as such planes are."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.image import Image
from photoclinometry.model.sampling import blurred
from photoclinometry.model.sparse import SparseModel
from photoclinometry.surface.neighbours import PLANE_NEIGHBOURS, normals_from_neighbours

LEAST_BLUR_PX = 0.5
"""Least standard deviation of the images' blur [px]: the point-spread function that they have anyway."""


def sparse_planes(sparse: SparseModel, neighbours: int = PLANE_NEIGHBOURS) -> tuple[np.ndarray, float]:
    """Outward normals (P, 3) of planes through neighbours, and the standard deviation of the blur by such a plane.

    The latter is half the radius of the neighbours: the standard deviation of a disk along each axis.
    """
    from scipy.spatial import KDTree

    points = sparse.points
    count = min(neighbours, len(points))
    farthest = np.asarray(KDTree(points).query(points, k=count)[0])[:, -1]
    return normals_from_neighbours(points, points + sparse.towards_views, count), 0.5 * float(np.median(farthest))


def as_blurred(image: Image, blur: float, gsd: float) -> Image:
    """The image blurred like planes of the standard deviation `blur`; `blur` and `gsd`, the size of a pixel, in units
    of B."""
    return blurred(image, max(blur / gsd, LEAST_BLUR_PX))
