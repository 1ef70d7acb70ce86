"""A closed surface through oriented points: screened Poisson reconstruction, as COLMAP has it.

Kazhdan and Hoppe 2013, "Screened Poisson surface reconstruction", doi:10.1145/2487228.2487237. Where there are no
points the surface closes smoothly.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.meshes.ply import read_ply, write_oriented_points
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.surface.closed_mesh import is_watertight, largest_component, signed_volume


def closed_surface(
    points: np.ndarray, normals: np.ndarray, cell: float, work_dir: Path, threads: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and faces (F, 3) of one closed surface near points (n, 3) with outward unit normals (n, 3).

    cell: how far apart its vertices are at least; in reality up to half of that, as cells of the octree halve the
    extent. work_dir: for files on the way. Raises ReconstructionError where the result is not closed.
    """
    import pycolmap

    work_dir.mkdir(parents=True, exist_ok=True)
    given, made = work_dir / "points.ply", work_dir / "surface.ply"
    write_oriented_points(given, points, normals)
    extent = float(np.ptp(points, axis=0).max())
    options = pycolmap.PoissonMeshingOptions()
    options.depth = max(4, int(np.ceil(np.log2(extent / cell))))
    options.trim = 0.0  # trimming cuts off what lies far from points, and leaves holes
    options.color = False
    options.num_threads = threads
    pycolmap.poisson_meshing(given, made, options)
    found = read_ply(made)
    faces = np.empty((0, 3), np.int32) if found.faces is None else found.faces
    if len(faces):
        vertices, faces = largest_component(np.asarray(found.position, float), faces)
        if is_watertight(faces) and signed_volume(vertices, faces) > 0:
            return vertices, faces
    raise ReconstructionError(
        f"no closed surface goes through the {len(points)} points: they are too few, or too far from each other"
    )
