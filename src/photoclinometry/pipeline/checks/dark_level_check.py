"""Whether the dark level of uncalibrated images is known, or small enough not to matter."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from photoclinometry.io.dark_level import darkest_pixels
from photoclinometry.model.image import Image
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn

log = logging.getLogger(__name__)

MOST_UNKNOWN = 0.5
"""Largest share of the median brightness that the darkest pixels may have where no shadow or sky shows the dark level.
The dark level is not above the darkest pixels. An offset of half the brightness halves the contrast of shading, and the
relief with it."""

NAMED = 3
"""Number of images of the cameras with unknown dark level that the warning names."""


def warn_of_dark_level(scene: Scene, images: Sequence[Image]) -> None:
    """Warns of uncalibrated images whose remaining offset may halve the relief of the map.

    Each camera has a dark level of its own, known where an image of it has one (`io.dark_level.dark_levels`).
    images: the views', less their dark level, among others and in any order.
    """
    views = scene.views
    if scene.brightness != "dn" or scene.reflectance is None:
        return
    unknown, share = [], 0.0
    for camera in dict.fromkeys(views.cameras):
        own = np.array([other == camera for other in views.cameras])
        names = {views.name[k] for k in np.flatnonzero(own)}
        used = [image for image in images if image.name in names and image.valid.any()]
        if views.dark_level[own].any() or not used:
            continue
        darkest = np.median([darkest_pixels(image).brightness / np.median(_valid(image)) for image in used])
        if darkest > MOST_UNKNOWN:
            unknown += [name for name in views.name if name in names]
            share = max(share, float(darkest))
    if unknown:
        warn(
            log, "dark-level-unknown",
            "no shadow or sky shows the dark level of %s, which may be up to %.0f %% of their brightness: where such "
            "an offset is left in, relief is too flat by as much. Subtract the detector's offset and dark current, or "
            "add an image of the same camera with cast shadows",
            _which(unknown, len(views)), 100.0 * share,
        )  # fmt: skip


def _valid(image: Image) -> np.ndarray:
    """(n,) brightness of the valid pixels."""
    return image.brightness[image.valid]


def _which(names: Sequence[str], views: int) -> str:
    """In words: the uncalibrated images of all `views` views, or those of some cameras."""
    if len(names) == views:
        return "these uncalibrated images"
    others = "" if len(names) <= NAMED else f" and {len(names) - NAMED} more"
    return f"{len(names)} of {views} uncalibrated images, {', '.join(names[:NAMED])}{others}"
