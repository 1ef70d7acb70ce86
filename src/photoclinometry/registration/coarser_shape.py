"""Shape models with fewer facets, with the quantities at the vertices of the finer one."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.surface.decimate import decimate


def coarser(shape: ShapeModel, facets: int) -> ShapeModel:
    """A closed model with at most about `facets` facets; the model itself where it has no more."""
    if len(shape.faces) <= facets:
        return shape
    vertices, faces = decimate(shape.vertices, shape.faces, facets)
    return carried_to(shape, MeshSurface(shape.vertices, shape.faces, closed=True), vertices, faces)


def carried_to(shape: ShapeModel, surface: MeshSurface, vertices: np.ndarray, faces: np.ndarray) -> ShapeModel:
    """A mesh with a model's quantities at the nearest points of its surface: interpolated, or counts of the nearest
    vertex.

    surface: the model's mesh. A figure that is unknown at one of the three corners is unknown between them.
    """
    face, weight = surface.weights(vertices)
    corner = shape.faces[face]
    nearest = np.take_along_axis(corner, weight.argmax(1)[:, None], 1)[:, 0]

    def mean(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else np.einsum("nk,nk...->n...", weight, values[corner])

    normals = mean(shape.normals)
    return ShapeModel(
        vertices=vertices,
        faces=faces,
        normals=None if normals is None else unit(normals),
        albedo=mean(shape.albedo),
        sigma={name: np.einsum("nk,nk->n", weight, values[corner]) for name, values in shape.sigma.items()},
        views=None if shape.views is None else shape.views[nearest],
        tile=None if shape.tile is None else shape.tile[nearest],
        unit=shape.unit,
    )
