"""Restoration of the finest relief of a map, which pixels, point-spread function and the estimate average away.

A pixel shows the mean of its ground, through a point-spread function, and the estimate assumes that the slope between
two landmarks is the mean of those at both. Each of these reduces the amplitude of short waves of relief more than that
of long ones, by a known share. This is undone where the map is known all around (Van Cittert 1931,
doi:10.1007/BF01391351). Normals and albedos remain means over a pixel, as they are meant to be.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photoclinometry.model.sampling import gaussian, masked_filter, smoothing_px
from photoclinometry.model.scene import Scene
from photoclinometry.surface.relief import reference_depth

PIXEL_PX2 = 1.0 / 12.0
"""Variance of a pixel's own extent along each side [px^2]."""

DIFFERENCES = 1.0 / 8.0
"""Variance of the Gaussian that attenuates waves as slopes between four neighbours do, taken as the mean of those at
both ends (trapezoidal rule) [landmarks^2]: 1/6 along rows and columns and 1/12 along diagonals, to the second order of
landmarks over wavelength."""

ITERATIONS = 3
"""Iterations of the restoration. Three restore a wave of the remaining amplitude b to 1 - (1 - b)^4: 0.4 becomes 0.87.
Noise grows fourfold at most, where nothing of a wave is left."""

WHOLE = 0.999
"""Part of the Gaussian's weight that must fall on the map: at edges, slopes cannot be separated from relief."""

NEARBY = 2.0
"""Standard deviation of the Gaussian over which the size of the restored relief is averaged [landmarks]."""


def blur(stride: int, psf_sigma_px: float) -> float:
    """Standard deviation of the Gaussian by which a map averages the ground [landmarks].

    stride: pixels a landmark; psf_sigma_px: of the point-spread function [px]. Images of coarser maps are smoothed to
    the grid before (`smoothing_px`).
    """
    of_images = PIXEL_PX2 + psf_sigma_px**2 + smoothing_px(stride) ** 2
    return float(np.sqrt(DIFFERENCES + of_images / stride**2))


def with_fine_relief(scene: Scene, psf_sigma_px: float) -> Scene:
    """The scene with its finest relief restored, each landmark on its ray of the reference view.

    Where positions have uncertainties, the local mean square of the restored relief is added to them, along the ray:
    the width of a point-spread function is hardly ever known well, and noise was restored with the rest. Where nothing
    could be restored it is added twice, since as much is missing there.

    psf_sigma_px: standard deviation of the reference view's point-spread function [px].
    """
    view = scene.views.body_from_cam[scene.reference]
    depth = scene.grid(reference_depth(scene))
    added = _restored(depth, blur(scene.region.stride, psf_sigma_px)) - depth
    share = (np.nan_to_num(added) / depth)[scene.cells]
    ray = scene.landmarks.position - view.translation
    found = replace(scene, landmarks=replace(scene.landmarks, position=scene.landmarks.position + share[:, None] * ray))
    if "position" not in scene.uncertainty or not np.isfinite(added).any():
        return found
    square = (added / depth) ** 2
    near, _ = masked_filter(square, gaussian(NEARBY))
    near = np.where(np.isfinite(near), near, np.nanmean(square))
    near = np.where(np.isfinite(added), near, 2.0 * near)[scene.cells]
    along = near[:, None, None] * ray[:, :, None] * ray[:, None, :]
    return replace(found, uncertainty={**scene.uncertainty, "position": scene.uncertainty["position"] + along})


def _restored(depth: np.ndarray, width: float) -> np.ndarray:
    """Depths (h, w) before a Gaussian of standard deviation `width` [cells]; NaN where not all around is known."""
    found, whole = depth, np.isfinite(depth)
    for _ in range(ITERATIONS):
        again, share = masked_filter(found, gaussian(width))
        whole &= share > WHOLE
        found = np.where(whole, found + (depth - again), depth)
    return np.where(whole, found, np.nan)
