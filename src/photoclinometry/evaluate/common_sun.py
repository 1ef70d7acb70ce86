"""The rotation by which all measured Suns are off alike, as the brightness of some landmarks tells it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from photoclinometry.adjust.graph.sun_directions import common_turn
from photoclinometry.evaluate.cross_validation import FOLDS, folds_of_views, photometry_by, sample_of
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.robust import jackknife_sigma
from photoclinometry.model.scene import Scene

FREE_SUNS_RAD = math.radians(3.0)
"""Standard deviation of an error that all Suns have in common, where it is to be found [rad]."""


def common_sun_turn(scene: Scene, reflectance: Reflectance, landmarks: int) -> tuple[np.ndarray, np.ndarray]:
    """The rotation vector (3,) in C by which all measured Suns are off alike as brightness tells it, and its standard
    deviations (3,) by leaving parts of the views out [rad].

    Some landmarks, about so many, take part, at the scene's positions, without smoothness between neighbours.
    reflectance: as it is known beforehand. Raises InputError as `rank_models` does.
    """
    sample = sample_of(scene, landmarks)
    views = sample.views
    free = replace(sample, views=replace(views, sun_common_sigma=np.full(len(views), FREE_SUNS_RAD)))
    fold = folds_of_views(free, min(FOLDS, len(views)))
    parts = [photometry_by(free, reflectance, np.flatnonzero(fold != part)) for part in range(fold.max() + 1)]
    turn = common_turn(photometry_by(free, reflectance, np.arange(len(views))).views)
    return turn, jackknife_sigma(np.array([common_turn(part.views) for part in parts]))
