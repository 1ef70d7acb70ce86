"""The merged surface with the reflectance of its tiles: all that a rendering of the body needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from photoclinometry.body.merge import MergedSurface
from photoclinometry.body.tile_map import TileMap
from photoclinometry.model.reflectance import Reflectance, mean_model
from photoclinometry.photometry.shape_rendering import ShadedSurface
from photoclinometry.pipeline.folder.stage import Keyed
from photoclinometry.surface.mesh_rays import MeshRays


@dataclass(frozen=True, kw_only=True)
class FinishedSurface:
    """The surface that is rendered, and its parts."""

    merged: Keyed[MergedSurface]
    tiles: tuple[Keyed[TileMap], ...]

    @cached_property
    def shaded(self) -> ShadedSurface | None:
        """Ready to be rendered, with the median albedo where none is known; None of geometry alone."""
        reflectance = reflectance_of_tiles([tile.value for tile in self.tiles])
        if reflectance is None:
            return None
        surface = self.merged.value
        return ShadedSurface(
            rays=MeshRays(surface.vertices, surface.faces, surface.gsd),
            normals=surface.normals,
            albedo=np.where(np.isfinite(surface.albedo), surface.albedo, np.nanmedian(surface.albedo)),
            reflectance=reflectance,
        )


def reflectance_of_tiles(tiles: Sequence[TileMap]) -> Reflectance | None:
    """The mean model of the tiles that are to be trusted, by their landmarks; None of geometry alone."""
    return mean_model([(tile.reflectance, len(tile.landmarks), not tile.distrust) for tile in tiles])
