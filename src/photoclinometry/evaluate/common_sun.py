"""The rotation by which all measured Suns are off alike, as the brightness of some landmarks tells it."""

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
"""Standard deviation of an error that all Suns have in common, where it is to be found [rad]."""


def common_sun_turn(scene: Scene, reflectance: Reflectance, landmarks: int) -> tuple[np.ndarray, np.ndarray]:
    """The rotation vector (3,) in C by which all measured Suns are off alike as brightness tells it, and its standard
    deviations (3,) by leaving parts of the views out [rad]. Where views are of several arcs, it is what is wrong with
    all of these; an arc's own error counts as one of each of its views.

    Some landmarks, about so many, take part, at the scene's positions, without smoothness between neighbours.
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
