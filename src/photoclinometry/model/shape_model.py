"""A shape model: the surface of a body as a triangle mesh, with quantities at its vertices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.model.geometry import Similarity


@dataclass(frozen=True)
class ShapeModel:
    """A triangle mesh in a body-fixed frame, with normals, albedo and standard deviations per vertex.

    An unknown value at a vertex is NaN, or 0 in `views` and -1 in `tile`.
    """

    vertices: np.ndarray
    """(V, 3)."""
    faces: np.ndarray
    """(F, 3), counter-clockwise as seen from outside."""
    normals: np.ndarray | None = None
    """(V, 3) outward unit vectors from photometry; None: only the faces' are known."""
    albedo: np.ndarray | None = None
    """(V,)."""
    sigma: Mapping[str, np.ndarray] = field(default_factory=dict)
    """(V,) standard deviations: "height" along the normal [unit], "normal" [rad], "albedo" as a share of the albedo."""
    views: np.ndarray | None = None
    """(V,) int: number of images in which a vertex was measured; 0 where the surface is a smooth guess."""
    tile: np.ndarray | None = None
    """(V,) int: the tile that measured it."""
    unit: str | None = None
    """Of lengths: "m", or None where the frame is that of the images alone."""

    @property
    def from_images_alone(self) -> bool:
        """Whether the model was made of images alone: without pose priors neither the unit of length nor the poles are
        known."""
        return self.unit is None

    def moved(self, target_from_body: Similarity, unit: str | None = None) -> ShapeModel:
        """The same surface in another frame."""
        sigma = dict(self.sigma)
        if "height" in sigma:
            sigma["height"] = target_from_body.scale * sigma["height"]
        normals = None if self.normals is None else self.normals @ target_from_body.rotation.T
        return replace(self, vertices=target_from_body(self.vertices), normals=normals, sigma=sigma, unit=unit)

    def with_used_vertices(self) -> ShapeModel:
        """The same without vertices that belong to no face."""
        used, faces = np.unique(self.faces, return_inverse=True)
        return self.of_vertices(used, faces.reshape(-1, 3))

    def of_vertices(self, rows: np.ndarray, faces: np.ndarray) -> ShapeModel:
        """Vertices (n,) of the model in a given order, with their quantities, and faces (F, 3) of these."""

        def kept(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else np.asarray(values)[rows]

        return replace(
            self,
            vertices=np.asarray(self.vertices, float)[rows],
            faces=faces,
            normals=kept(self.normals),
            albedo=kept(self.albedo),
            sigma={name: values[rows] for name, values in self.sigma.items()},
            views=kept(self.views),
            tile=kept(self.tile),
        )
