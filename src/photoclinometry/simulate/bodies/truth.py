"""The truth of a simulated body: its file, `truth.h5`, and which views see and light a place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.hdf5 import new_hdf5
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.simulate.bodies.surface import BodySurface
from photoclinometry.simulate.truth import SiteFacts
from photoclinometry.simulate.truth_file import BODY_FORMAT, read_facts, read_file, write_array, write_facts
from photoclinometry.surface.closed_mesh import is_watertight, signed_volume
from photoclinometry.surface.mesh_rays import MeshRays, sight_of_views

VERSION = 1


@dataclass(frozen=True, kw_only=True)
class BodyTruth(SiteFacts):
    """A simulated body without its noise. B is body-fixed [m], z along the axis of rotation."""

    surface: BodySurface
    gsd: float
    """Ground sample distance of the close-ups, the finest images [m]."""


def write_body_truth(path: Path | str, truth: BodyTruth) -> None:
    """The truth as one HDF5 file, the mesh in single precision, compressed. Raises RunFolderError."""
    surface = truth.surface
    with new_hdf5(path) as file:
        write_facts(file, truth, BODY_FORMAT, VERSION)
        file.attrs["gsd_m"] = truth.gsd
        group = file.create_group("mesh")
        group.attrs["spacing_m"] = surface.spacing
        write_array(group, "vertices", surface.vertices.astype(np.float32), "m, in B")
        write_array(group, "faces", surface.faces, "vertices, counter-clockwise as seen from outside")
        write_array(group, "normals", surface.normals.astype(np.float32), "outward unit vectors of the vertices, -")
        write_array(
            group,
            "albedo",
            surface.albedo.astype(np.float32),
            "normal albedo, I/F at zero incidence, emission and phase",
        )


def read_body_truth(path: Path | str) -> BodyTruth:
    """The truth of a body in the file. Raises InputError if it is missing, damaged, none or of another version."""
    return read_file(path, BODY_FORMAT, VERSION, _truth)


def _truth(file: Any) -> BodyTruth:
    facts, group = read_facts(file), file["mesh"]
    surface = BodySurface(
        group["vertices"][()].astype(np.float64),
        group["faces"][()],
        group["normals"][()].astype(np.float64),
        group["albedo"][()].astype(np.float64),
        float(group.attrs["spacing_m"]),
    )
    gsd = float(file.attrs["gsd_m"])
    if not (0 < gsd < np.inf and 0 < surface.spacing < np.inf):
        raise InputError(f"ground sample distance {gsd} m and spacing {surface.spacing} m are no lengths")
    _check_mesh(surface)
    return BodyTruth(surface=surface, gsd=gsd, **facts)


def _check_mesh(surface: BodySurface) -> None:
    """Raises InputError for arrays that do not agree or are no closed mesh."""
    count = len(surface.vertices)
    shapes = [np.shape(a) for a in (surface.vertices, surface.normals, surface.albedo)]
    faces = surface.faces
    if shapes != [(count, 3), (count, 3), (count,)] or faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise InputError(f"the mesh's arrays do not agree: {shapes} and faces {faces.shape}")
    if not all(np.isfinite(a).all() for a in (surface.vertices, surface.normals, surface.albedo)):
        raise InputError("the mesh has numbers that are not finite")
    if faces.min() < 0 or faces.max() >= count or not is_watertight(faces):
        raise InputError("the mesh is not closed")
    if signed_volume(surface.vertices, faces) <= 0:
        raise InputError("the mesh looks inwards")


def views_of_triangles(
    truth: BodyTruth, triangles: np.ndarray, max_emission_deg: float, rays: MeshRays | None = None
) -> np.ndarray:
    """(n,) how many views see the middles of triangles (n,), lit, at emission angles up to `max_emission_deg`.

    The angles are those of the interpolated normals. rays: at `truth.surface`, if they were made already.
    """
    surface = truth.surface
    rays = rays or MeshRays(surface.vertices, surface.faces, surface.spacing)
    corner = surface.faces[triangles]
    points, normals = surface.vertices[corner].mean(1), unit(surface.normals[corner].sum(1))
    count = np.zeros(len(triangles), np.int64)
    for view in sight_of_views(rays, truth.views, triangles, points, normals):
        count += view.seen & view.lit & (view.emission < np.radians(max_emission_deg))
    return count
