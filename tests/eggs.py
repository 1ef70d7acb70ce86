"""Eggs: smooth closed bodies without symmetry, with all that a shape model can hold."""

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.surface.closed_mesh import icosahedron, refine

RADIUS = 250.0


def egg_model(spacing=0.1, growth=(0.25, 0.15, 0.1)):
    """An egg of 4,640 facets [m]; without growth a ball."""
    direction, faces = refine(*icosahedron(), spacing, unit)
    a, b, c = growth
    x, y, z = direction.T
    return ShapeModel(
        vertices=RADIUS * (1.0 + a * x + b * x * y + c * z * z)[:, None] * direction,
        faces=faces,
        normals=None,
        albedo=0.04 + 0.01 * x,
        sigma={"height": 0.1 + 0.05 * y, "normal": np.full(len(x), 0.02), "albedo": np.full(len(x), 0.03)},
        views=(10 * (z + 1)).astype(np.int32),
        tile=np.zeros(len(x), np.int32),
        unit="m",
    )
