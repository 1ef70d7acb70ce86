"""The common rotation error of all measured Suns, determined from the brightness of some landmarks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from photoclinometry.adjust.graph.sun_directions import common_turns
from photoclinometry.evaluate.cross_validation import FOLDS, folds_of_views, photometry_by, sample_of
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.robust import jackknife_sigma
from photoclinometry.model.scene import Scene

FREE_SUNS_RAD = math.radians(3.0)
"""Prior standard deviation of the common error of all Suns while it is searched for [rad]."""


def common_sun_turn(scene: Scene, reflectance: Reflectance, landmarks: int) -> tuple[np.ndarray, np.ndarray]:
    """The rotation vector (3,) in C of the common error of all measured Suns, by brightness, and its standard
    deviations (3,) by leaving parts of the views out [rad]. Where views belong to several arcs, it is the error common
    to all arcs; an arc's own error counts as an error of each of its views.

    About `landmarks` landmarks are used, at the scene's positions, without smoothness between neighbours.
    reflectance: as it is known beforehand. Raises InputError as `rank_models` does.
    """
    sample = sample_of(scene, landmarks)
    views = sample.views
    own = views.sun_sigma if (views.arc == views.arc[0]).all() else np.hypot(views.sun_sigma, views.sun_common_sigma)
    together = {"sun_common_sigma": np.full(len(views), FREE_SUNS_RAD), "arc": np.zeros(len(views), int)}
    free = replace(sample, views=replace(views, sun_sigma=own, **together))
    fold = folds_of_views(free, min(FOLDS, len(views)))
    parts = [photometry_by(free, reflectance, np.flatnonzero(fold != part)) for part in range(fold.max() + 1)]
    turn = _turn(photometry_by(free, reflectance, np.arange(len(views))))
    return turn, jackknife_sigma(np.array([_turn(part) for part in parts]))


def _turn(found: Scene) -> np.ndarray:
    """(3,) of views of one arc."""
    return common_turns(found.views, found.views.arc[:1])[0]
