"""Tests of a single exposure: which of its pixels are dark sky, and whether it holds any signal."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.image import Image
from photoclinometry.model.robust import SIGMA_PER_MEDIAN

_FEWEST_PIXELS = 100
"""Images with fewer valid pixels are too small to distinguish sky from ground."""
_DARK_PERCENTILE, _BRIGHT_PERCENTILE = 0.1, 99.0
"""Their distance is the contrast of an image; single hot and dead pixels lie beyond them."""
_EDGE_PX = 2
"""Width of the image's edge, on which the sky is looked for [px]."""
_DARK_SHARE = 0.1
"""Pixels of the edge are dark below this share of the contrast; the sky is no brighter than that."""
_FEWEST_SAMPLES = 20
"""Fewer pixels give no median or standard deviation worth using."""
_SKY_SIGMAS = 5.0
"""The sky reaches this many standard deviations of its noise above its level ..."""
_LEAST_TOLERANCE = 0.01
"""... but at least this share of the contrast, where the detector rounds its noise away."""
_LEAST_AREA = 0.005
"""Least share of the image that the sky covers; smaller dark pieces on the edge are shadows."""
_RIM_SHARE = 0.3
"""A gentle valley has about as many pixels on its rim as inside, the sky's limb fewer than this share."""
_LEAST_RIM_PX, _RIM_WIDTH = 5.0, 0.5
"""Width of the rim around a piece: at least this [px], and this share of the root of its area."""
_CORE_PX = 5
"""Kernel that removes the edge of a piece, which is blurred by the optics [px]."""
_PLATEAU_SPREAD = 1.5
"""Spread over the noise of neighbouring pixels: 1 for white noise, several for texture."""
_PLATEAU_CONTRAST = 0.005
"""A spread below this share of the contrast is flat whatever its texture (compression, rounding)."""
_CLIP_PERCENT = (0.1, 99.9)
"""Percentiles to which brightness is clipped, so that hot and dead pixels do not count as signal."""
_DARK_SIGMAS = 2.0
"""An image of noise is dark where its median is within this many standard deviations of 0."""
_BLOCK = 8
"""Side of the blocks whose means show a signal that noise hides in single pixels [px]."""
_BLOCK_SIGMAS = 12.0
"""Range of the block means of white noise in standard errors: it stays below this for a million blocks."""


def off_body_mask(image: Image) -> np.ndarray:
    """(h, w) bool: True on dark sky; all False if the image shows none.

    Sky is as dark as the darkest part of the image's edge, reaches the edge, covers at least 0.5 % of the
    image, and is a plateau (dark ground has texture and a gentle rim). A shadow that touches the edge or the sky counts
    as sky, since one image cannot distinguish them; neither has a brightness worth measuring.
    """
    import cv2

    sky = np.zeros(image.valid.shape, bool)
    if image.valid.sum() < _FEWEST_PIXELS:
        return sky
    dark, bright = np.percentile(image.brightness[image.valid], [_DARK_PERCENTILE, _BRIGHT_PERCENTILE])
    contrast = bright - dark
    edge = np.ones(image.valid.shape, bool)
    edge[_EDGE_PX:-_EDGE_PX, _EDGE_PX:-_EDGE_PX] = False
    samples = image.brightness[edge & image.valid]
    samples = samples[samples < dark + _DARK_SHARE * contrast]
    if len(samples) < _FEWEST_SAMPLES:
        return sky

    # The level and noise of the sky, from the dark part of the edge.
    level = np.median(samples)
    noise = SIGMA_PER_MEDIAN * np.median(np.abs(samples - level))
    tolerance = min(max(_SKY_SIGMAS * noise, _LEAST_TOLERANCE * contrast), _DARK_SHARE * contrast)
    candidate = ((image.brightness <= level + tolerance) | ~image.valid).astype(np.uint8)
    candidate = cv2.morphologyEx(candidate, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))

    # Large pieces that touch the edge and are plateaus.
    count, label, statistics, _ = cv2.connectedComponentsWithStats(candidate, connectivity=4)
    label = np.asarray(label)
    for piece in np.intersect1d(label[edge], np.arange(1, count)):
        area = statistics[piece, cv2.CC_STAT_AREA]
        inside = (label == piece) & image.valid
        if area >= _LEAST_AREA * inside.size and _is_plateau(image, inside, level + tolerance, tolerance, contrast):
            sky |= inside
    return sky


def _is_plateau(image: Image, inside: np.ndarray, top: float, tolerance: float, contrast: float) -> bool:
    """Whether the pixels `inside` (h, w), all below `top`, are flat with a steep rim.

    Flat: their spread is that of white noise, or below 0.5 % of the contrast. Steep: few pixels around them
    are brighter by less than 2 tolerances (a gentle valley has about as many of these as pixels inside).
    """
    import cv2

    reach = max(_LEAST_RIM_PX, _RIM_WIDTH * np.sqrt(inside.sum()))
    near = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, 3) < reach
    rim = near & ~inside & image.valid & (image.brightness > top) & (image.brightness <= top + 2.0 * tolerance)
    if rim.sum() > _RIM_SHARE * inside.sum():
        return False
    core = cv2.erode(inside.astype(np.uint8), np.ones((_CORE_PX, _CORE_PX), np.uint8)) == 1
    pair = core[:, 1:] & core[:, :-1]
    if pair.sum() < _FEWEST_SAMPLES:
        return False
    spread = np.std(image.brightness[core])
    white = np.std((image.brightness[:, 1:] - image.brightness[:, :-1])[pair]) / np.sqrt(2.0)
    return bool(spread <= max(_PLATEAU_SPREAD * white, _PLATEAU_CONTRAST * contrast))


def why_it_shows_nothing(image: Image) -> str | None:
    """In words, that an image is constant, or white noise about a constant; None if it shows something.

    Of noise, the means over blocks of 8 x 8 pixels differ by no more than their standard errors explain. The image is
    dark where its mean is within the noise of 0, or it is 0 itself. It has a valid pixel.
    """
    seen = image.brightness[image.valid]
    low, high = float(seen.min()), float(seen.max())
    if low == high and low != 0.0:
        return f"is constant: all its valid pixels are {low:g}, as where it is overexposed, covered or made up"
    noise = _white_noise(image)
    if noise is None:
        return None
    middle = float(np.median(seen))
    if abs(middle) <= _DARK_SIGMAS * noise:
        return f"is dark: nothing rises above its noise (brightness {low:g} to {high:g})"
    return (
        f"is noise alone: {middle:g} with a standard deviation of {noise:.3g} and no detail, as where it is "
        "overexposed, covered or out of focus"
    )


def _white_noise(image: Image) -> float | None:
    """The standard deviation of an image that is white noise about a constant; None for others."""
    seen = image.brightness[image.valid]
    if seen.min() == seen.max():
        return 0.0
    low, high = np.percentile(seen, _CLIP_PERCENT)
    clipped = np.where(image.valid, np.clip(image.brightness, low, high), np.median(seen))
    height, width = (n // _BLOCK * _BLOCK for n in clipped.shape)
    if height * width == 0:
        return None
    noise = np.std(np.diff(clipped, axis=1)) / np.sqrt(2.0)
    means = clipped[:height, :width].reshape(height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK).mean((1, 3))
    return float(noise) if np.ptp(means) <= _BLOCK_SIGMAS * noise / _BLOCK else None
