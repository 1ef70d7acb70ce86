"""All that is known at points of the surface, each given by its facet and the weights of its corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.output.export.shape.placed import PlacedShape
from photoclinometry.surface.surface_gravity import GroundGravity


@dataclass(frozen=True)
class SurfacePoints:
    """Points (n,) of the surface."""

    placed: PlacedShape
    face: np.ndarray
    """(n,)."""
    weight: np.ndarray
    """(n, 3)."""

    @property
    def position(self) -> np.ndarray:
        """(n, 3)."""
        return self.mean(self.placed.shape.vertices)

    @property
    def normal(self) -> np.ndarray:
        """(n, 3) outward unit vectors, the model's."""
        assert self.placed.shape.normals is not None
        return unit(self.mean(self.placed.shape.normals))

    @property
    def tilt(self) -> np.ndarray:
        """(n,) angle between the normal and the direction from the origin [rad]."""
        return angle_between(self.normal, self.position)

    @property
    def gravity(self) -> GroundGravity | None:
        """None without a density."""
        at_vertices = self.placed.gravity
        if at_vertices is None:
            return None
        return GroundGravity(
            potential=self.mean(at_vertices.potential),
            acceleration=self.mean(at_vertices.acceleration),
            reference=at_vertices.reference,
        )

    @property
    def views(self) -> np.ndarray | None:
        """(n,) of the nearest corner."""
        counts = self.placed.shape.views
        if counts is None:
            return None
        corner = self.placed.shape.faces[self.face]
        return counts[np.take_along_axis(corner, self.weight.argmax(1)[:, None], 1)[:, 0]]

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Values (V, ...) of vertices, interpolated."""
        return np.einsum("nk,nk...->n...", self.weight, values[self.placed.shape.faces[self.face]])


def facet_middles(placed: PlacedShape) -> SurfacePoints:
    """The middles of all facets."""
    count = len(placed.shape.faces)
    return SurfacePoints(placed, np.arange(count), np.full((count, 3), 1.0 / 3.0))
