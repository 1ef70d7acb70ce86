"""The coarse shape of a body: a closed surface through its sparse points, good enough to plan with and to match by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.body.poisson import closed_surface
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.sparse import SparseModel
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.surface.closed_mesh import signed_volume
from photoclinometry.surface.neighbours import normals_from_neighbours

FEWEST_VIEWS = 3
"""Fewest views of a point: no further view checks the points of two."""
NEIGHBOURS = 16
"""Number of points to which the plane of a normal is fitted."""
FAR = 4.0
"""Points whose neighbours are this many times farther than usual are wrong matches, or details of no use here."""
FEWEST_POINTS = 100
"""Fewest points for a shape."""


@dataclass(frozen=True, kw_only=True)
class ClosedMesh:
    """A closed triangle mesh."""

    vertices: np.ndarray
    """(V, 3) in B."""
    faces: np.ndarray
    """(F, 3), counter-clockwise as seen from outside."""
    spacing: float
    """Mean distance of the points that it goes through [units of B]."""


@dataclass(frozen=True, kw_only=True)
class CoarseShape(Stage[ClosedMesh]):
    """A closed surface through the sparse points."""

    name = "coarse_shape"
    result = ClosedMesh
    sparse: Keyed[SparseModel]

    def make(self, tools: Tools) -> ClosedMesh:
        points, towards = _seen_well(self.sparse.value)
        if len(points) < FEWEST_POINTS:
            raise ReconstructionError(
                f"{len(points)} points are seen in {FEWEST_VIEWS} views or more, a shape needs {FEWEST_POINTS}; give "
                "more images, or allow more features (--sfm.max-features)"
            )
        points, normals, spacing = oriented(points, towards)
        vertices, faces = closed_surface(points, normals, spacing, tools.scratch)
        radius = float(np.cbrt(0.75 / np.pi * signed_volume(vertices, faces)))
        say_found(f"{len(points):,} points, mean radius {radius:.4g}")
        return ClosedMesh(vertices=vertices, faces=faces, spacing=spacing)


def _seen_well(sparse: SparseModel) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of FEWEST_VIEWS views or more, and unit vectors (n, 3) from them towards these views."""
    often = np.diff(sparse.point_start) >= FEWEST_VIEWS
    return sparse.points[often], sparse.towards_views[often]


def oriented(points: np.ndarray, towards: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Those of points (n, 3) that have neighbours, their outward unit normals, and the mean distance of neighbours.

    towards: (n, 3) unit vectors to the cameras that see the points.
    """
    from scipy.spatial import KDTree

    distance = KDTree(points).query(points, min(NEIGHBOURS, len(points)))[0][:, 1:].mean(1)
    kept = distance <= FAR * np.median(distance)
    points, towards = points[kept], towards[kept]
    distance = KDTree(points).query(points, min(NEIGHBOURS, len(points)))[0][:, 1:].mean(1)
    return points, normals_from_neighbours(points, points + towards, NEIGHBOURS), float(np.median(distance))
