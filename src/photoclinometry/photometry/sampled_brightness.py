"""Brightness at keypoints, sampled at the resolution of the map."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.image import Image
from photoclinometry.model.sampling import as_coarse, sample_with_gradient
from photoclinometry.model.scene import Views
from photoclinometry.model.threads import in_threads

SHADOW_SHARE = 0.15
"""Brightness below this share of the median counts as shadow [-]. Shadows hold scattered light and
camera offset, which no reflectance model explains. `evaluate` counts shadows by a share of its own, so that its figures
stay comparable."""


def sample_brightness(
    images: list[Image],
    view: np.ndarray,
    keypoint: np.ndarray,
    shadow_fraction: float = SHADOW_SHARE,
    spacing_px: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Brightness (N,) at keypoints (N, 2) [px] of views (N,), and (N,) bool: it is a measurement of lit ground.

    spacing_px: (K,) pixels of each image between landmarks. Images finer than the map are smoothed to its resolution;
    otherwise relief between landmarks would count as noise, and views of different resolutions would disagree.

    Not lit (False): outside of the image's pixel centres, any of the four pixels invalid, or brightness below
    `shadow_fraction` of the median over the view's own keypoints. Where a pixel is invalid the brightness is 0 and
    undefined.
    """
    brightness, _, lit = brightness_with_gradient(images, view, keypoint, shadow_fraction, spacing_px)
    return brightness, lit


def brightness_with_gradient(
    images: list[Image],
    view: np.ndarray,
    keypoint: np.ndarray,
    shadow_fraction: float = SHADOW_SHARE,
    spacing_px: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two results of `sample_brightness`, with the images' gradients (N, 2) float32 [brightness per px] between
    them; gradients are 0 where a pixel is invalid."""
    brightness, lit = np.zeros(len(view)), np.zeros(len(view), bool)
    gradient = np.zeros((len(view), 2), np.float32)

    def of_view(k: int) -> None:
        at = np.flatnonzero(view == k)
        image = images[k] if spacing_px is None else as_coarse(images[k], float(spacing_px[k]))
        value, slope, valid = sample_with_gradient(image, keypoint[at])
        if valid.any():
            brightness[at], gradient[at] = value, slope
            lit[at] = valid & (value > shadow_fraction * np.median(value[valid]))

    in_threads(of_view, np.unique(view))
    return brightness, gradient, lit


def landmark_spacing_px(views: Views, position: np.ndarray, reference: int) -> np.ndarray:
    """(K,) pixels of each view across one pixel of the reference view, whose resolution the landmarks (J, 3) have.

    The map's stride does not matter: a map of larger stride has a subset of the same landmarks.
    """
    gsd = np.array([views.gsd(k, position) for k in range(len(views))])
    return gsd[reference] / gsd
