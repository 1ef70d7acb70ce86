"""The dark level of uncalibrated images: their brightness where there is no light.

A detector counts from an offset (bias level, dark current), and scattered light adds to it. The level differs between
cameras, temperatures and exposures. Cast shadows and the sky have that brightness, and nothing in an image is darker.
Left in, it makes ground look flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.image import Image

_DARKEST = 0.001
"""Share of the pixels that may be darker than the dark level: dead ones, and noise."""
_FEWEST = 0.005
"""Least share of the pixels in shadows and sky that determines the level."""
_FLAT = 0.02
"""The darkest pixels have one level where they span at most this share of the range between them and the median. Where
there is no shadow, they are ground that turns away from the Sun, and span a fifth or more."""


class Darkest(NamedTuple):
    """The darkest pixels of an image."""

    brightness: float
    level: float
    """Their level, if they are in shadows or sky; else NaN."""


def darkest_pixels(image: Image) -> Darkest:
    """image: with its sky, and at least one valid pixel."""
    shares = (_DARKEST, 0.5 * (_DARKEST + _FEWEST), _FEWEST, 0.5)
    darkest, level, end, median = np.quantile(image.brightness[image.valid], shares)
    return Darkest(float(darkest), float(level) if end - darkest <= _FLAT * (median - darkest) else np.nan)


def dark_levels(darkest: Sequence[Darkest], cameras: Sequence[Camera]) -> np.ndarray:
    """(K,) the dark level of each image, 0 where it is not known.

    darkest, cameras: of the K images. An image without shadows and sky has the median level of those of its camera's
    images that have them, but not more than its own darkest pixels.
    """
    brightness, level = np.array(darkest).reshape(-1, 2).T
    told, found = np.isfinite(level), np.zeros(len(level))
    for camera in dict.fromkeys(cameras):
        own = np.array([other == camera for other in cameras])
        if np.any(own & told):
            usual = np.minimum(np.median(level[own & told]), brightness)
            found[own] = np.where(told, level, usual)[own]
    return found


def without_dark_level(image: Image, level: float) -> Image:
    """The image less its dark level."""
    brightness = np.where(image.valid, image.brightness - np.float32(level), np.float32(0))
    return replace(image, brightness=brightness, dark_level=level)


def in_words(levels: np.ndarray) -> tuple[str, str]:
    """The dark levels (K,) of a map's uncalibrated images in a few words, and what they mean."""
    if not np.any(levels):
        return "unknown", "no cast shadow or sky was found to show it: an offset of the numbers would be left in"
    low, high = (f"{level:.4g}" for level in (np.min(levels), np.max(levels)))
    span = low if low == high else f"{low} to {high}"
    return span, "taken from the images: the numbers of cast shadows and of the sky"
