"""Whether all views are as sharp as the map that they make, and the map without those that are not."""

from __future__ import annotations

import logging

import numpy as np

from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.photometry.sharpness import blur_px
from photoclinometry.registration.georeference import MIN_PRIORS

log = logging.getLogger(__name__)

BLURRED_PX = 0.8
"""Standard deviation of a blur [px of the view] from which on a view is named. Views of sound simulated maps have 0.4
at most, and those blurred by 1, 1.5 and 2 px have 0.84, 1.56, and 1.84 to 2.0."""


MOST_SHARE = 0.5
"""A view is left out if its blur is more than this share of the most blurred view's. The most blurred view blurs the
first map, and compared with that map the others seem to be blurred, too."""


def views_to_leave_out(scene: Scene, fewest: int, has_prior: np.ndarray | None = None) -> dict[int, float]:
    """Views that blur the map, by index, with their blur [px of the view].

    The most blurred go first, as long as `fewest` views are left, and MIN_PRIORS views whose pose prior is used. With
    fewer priors the map's present frame would not be held. has_prior: (K,) bool. The reference view stays, since its
    pixels are the map's. None of a scene without reflectance.
    """
    if scene.reflectance is None or not scene.tracks.lit.any():
        return {}
    blur = np.nan_to_num(blur_px(scene))
    blur[scene.reference] = 0.0
    found = np.flatnonzero(blur > max(BLURRED_PX, MOST_SHARE * blur.max()))
    worst = found[np.argsort(-blur[found], kind="stable")]
    if has_prior is not None and has_prior.any():
        of_prior = has_prior[worst]
        worst = worst[~of_prior | (np.cumsum(of_prior) <= np.count_nonzero(has_prior) - MIN_PRIORS)]
    return {int(k): float(blur[k]) for k in worst[: max(0, len(blur) - fewest)]}


def why_left_out(blur: float) -> str:
    """The reason that is given for a view that is left out."""
    return f"it is less sharp than the other views, as if blurred by {blur:.1f} px"


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
