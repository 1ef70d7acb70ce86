"""PLY: the landmark map as points or as a mesh, and surfaces from other programs.

Written as binary little-endian: x y z double, nx ny nz albedo float, then the standard deviations that are known, as
float: sigma_x sigma_y sigma_z of "position"; sigma_NAME of one number per landmark; sigma_NAME_deg of a direction, of
the angle between it and the true one; sigma_NAME_x _y _z of a vector (of a covariance, the roots of its diagonal).
Read: ascii and both binary forms. http://paulbourke.net/dataformats/ply/
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.meshes.ply_elements import Columns, read_elements
from photoclinometry.model.errors import InputError
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.scene import Scene
from photoclinometry.model.sigma import sigma_of_length

UNIT_COMMENT = "unit of length:"
"""The comment that the unit follows."""
_WRITTEN = {"<f8": "double", "<f4": "float", "<i4": "int"}
"""PLY's names of the types that are written."""


@dataclass(frozen=True)
class PlyMap:
    """The points of a PLY file with their normals, albedos and faces, as far as it has them."""

    position: np.ndarray
    """(n, 3) float64."""
    normal: np.ndarray | None
    """(n, 3) float64, as in the file."""
    albedo: np.ndarray | None
    """(n,) float64."""
    faces: np.ndarray | None
    """(m, 3) int64 rows of `position`; larger polygons are cut into triangles."""


def write_ply(path: Path | str, scene: Scene, mesh: bool = False, unit: str | None = None) -> None:
    """The scene's landmarks, in B; with `mesh` also the triangles of `landmark_faces`. Raises RunFolderError.

    unit: of lengths; by default the scene's.
    """
    vertices = _vertices(scene)
    write_table_ply(path, vertices, landmark_faces(scene) if mesh else None, unit or scene.unit or "as the scene")


def write_mesh_ply(path: Path | str, vertices: np.ndarray, faces: np.ndarray, albedo: np.ndarray) -> None:
    """A mesh of vertices (V, 3) [m], triangles (F, 3) and albedo (V,), in single precision. Raises RunFolderError."""
    columns = np.empty(len(vertices), [(name, "<f4") for name in ("x", "y", "z", "albedo")])
    columns["x"], columns["y"], columns["z"] = vertices.T
    columns["albedo"] = albedo
    write_table_ply(path, columns, faces, "m")


def write_oriented_points(path: Path | str, points: np.ndarray, normals: np.ndarray) -> None:
    """Points (n, 3) with normals (n, 3), in single precision, as meshing programs want them. Raises RunFolderError."""
    columns = np.empty(len(points), [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")])
    columns["x"], columns["y"], columns["z"] = points.T
    columns["nx"], columns["ny"], columns["nz"] = normals.T
    write_table_ply(path, columns, None, "as given")


def write_table_ply(path: Path | str, vertices: np.ndarray, triangles: np.ndarray | None, unit: str) -> None:
    """A structured array of vertices, of the types in _WRITTEN, and triangles (F, 3) if there are any.

    unit: of lengths, for the comment. Raises RunFolderError.
    """
    header = ["ply", "format binary_little_endian 1.0", f"comment {UNIT_COMMENT} {unit}"]
    header.append(f"element vertex {len(vertices)}")
    for name in vertices.dtype.names or ():
        header.append(f"property {_WRITTEN[vertices.dtype[name].str]} {name}")
    faces = np.empty(0, [("count", "u1"), ("index", "<i4", 3)])
    if triangles is not None:
        faces = np.empty(len(triangles), faces.dtype)
        faces["count"], faces["index"] = 3, triangles
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    header.append("end_header\n")
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        stream.write("\n".join(header).encode("ascii"))
        stream.write(vertices.tobytes())
        stream.write(faces.tobytes())


def read_ply(path: Path | str) -> PlyMap:
    """The points, normals, albedos and faces of a PLY file. Raises InputError."""
    path = Path(path)
    elements = read_elements(path)
    vertex = elements.get("vertex", {})
    position = _columns(path, vertex, ("x", "y", "z"))
    if position is None:
        raise InputError(f"{path}: the PLY has no vertices with x, y, z; export points or a mesh")
    if not np.isfinite(position).all():
        raise InputError(f"{path}: some vertices are not finite; remove them")
    albedo = _columns(path, vertex, ("albedo",))
    face = elements.get("face", {})
    polygons = face.get("vertex_indices", face.get("vertex_index"))
    faces = None
    if isinstance(polygons, tuple):
        faces = fan_triangles(*polygons)
        if len(faces) and (faces.min() < 0 or faces.max() >= len(position)):
            raise InputError(f"{path}: faces refer to vertices that do not exist; export it again")
    normal = _columns(path, vertex, ("nx", "ny", "nz"))
    return PlyMap(position, normal, None if albedo is None else albedo[:, 0], faces)


def _vertices(scene: Scene) -> np.ndarray:
    """(J,) structured array, one field per PLY property."""
    landmarks = scene.landmarks
    columns = dict(zip("xyz", landmarks.position.T, strict=True))
    columns |= dict(zip(("nx", "ny", "nz"), landmarks.normal.T, strict=True))
    columns["albedo"] = landmarks.albedo
    for name, sigma in scene.uncertainty.items():
        if np.shape(sigma) == (len(landmarks), 3, 3):
            sigma = np.sqrt(np.diagonal(sigma, axis1=1, axis2=2))
        if np.shape(sigma) == (len(landmarks),):
            columns[f"sigma_{name}"] = sigma
        elif np.shape(sigma) == (len(landmarks), 2, 2):
            columns[f"sigma_{name}_deg"] = np.degrees(sigma_of_length(sigma, 2))
        elif np.shape(sigma) == (len(landmarks), 3):
            stem = "sigma_" if name == "position" else f"sigma_{name}_"
            columns |= {stem + axis: sigma[:, i] for i, axis in enumerate("xyz")}
    table = np.empty(len(landmarks), [(name, "<f8" if name in "xyz" else "<f4") for name in columns])
    for name, column in columns.items():
        table[name] = column
    return table


def _columns(path: Path, vertex: Columns, names: tuple[str, ...]) -> np.ndarray | None:
    """(n, len(names)) float64, or None if the file lacks one of them."""
    if not all(name in vertex for name in names):
        return None
    columns = [vertex[name] for name in names]
    if any(isinstance(column, tuple) for column in columns):
        raise InputError(f"{path}: vertex property {names[0]} is a list, expected one number per vertex")
    with np.errstate(invalid="ignore"):  # a NaN of single precision may be a signalling one
        return np.stack(columns, -1).astype(np.float64)


def fan_triangles(lengths: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(m, 3) int64: polygons cut into fans about their first corner; those of fewer than 3 corners are omitted."""
    with np.errstate(invalid="ignore"):
        corners = corners.astype(np.int64)
    start = np.cumsum(lengths) - lengths
    parts = []
    for size in np.unique(lengths[lengths >= 3]):
        polygon = corners[start[lengths == size][:, None] + np.arange(size)]
        fan = [polygon[:, [0, i, i + 1]] for i in range(1, size - 1)]
        parts.append(np.stack(fan, 1).reshape(-1, 3))
    return np.concatenate(parts) if parts else np.empty((0, 3), np.int64)
