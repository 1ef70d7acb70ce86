"""The model and its coarser levels as OBJ, PLY and glTF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.meshes.gltf import write_glb
from photoclinometry.io.meshes.obj import write_obj
from photoclinometry.io.meshes.shape_ply import write_shape_ply
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.export.shape.placed import PlacedShape

_PEAK_PERCENT = 99.5
"""Albedos above this percentile are drawn white: single bright spots must not darken all else."""


def write_shape_meshes(folder: Path, placed: PlacedShape, products: tuple[str, ...], options: Any) -> dict[str, str]:
    """Writes shape_49k.obj, .ply and .glb, and so on; returns descriptions by file name. Raises RunFolderError."""
    files: dict[str, str] = {}
    for level in placed.levels:
        shape, stem = level.shape, f"shape_{level.name}"
        about = f"{len(shape.faces):,} facets, in {shape.unit or 'the unit of the model'}"
        assert shape.normals is not None
        if "obj" in products:
            write_obj(folder / f"{stem}.obj", shape.vertices, shape.faces, normal=shape.normals)
            files[f"{stem}.obj"] = about
        if "ply" in products:
            write_shape_ply(folder / f"{stem}.ply", shape)
            files[f"{stem}.ply"] = f"{about}, with all that is known at the vertices"
        if "gltf" in products:
            gray = gray_of(shape)
            write_glb(
                folder / f"{stem}.glb",
                shape.vertices,
                shape.faces,
                normal=shape.normals,
                albedo=shape.albedo if shape.albedo is not None and np.isfinite(shape.albedo).all() else None,
                gray=gray,
            )
            files[f"{stem}.glb"] = f"{about}, turned so that the frame's z is glTF's y (up)"
            if gray is not None:
                files[f"{stem}.glb"] += "; colours: albedo"
    return files


def gray_of(shape: ShapeModel) -> np.ndarray | None:
    """(V,) albedo as linear light in [0, 1], the median where it is not known; None for models without."""
    if shape.albedo is None or not np.isfinite(shape.albedo).any():
        return None
    peak = float(np.nanpercentile(shape.albedo, _PEAK_PERCENT))
    if not peak > 0:
        return None
    known = np.isfinite(shape.albedo)
    return np.clip(np.where(known, shape.albedo, np.nanmedian(shape.albedo)) / peak, 0.0, 1.0)
