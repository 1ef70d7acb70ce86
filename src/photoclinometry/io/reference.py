"""A reference map to compare a scene with: PLY, GeoTIFF, or the scene of another run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from photoclinometry.io.meshes.ply import PlyMap, read_ply
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.scene import Scene


@dataclass(frozen=True)
class Reference:
    """A reference surface, and camera poses in its frame if the file has them."""

    surface: PlyMap
    names: tuple[str, ...] | None = None
    """Views with a pose in the surface's frame."""
    body_from_cam: Rigid | None = None
    """Their poses."""


def read_reference(path: Path | str) -> Reference:
    """A PLY file, a GeoTIFF of heights, a run folder, or its scene.h5. Raises InputError."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".ply":
        return Reference(read_ply(path))
    if suffix in (".tif", ".tiff"):
        from photoclinometry.io.rasters.geotiff import read_dtm_mesh

        return Reference(read_dtm_mesh(path))
    if suffix in (".h5", ".hdf5") or path.is_dir():
        from photoclinometry.io.run_files import SCENE_FILE
        from photoclinometry.io.scene_file import read_scene

        return scene_as_reference(read_scene(path / SCENE_FILE if path.is_dir() else path))
    raise InputError(
        f"{path}: is not a map to compare with; give a .ply, a GeoTIFF (.tif), a run folder or its scene.h5"
    )


def scene_as_reference(scene: Scene) -> Reference:
    """The surface of a scene, with the poses of its views."""
    landmarks = scene.landmarks
    albedo = None if scene.reflectance is None else landmarks.albedo
    surface = PlyMap(landmarks.position, landmarks.normal, albedo, landmark_faces(scene))
    return Reference(surface, scene.views.name, scene.views.body_from_cam)
