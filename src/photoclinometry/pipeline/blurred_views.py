"""Whether all views are as sharp as the map that they make."""

from __future__ import annotations

import logging

import numpy as np

from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.photometry.sharpness import blur_px

log = logging.getLogger(__name__)

BLURRED_PX = 0.8
"""Standard deviation of a blur [px of the view] from which on a view is named. Views of sound simulated maps have 0.4
at most, and those blurred by 1, 1.5 and 2 px have 0.84, 1.56, and 1.84 to 2.0."""


def warn_of_blurred_views(scene: Scene) -> None:
    """Warns of views that are less sharp than the map. Says nothing of a scene without reflectance."""
    if scene.reflectance is None or not scene.tracks.lit.any():
        return
    blur = blur_px(scene)
    for k in np.flatnonzero(blur > BLURRED_PX):
        warn(
            log, "view-blurred",
            "%s: is less sharp than the other views, as if blurred by %.1f px (defocus, smear, an enlarged or strongly "
            "compressed image). It takes fine relief from the map and tilts normals: leave it out, and compare",
            scene.views.name[k], blur[k], view=scene.views.name[k],
        )  # fmt: skip
