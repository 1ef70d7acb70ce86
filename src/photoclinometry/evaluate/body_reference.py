"""Figures of a body's surface against another shape model of the body, such as a published one."""

from __future__ import annotations

import numpy as np

from photoclinometry.evaluate.body import normals_of
from photoclinometry.evaluate.metrics import spread
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import METRES, Similarity, angle_between, so3_log
from photoclinometry.model.geometry import unit as unit_vectors
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.registration.alignment import refine_on_surface
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.surface.closed_mesh import is_watertight, signed_volume


def compare_shapes(found: ShapeModel, reference: ShapeModel, unit: str) -> dict[str, float]:
    """Figures of a surface in metres against a reference in lengths of `unit`, in the same body-fixed frame.

    The surface is first brought closest to the reference by a similarity; `shift_UNIT`, `rotation_deg` and
    `scale_percent` are those of that alignment. `distance_..._UNIT` from the vertices that images measured to the
    reference, `distance_back_..._UNIT` from the reference's vertices to the surface; `normal_..._deg` between the
    normals of measured vertices and those of the reference where it is nearest; `volume_percent`: how much the surface
    is too large, where both are closed. Raises InputError for an unknown unit, and where the surfaces do not overlap.
    """
    if unit not in METRES:
        raise InputError(f"the unit {unit!r} is not known; known: {', '.join(METRES)}")
    if found.unit != "m":
        raise InputError("the surface is in the frame of its images alone: a reference needs poses in the body's frame")
    found = found.moved(Similarity(1.0 / METRES[unit], np.eye(3), np.zeros(3)))
    measured = slice(None) if found.views is None else np.flatnonzero(found.views > 0)
    surface = MeshSurface(reference.vertices, reference.faces, closed=True)
    start = Similarity(1.0, np.eye(3), np.zeros(3))
    aligned = refine_on_surface(found.vertices[measured], normals_of(found)[measured], surface, start).similarity
    moved = found.moved(aligned)
    at = moved.vertices[measured]
    face, weight = surface.weights(at)
    normals = unit_vectors(np.einsum("nk,nkd->nd", weight, normals_of(reference)[reference.faces[face]]))
    off = np.degrees(angle_between(normals_of(moved)[measured], normals))
    own = MeshSurface(moved.vertices, moved.faces, closed=True)
    figures = spread(np.linalg.norm(surface(at)[0] - at, axis=1), "distance", unit)
    back = np.linalg.norm(own(reference.vertices)[0] - reference.vertices, axis=1)
    figures |= spread(back, "distance_back", unit) | spread(off, "normal", "deg")
    if is_watertight(moved.faces) and is_watertight(reference.faces):
        volumes = [signed_volume(each.vertices, each.faces) for each in (moved, reference)]
        figures["volume_percent"] = 100.0 * (volumes[0] / volumes[1] - 1.0)
    middle = found.vertices.mean(axis=0)
    figures[f"shift_{unit}"] = float(np.linalg.norm(aligned(middle) - middle))
    figures["rotation_deg"] = float(np.degrees(np.linalg.norm(so3_log(aligned.rotation))))
    figures["scale_percent"] = 100.0 * (aligned.scale - 1.0)
    return figures
