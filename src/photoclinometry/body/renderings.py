"""Comparison of the finished surface with every image, as whole disks from their own poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.body.finished_surface import FinishedSurface
from photoclinometry.body.placement import PlacedViews
from photoclinometry.evaluate.metrics import psnr
from photoclinometry.model.camera import Camera
from photoclinometry.model.image import Image
from photoclinometry.model.tiny import TINY
from photoclinometry.photometry.shape_rendering import rendered_shape, through_optics
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.sparse_stages import PosedImages

OPTICS_PX = 0.25 * np.arange(9)
"""(S,) widths of a camera's point-spread function that are tried, standard deviations of a Gaussian [px]. Cameras are
sharp to a pixel or two; half a step costs 0.1 dB at most."""


@dataclass(frozen=True, kw_only=True)
class RenderingQuality:
    """Images against renderings of the surface, through the optics of each camera."""

    psnr_db: np.ndarray
    """(K,) over the body's disk, cast shadows included; NaN of views without a pose."""
    optics_px: np.ndarray
    """(K,) width of the point-spread function with which the images of the view's camera are predicted best [px]."""
    gain: np.ndarray
    """(K,) brightness of an image over that of its rendering: 1 where brightness is absolute; NaN as `psnr_db`."""
    explained: np.ndarray
    """(K,) share of the variation of brightness over the disk that the rendering explains (`disk_explained`); NaN as
    `psnr_db`."""


@dataclass(frozen=True, kw_only=True)
class CompareRenderings(Stage[RenderingQuality]):
    """The peak signal-to-noise ratio of every view that has a pose."""

    name = "renderings"
    result = RenderingQuality
    posed: PosedImages
    placed: Keyed[PlacedViews]
    surface: FinishedSurface

    def make(self, tools: Tools) -> RenderingQuality:
        inputs, views = self.posed.inputs.value, self.posed.views.at_poses(self.placed.value.body_from_cam)
        found = np.full((len(views), len(OPTICS_PX)), np.nan)
        gain, explained = (np.full(len(views), np.nan) for _ in range(2))
        surface = self.surface.shaded
        which = np.flatnonzero(self.posed.sparse.value.registered | self.placed.value.placed)
        if surface is None:
            return RenderingQuality(psnr_db=found[:, 0], optics_px=found[:, 0], gain=gain, explained=explained)
        absolute = inputs.site.brightness == "iof"
        for done, k in enumerate(which):
            drawn = rendered_shape(surface, views.cameras[k], views.body_from_cam[k], views.sun[k])
            found[k] = psnr_by_optics(inputs.images[k], drawn, absolute=absolute)
            gain[k] = 1.0 if absolute else median_gain(inputs.images[k], drawn)
            explained[k] = disk_explained(inputs.images[k], gain[k] * drawn)
            tools.progress("renderings", done + 1, len(which))
        best = best_optics(views.cameras, found)
        quality = found[np.arange(len(found)), best]
        say_found(f"PSNR {np.nanmedian(quality):.1f} dB in the median, of whole disks")
        return RenderingQuality(psnr_db=quality, optics_px=OPTICS_PX[best], gain=gain, explained=explained)


def psnr_by_optics(image: Image, rendering: np.ndarray, *, absolute: bool) -> np.ndarray:
    """(S,) of one image, with its rendering through each of OPTICS_PX."""
    return np.array([disk_psnr(image, through_optics(rendering, px), absolute=absolute) for px in OPTICS_PX])


def best_optics(cameras: Sequence[Camera], quality: np.ndarray) -> np.ndarray:
    """(K,) index into OPTICS_PX: for all views of one camera, the width with the largest median gain of quality (K, S)
    [dB]. Views with wrong poses prefer any blur."""
    best = np.zeros(len(cameras), int)
    gain, known = quality - quality[:, :1], np.isfinite(quality).all(1)
    for camera in set(cameras):
        of_camera = np.array([each == camera for each in cameras])
        if np.any(of_camera & known):
            best[of_camera] = np.argmax(np.median(gain[of_camera & known], axis=0))
    return best


def disk_psnr(image: Image, rendering: np.ndarray, *, absolute: bool) -> float:
    """Of one image, over the pixels that show the body; its gain is free unless its brightness is absolute."""
    mask = image.valid & np.isfinite(rendering)
    if not mask.any():
        return float("nan")
    gain = 1.0 if absolute else median_gain(image, rendering)
    return psnr(image.brightness.astype(float), gain * rendering, mask, float(image.brightness[image.valid].max()))


def disk_explained(image: Image, rendering: np.ndarray) -> float:
    """The share of the variation of brightness, over the ground that a rendering shows lit, that the rendering
    explains.

    It is 1 - a / b by medians of |image - rendering| (a) and |image - its median| (b). NaN where no ground is lit.
    """
    lit = _lit(image, rendering)
    if not lit.any():
        return float("nan")
    measured = image.brightness[lit].astype(float)
    left = np.median(np.abs(measured - rendering[lit]))
    return float(1.0 - left / max(np.median(np.abs(measured - np.median(measured))), TINY))


def median_gain(image: Image, rendering: np.ndarray) -> float:
    """Brightness of an image over that of its rendering, the median over lit ground; 1 where none is lit."""
    lit = _lit(image, rendering)
    return float(np.median(image.brightness[lit] / rendering[lit])) if lit.any() else 1.0


def _lit(image: Image, rendering: np.ndarray) -> np.ndarray:
    """(h, w) bool: valid pixels of ground that the rendering shows lit."""
    return image.valid & np.isfinite(rendering) & (rendering > 0)
