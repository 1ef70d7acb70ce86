"""Surfaces from files: a mesh (PLY, OBJ) or heights on a map (GeoTIFF), recognised by content."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.io.meshes.ply import read_ply
from photoclinometry.io.rasters.geotiff import Dtm, read_dtm
from photoclinometry.io.reading import read_bytes
from photoclinometry.model.errors import InputError

_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
"""First bytes of TIFF and BigTIFF files, little- and big-endian."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in the file's own frame and unit."""

    vertices: np.ndarray
    """(V, 3) float64."""
    faces: np.ndarray
    """(F, 3) int64, counter-clockwise as seen from outside."""
    albedo: np.ndarray | None = None
    """(V,) normal albedo; None if the file has none."""


def read_ground(path: Path | str) -> Mesh | Dtm:
    """The surface in a PLY, GeoTIFF or OBJ file. Raises InputError."""
    path = Path(path)
    head = read_bytes(path, "surface", limit=4)
    if head in _TIFF:
        return read_dtm(path)
    if not head.startswith(b"ply"):
        return Mesh(*read_obj(path))
    ply = read_ply(path)
    if ply.faces is None or len(ply.faces) == 0:
        raise InputError(f"{path}: holds points without faces; export it as a mesh")
    return Mesh(ply.position, ply.faces, ply.albedo)
