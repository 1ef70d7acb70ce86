"""Whether the dark level of uncalibrated images is known, or small enough not to matter."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from photoclinometry.io.dark_level import darkest_pixels
from photoclinometry.model.scene import Image, Scene
from photoclinometry.model.warning import warn

log = logging.getLogger(__name__)

MOST_UNKNOWN = 0.5
"""Share of the median brightness that the darkest pixels may have, where no shadow or sky shows the dark level: that
level is not above them. An offset of half the brightness halves the contrast of shading, and the relief with it."""


def warn_of_dark_level(scene: Scene, images: Sequence[Image]) -> None:
    """Warns of uncalibrated images of a map in which an offset may be left that halves the relief.

    images: the views', less their dark level, among others and in any order.
    """
    if scene.brightness != "dn" or scene.reflectance is None or scene.views.dark_level.any():
        return
    used = [image for image in images if image.name in scene.views.name and image.valid.any()]
    if not used:
        return
    share = np.median([darkest_pixels(image).brightness / np.median(image.brightness[image.valid]) for image in used])
    if share > MOST_UNKNOWN:
        warn(
            log, "dark-level-unknown",
            "no shadow or sky shows the dark level of these uncalibrated images, which may be up to %.0f %% of their "
            "brightness: where such an offset is left in, relief is too flat by as much. Subtract the detector's "
            "offset and dark current, or add an image with cast shadows",
            100.0 * share,
        )  # fmt: skip
