"""Whether the estimate left the Sun directions near their stated ones."""

from __future__ import annotations

import logging
import math

import numpy as np

from photoclinometry.adjust.graph.sun_directions import sun_offsets
from photoclinometry.model.scene import Scene
from photoclinometry.model.sigma import sigma_of_length
from photoclinometry.model.warning import warn
from photoclinometry.photometry.inconsistent_views import MODEL_RAD

log = logging.getLogger(__name__)

MOST_COMMON_SIGMAS, MOST_OWN_SIGMAS = 4.0, 6.0
"""Standard deviations beyond which all Suns of an arc together, and a single one, have moved too far. Those of 18
simulated maps, whose ground has another reflectance than the one inverted, move by 4.0 at most, 1.1 in the root mean
square. With a model without parameters single Suns move by 8 standard deviations, or half a degree: MODEL_RAD of
movement is always allowed."""
LEAST_SUN_SIGMAS = 2.0
"""Suns that moved together by fewer of the estimate's own standard deviations have not moved significantly. Where views
contradict each other, the estimate does not know the Suns better (sigmas of 2 degrees of Suns stated to 0.3)."""


def warn_of_suns(scene: Scene) -> None:
    """Warns of Suns that brightness has moved far beyond what is stated of them."""
    if scene.reflectance is None or not scene.tracks.lit.any():
        return
    views = scene.views
    own, common = sun_offsets(views)
    own_off, numbers = np.linalg.norm(own, axis=1), np.unique(views.arc)
    for number, together in zip(numbers, np.linalg.norm(common, axis=1), strict=True):
        of_arc = np.flatnonzero(views.arc == number)
        turned = float(together * np.max(views.sun_common_sigma[of_arc]))
        if together > MOST_COMMON_SIGMAS and turned > max(MODEL_RAD, LEAST_SUN_SIGMAS * _estimated_sigma(scene)):
            warn(
                log, "suns-moved",
                "the estimate has turned all Suns%s alike by %.1f degrees, %.0f standard deviations of what is stated: "
                "check the images (linear in radiance?), the reflectance model, `sun` and `sun_common_sigma_deg`",
                f" of the arc of {views.name[of_arc[0]]}" if len(numbers) > 1 else "", math.degrees(turned), together,
            )  # fmt: skip
    for k in np.flatnonzero((own_off > MOST_OWN_SIGMAS) & (own_off * views.sun_sigma > MODEL_RAD)):
        degrees = math.degrees(own_off[k] * views.sun_sigma[k])
        warn(
            log, "suns-moved",
            "%s: the estimate has moved its Sun by %.2f degrees against the others, %.0f standard deviations of what "
            "is stated: check its `sun`, or state with `sun_common_sigma_deg` which part of the errors all Suns share",
            views.name[k], degrees, own_off[k], view=views.name[k],
        )  # fmt: skip


def _estimated_sigma(scene: Scene) -> float:
    """Median standard deviation of a Sun along each of two axes, by the estimate [rad]; 0 where it states none."""
    stated = scene.uncertainty.get("sun")
    return 0.0 if stated is None else float(np.median(sigma_of_length(stated, 2))) / math.sqrt(2.0)
