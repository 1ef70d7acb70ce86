"""How well the finished surface predicts every image, whole disks from their own poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.body.finished_surface import FinishedSurface
from photoclinometry.body.placement import PlacedViews
from photoclinometry.evaluate.metrics import psnr
from photoclinometry.model.scene import Image
from photoclinometry.photometry.shape_rendering import rendered_shape
from photoclinometry.pipeline.sparse_stages import PosedImages
from photoclinometry.pipeline.stage import Keyed, Stage, Tools, say_found


@dataclass(frozen=True, kw_only=True)
class RenderingQuality:
    """Images against renderings of the surface."""

    psnr_db: np.ndarray
    """(K,) over the body's disk, cast shadows included; NaN of views without a pose."""


@dataclass(frozen=True, kw_only=True)
class CompareRenderings(Stage[RenderingQuality]):
    """The peak signal-to-noise ratio of every view that has a pose."""

    name = "renderings"
    result = RenderingQuality
    posed: PosedImages
    placed: Keyed[PlacedViews]
    surface: FinishedSurface

    def make(self, tools: Tools) -> RenderingQuality:
        inputs, found = self.posed.inputs.value, np.full(len(self.posed.views), np.nan)
        surface = self.surface.shaded
        if surface is None:
            return RenderingQuality(psnr_db=found)
        views = self.posed.views.at_poses(self.placed.value.body_from_cam)
        which = np.flatnonzero(self.posed.sparse.value.registered | self.placed.value.placed)
        for done, k in enumerate(which):
            drawn = rendered_shape(surface, views.cameras[k], views.body_from_cam[k], views.sun[k])
            found[k] = disk_psnr(inputs.images[k], drawn, absolute=inputs.site.brightness == "iof")
            tools.progress("renderings", done + 1, len(which))
        say_found(f"PSNR {np.nanmedian(found):.1f} dB in the median, of whole disks")
        return RenderingQuality(psnr_db=found)


def disk_psnr(image: Image, rendering: np.ndarray, *, absolute: bool) -> float:
    """Of one image, over the pixels that show the body; its gain is free unless its brightness is absolute."""
    mask = image.valid & np.isfinite(rendering)
    if not mask.any():
        return float("nan")
    lit = mask & (rendering > 0)
    gain = 1.0 if absolute or not lit.any() else float(np.median(image.brightness[lit] / rendering[lit]))
    return psnr(image.brightness.astype(float), gain * rendering, mask, float(image.brightness[image.valid].max()))
