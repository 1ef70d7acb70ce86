"""Coarser levels of a shape model, with what is known at its vertices."""

from __future__ import annotations

from dataclasses import dataclass

from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.registration.coarser_shape import carried_to
from photoclinometry.surface.decimate import decimate

LEVELS = (49_152, 196_608, 786_432, 3_145_728)
"""Facets, 12 Q^2 for Q = 64 to 512: those that archives of small bodies have."""
_ABOUT = 0.9
"""A level of more than this share of the model's facets would be the model itself."""


@dataclass(frozen=True)
class Level:
    """A model at one number of facets."""

    name: str
    """Facets in thousands: "49k"."""
    shape: ShapeModel


def levels_of(shape: ShapeModel) -> list[Level]:
    """The levels that are coarser than a closed model, from coarse to fine, and the model itself, last."""
    vertices, faces = shape.vertices, shape.faces
    surface = MeshSurface(vertices, faces, closed=True)
    found = [Level(thousands(len(faces)), shape)]
    for count in sorted(LEVELS, reverse=True):
        if count < _ABOUT * len(shape.faces):
            vertices, faces = decimate(vertices, faces, count)
            found.append(Level(thousands(count), carried_to(shape, surface, vertices, faces)))
    return found[::-1]


def thousands(count: int) -> str:
    """49152 as "49k"; fewer than a thousand as they are."""
    return f"{count // 1000}k" if count >= 1000 else str(count)
