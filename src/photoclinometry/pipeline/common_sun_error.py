"""Whether brightness shows a common error of all Suns beyond their stated uncertainty, judged by some landmarks.

An alignment of the camera that is off, or a wrong frame, turns all Suns alike. Suns with small stated uncertainties
force this error into the map: normals turn, slopes change, and the residuals only look like more noise.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.evaluate.common_sun import common_sun_turn
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import so3_exp
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.robust import SIGNIFICANT
from photoclinometry.model.scene import Scene, Views
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.map_stages import IntermediateMap
from photoclinometry.pipeline.model_choice import CROSS_VALIDATION_LANDMARKS

log = logging.getLogger(__name__)

NOTICEABLE_RAD = math.radians(0.5)
"""Smaller turns are covered by the stated uncertainty: a wrong reflectance model turns Suns by tenths of a degree."""


@dataclass(frozen=True, kw_only=True)
class CommonSunError:
    """The rotation in C by which all measured Suns are off."""

    turn: np.ndarray
    """(3,) rotation vector from the measured Suns to those that fit the images [rad]; NaN where images do not determine
    it."""
    sigma: np.ndarray
    """(3,) its standard deviation about each axis, the stated common error included [rad]."""

    @property
    def is_clear(self) -> bool:
        """Whether the turn is more than chance, and matters."""
        clear = np.abs(self.turn) > SIGNIFICANT * self.sigma
        return bool(np.linalg.norm(self.turn[clear]) > NOTICEABLE_RAD)

    def taken_into_account(self, scene: Scene) -> Scene:
        """The scene with Suns turned to fit the images, and with a common uncertainty as large as their common
        error."""
        views = scene.views
        in_cam = (so3_exp(self.turn) @ views.sun_measured[..., None])[..., 0]
        sun = np.einsum("kij,kj->ki", views.body_from_cam.rotation, in_cam)
        common = np.maximum(views.sun_common_sigma, np.linalg.norm(self.turn))
        return replace(scene, views=replace(views, sun=sun, sun_common_sigma=common))


@dataclass(frozen=True, kw_only=True)
class CheckSuns(Stage[CommonSunError]):
    """Looks for an error that all Suns have in common, and warns of it."""

    name = "suns"
    result = CommonSunError
    relit: Keyed[IntermediateMap]
    reflectance: Reflectance
    """The model of the last estimate, as it is known beforehand."""

    def make(self, tools: Tools) -> CommonSunError:
        scene = self.relit.value.scene
        try:
            turn, spread = common_sun_turn(scene, self.reflectance, CROSS_VALIDATION_LANDMARKS)
        except InputError as error:
            log.info("Suns are not compared with brightness: %s", error)
            return CommonSunError(turn=np.full(3, np.nan), sigma=np.full(3, np.nan))
        found = CommonSunError(turn=turn, sigma=np.hypot(spread, _stated(scene.views)))
        off, sigma = np.degrees(turn), np.degrees(found.sigma)
        if found.is_clear:
            warn(
                log, "suns-moved",
                "all Suns are off alike by %.1f degrees about x, %.1f about y, %.1f about z of the camera (+- %.1f, "
                "%.1f, %.1f), beyond what is stated of them. The map takes that into account: check the camera's "
                "alignment, `sun`, or state `sun_common_sigma_deg`",
                *off, *sigma,
            )  # fmt: skip
        say_found("alike off by {:.1f}, {:.1f}, {:.1f} +- {:.1f}, {:.1f}, {:.1f} deg".format(*off, *sigma))
        return found


def _stated(views: Views) -> float:
    """Standard deviation of the common error that is stated, about each axis [rad]."""
    return float(np.max(views.sun_common_sigma))
