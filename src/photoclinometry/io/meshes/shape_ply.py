"""`body.ply`: a shape model with all quantities at its vertices.

Binary little-endian PLY. Vertices: x y z double; nx ny nz, albedo, sigma_height [unit of length], sigma_normal_deg and
sigma_albedo_percent float; views and tile int. Columns of what the model does not hold are left out. A comment has the
unit of length. Programs that know PLY show the mesh and ignore columns that they do not know.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from photoclinometry.io.meshes.ply import UNIT_COMMENT, read_ply, write_table_ply
from photoclinometry.io.meshes.ply_elements import Columns, read_comments, read_elements
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import METRES
from photoclinometry.model.shape_model import ShapeModel

_SIGMA = {
    "height": ("sigma_height", 1.0),
    "normal": ("sigma_normal_deg", 180.0 / math.pi),
    "albedo": ("sigma_albedo_percent", 100.0),
}
"""Column of a standard deviation, and its unit's share of the model's: radians and shares are degrees and per cent."""
_OWN_UNIT = "unknown"
"""In place of the unit where the frame comes from images alone."""


def write_shape_ply(path: Path | str, shape: ShapeModel) -> None:
    """The model as a PLY file: vertices in double, other numbers in single precision. Raises RunFolderError."""
    columns: dict[str, tuple[str, np.ndarray]] = {
        name: ("<f8", axis) for name, axis in zip("xyz", np.asarray(shape.vertices, float).T, strict=True)
    }
    if shape.normals is not None:
        columns |= {name: ("<f4", axis) for name, axis in zip(("nx", "ny", "nz"), shape.normals.T, strict=True)}
    if shape.albedo is not None:
        columns["albedo"] = ("<f4", shape.albedo)
    for name, values in shape.sigma.items():
        column, factor = _SIGMA[name]
        columns[column] = ("<f4", factor * np.asarray(values, float))
    for name, counts in (("views", shape.views), ("tile", shape.tile)):
        if counts is not None:
            columns[name] = ("<i4", counts)
    table = np.empty(len(shape.vertices), [(name, kind) for name, (kind, _) in columns.items()])
    for name, (_, values) in columns.items():
        table[name] = values
    write_table_ply(path, table, shape.faces, shape.unit or _OWN_UNIT)


def read_shape_ply(path: Path | str) -> ShapeModel:
    """The model that `write_shape_ply` wrote, or the part of one that a PLY mesh of another program holds.

    A file whose comment names no unit is of an unknown one. Raises InputError for files that are damaged or no mesh.
    """
    path = Path(path)
    mesh = read_ply(path)
    if mesh.faces is None or len(mesh.faces) == 0:
        raise InputError(f"{path}: holds points without faces; a shape model is a mesh")
    vertex = read_elements(path)["vertex"]
    stated = {name: _numbers(path, vertex, column) for name, (column, _) in _SIGMA.items()}
    sigma = {name: values / _SIGMA[name][1] for name, values in stated.items() if values is not None}
    if any((values < 0).any() for values in sigma.values()):
        raise InputError(f"{path}: a standard deviation is negative; export the model again")
    return ShapeModel(
        vertices=mesh.position,
        faces=mesh.faces.astype(np.int32),
        normals=mesh.normal,
        albedo=mesh.albedo,
        sigma=sigma,
        views=_counts(path, vertex, "views"),
        tile=_counts(path, vertex, "tile"),
        unit=_unit(path),
    )


def _numbers(path: Path, vertex: Columns, name: str) -> np.ndarray | None:
    values = vertex.get(name)
    if isinstance(values, tuple):
        raise InputError(f"{path}: vertex property {name} is a list, expected one number per vertex")
    with np.errstate(invalid="ignore"):  # a NaN of single precision may be a signalling one
        return None if values is None else values.astype(np.float64)


def _counts(path: Path, vertex: Columns, name: str) -> np.ndarray | None:
    values = _numbers(path, vertex, name)
    if values is None:
        return None
    if not (np.isfinite(values) & (np.abs(values) <= np.iinfo(np.int32).max)).all():
        raise InputError(f"{path}: vertex property {name} holds numbers that are no counts; export the model again")
    return values.astype(np.int32)


def _unit(path: Path) -> str | None:
    stated = [line.removeprefix(UNIT_COMMENT).strip() for line in read_comments(path) if line.startswith(UNIT_COMMENT)]
    return stated[0] if stated and stated[0] in METRES else None
