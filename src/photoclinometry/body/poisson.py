"""A closed surface through oriented points: screened Poisson reconstruction, as COLMAP has it.

Kazhdan and Hoppe 2013, "Screened Poisson surface reconstruction", doi:10.1145/2487228.2487237. Where there are no
points the surface closes smoothly.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.meshes.ply import read_ply, write_oriented_points
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.sfm.database import check_disk
from photoclinometry.sfm.mapping import quiet_pycolmap
from photoclinometry.surface.closed_mesh import is_watertight, largest_component, signed_volume

SURFACE = "surface.ply"
"""COLMAP's file of the surface."""
SEED = 0
"""Any: COLMAP's meshing draws no random numbers."""


def closed_surface(
    points: np.ndarray, normals: np.ndarray, cell: float, work_dir: Path, threads: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and faces (F, 3) of one closed surface near points (n, 3) with outward unit normals (n, 3).

    cell: nominal least distance between vertices; actually down to half of that, as cells of the octree halve the
    extent. work_dir: for files on the way. Raises ReconstructionError where the result is not closed, and OutputError
    where work_dir cannot be written.
    """
    given, made = work_dir / "points.ply", work_dir / SURFACE
    write_oriented_points(given, points, normals)
    made.unlink(missing_ok=True)  # an earlier one is not to be read where COLMAP fails
    extent = float(np.ptp(points, axis=0).max())
    depth = max(4, int(np.ceil(np.log2(extent / cell))))
    none = f"no closed surface goes through the {len(points)} points: they are too few, or too far from each other"
    with quiet_pycolmap(SEED):
        _mesh(given, made, depth, threads)
    try:
        found = read_ply(made)
    except InputError as error:  # COLMAP does not raise where it fails
        check_disk(work_dir, SURFACE)
        raise ReconstructionError(none) from error
    faces = np.empty((0, 3), np.int32) if found.faces is None else found.faces
    if len(faces):
        vertices, faces = largest_component(np.asarray(found.position, float), faces)
        if is_watertight(faces) and signed_volume(vertices, faces) > 0:
            return vertices, faces
    raise ReconstructionError(none)


def _mesh(given: Path, made: Path, depth: int, threads: int) -> None:
    """COLMAP's surface `made` through the points of the file `given`, by an octree of that depth."""
    import pycolmap

    options = pycolmap.PoissonMeshingOptions()
    options.depth = depth
    options.trim = 0.0  # trimming cuts off what lies far from points, and leaves holes
    options.color = False
    options.num_threads = threads
    pycolmap.poisson_meshing(given, made, options)
