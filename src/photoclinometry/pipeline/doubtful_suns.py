"""Whether Suns that the sparse points contradict are really wrong, judged by the brightness of landmarks of the map.

Sparse ground is coarse: it contradicts sound Suns of steep ground, and does not show which of several Suns is wrong.
The landmarks of the map are dense. A wrong Sun of a single view distorts the slopes that its shading implies.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.evaluate.own_suns import own_suns
from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.photometry.inconsistent_views import MODEL_RAD, warn_undecided
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.map_stages import IntermediateMap
from photoclinometry.pipeline.model_choice import CROSS_VALIDATION_LANDMARKS

log = logging.getLogger(__name__)

FALSE_ALARMS = 0.01
"""Share of the doubtful sites with sound Suns alone, in which one is called wrong by chance."""


@dataclass(frozen=True, kw_only=True)
class DoubtfulSuns:
    """The errors of the Suns of the map's K views, as determined from the map."""

    wrong: np.ndarray
    """(K,) bool: those that are wrong by themselves."""
    sun: np.ndarray
    """(K, 3) unit vectors in B: wrong ones as brightness determines them, the others as they were."""
    off: np.ndarray
    """(K,) by how much they are wrong [rad]; NaN where the map does not determine it."""

    def taken_into_account(self, scene: Scene) -> Scene:
        """The scene with wrong Suns replaced by those that fit the images, and with uncertainties as large as their
        errors."""
        views = scene.views
        sigma = np.where(self.wrong, np.fmax(views.sun_sigma, self.off), views.sun_sigma)
        return replace(scene, views=replace(views, sun=self.sun, sun_sigma=sigma))


@dataclass(frozen=True, kw_only=True)
class CheckDoubtfulSuns(Stage[DoubtfulSuns]):
    """Looks for Suns that are wrong by themselves, and warns of them."""

    name = "doubtful_suns"
    result = DoubtfulSuns
    relit: Keyed[IntermediateMap]
    reflectance: Reflectance
    """The model of the last estimate, as it is known beforehand."""
    doubtful: Sequence[str]
    """Names of the views whose Suns the sparse points contradict."""

    def make(self, tools: Tools) -> DoubtfulSuns:
        scene = self.relit.value.scene
        views = scene.views
        try:
            found = own_suns(scene, self.reflectance, CROSS_VALIDATION_LANDMARKS)
        except InputError as error:
            log.info("doubtful Suns are not compared with the map: %s", error)
            warn_undecided(self.doubtful, len(views))
            nothing = np.full(len(views), np.nan)
            return DoubtfulSuns(wrong=np.zeros(len(views), bool), sun=views.sun, off=nothing)
        sigma = np.sqrt(found.sigma**2 + views.sun_sigma**2 + MODEL_RAD**2)
        wrong = found.off > largest_by_chance(len(views)) * sigma
        for k in np.flatnonzero(wrong):
            warn(
                log, "suns-moved",
                "%s: its Sun is off by %.1f degrees (+- %.1f), by the brightness of the map's landmarks. The map takes "
                "that into account: check its `sun`",
                views.name[k], math.degrees(found.off[k]), math.degrees(sigma[k]), view=views.name[k],
            )  # fmt: skip
        worst = int(np.argmax(found.off / sigma))
        say_found(
            f"{wrong.sum()} of {len(wrong)} wrong; {views.name[worst]} off by {math.degrees(found.off[worst]):.1f} +- "
            f"{math.degrees(sigma[worst]):.1f} deg"
        )
        return DoubtfulSuns(wrong=wrong, sun=np.where(wrong[:, None], found.sun, views.sun), off=found.off)


def largest_by_chance(suns: int) -> float:
    """Standard deviations that no Sun of `suns` sound ones is off by, except at a share FALSE_ALARMS of the sites.

    The length of one Sun's error along two axes exceeds x standard deviations with the probability exp(-x^2 / 2)
    (Rayleigh).
    """
    return math.sqrt(2.0 * math.log(suns / FALSE_ALARMS))
