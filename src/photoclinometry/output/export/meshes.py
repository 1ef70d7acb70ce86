"""The landmarks as a mesh with albedo as texture: OBJ and glTF."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.meshes.gltf import write_glb
from photoclinometry.io.meshes.obj import write_obj
from photoclinometry.model.errors import InputError
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.sampling import filled_from_nearest
from photoclinometry.model.scene import Scene
from photoclinometry.output.export.frame import Framed


@dataclass(frozen=True, kw_only=True)
class Texture:
    """An albedo map as the texture of a mesh."""

    levels: np.ndarray
    """(h, w) uint8: 255 * sRGB(albedo / peak), the encoding that viewers expect."""
    peak: float
    """Albedo at level 255."""
    uv: np.ndarray
    """(J, 2) in [0, 1]: right and down from the picture's upper left corner."""


def albedo_texture(scene: Scene) -> Texture | None:
    """The albedo on the map's grid, gaps filled with the nearest value; None for a scene without albedo."""
    if scene.reflectance is None:
        return None
    albedo = scene.grid(scene.landmarks.albedo)
    albedo = filled_from_nearest(albedo, ~np.isnan(albedo))
    peak = float(albedo.max())
    if not peak > 0:
        raise InputError(f"scene {scene.name!r}: no albedo is positive; export the mesh as ply instead")
    row, col = scene.cells
    uv = (np.stack([col, row], -1) + 0.5) / albedo.shape[::-1]
    return Texture(levels=np.round(255.0 * srgb(albedo / peak)).astype(np.uint8), peak=peak, uv=uv)


def srgb(linear: np.ndarray) -> np.ndarray:
    """The sRGB encoding of light in [0, 1] (IEC 61966-2-1); values outside are clipped."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def write_meshes(folder: Path, framed: Framed, obj: bool, gltf: bool) -> dict[str, str]:
    """Writes mesh.obj with mesh.mtl and mesh.png, and mesh.glb; returns descriptions by file name.

    Raises InputError if the landmarks form no surface, and RunFolderError.
    """
    scene = framed.scene
    faces = landmark_faces(scene)
    if not len(faces):
        raise InputError(f"scene {scene.name!r}: its landmarks form no surface; export the points as ply or csv")
    texture, landmarks, files = albedo_texture(scene), scene.landmarks, {}
    picture = None if texture is None else (texture.levels, texture.uv)
    scale = "" if texture is None else f"; texture: albedo / {texture.peak:.6g}, sRGB"
    if obj:
        write_obj(folder / "mesh.obj", landmarks.position, faces, normal=landmarks.normal, texture=picture)
        files["mesh.obj"] = f"mesh{scale}"
        if texture is not None:
            files |= {"mesh.mtl": "material of mesh.obj", "mesh.png": f"texture of mesh.obj{scale}"}
    if gltf:
        albedo = None if texture is None else landmarks.albedo
        write_glb(
            folder / "mesh.glb",
            landmarks.position,
            faces,
            normal=landmarks.normal,
            albedo=albedo,
            texture=picture,
        )
        files["mesh.glb"] = f"mesh, turned so that the frame's z is glTF's y (up){scale}"
    return files
