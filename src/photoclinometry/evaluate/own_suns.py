"""The Sun of each view by itself, determined from the brightness of some landmarks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.evaluate.cross_validation import folds_of_views, photometry_by, sample_of
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.robust import jackknife_sigma
from photoclinometry.model.scene import Scene

FREE_SUN_RAD = math.radians(10.0)
"""Prior standard deviation of each Sun's own error while it is searched for [rad]."""
MOST_FOLDS = 10
"""Largest number of parts of the views. Each part is left out once, which costs an estimate."""


@dataclass(frozen=True, kw_only=True)
class OwnSuns:
    """Suns of K views, each free by itself."""

    sun: np.ndarray
    """(K, 3) unit vectors towards the Sun, in B."""
    off: np.ndarray
    """(K,) angles from the measured ones [rad]."""
    sigma: np.ndarray
    """(K,) their standard deviations along each of two axes, by leaving parts of the other views out [rad]."""


def own_suns(scene: Scene, reflectance: Reflectance, landmarks: int) -> OwnSuns:
    """Suns as determined from brightness, each independent of the others and of its stated direction.

    About `landmarks` landmarks are used, at the scene's positions, without smoothness between neighbours; their normals
    and albedos are estimated with the Suns. reflectance: as it is known beforehand. Raises InputError as `rank_models`
    does.
    """
    sample = sample_of(scene, landmarks)
    views, count = sample.views, len(sample.views)
    free = replace(sample, views=replace(views, sun_sigma=np.full(count, FREE_SUN_RAD)))
    sun = photometry_by(free, reflectance, np.arange(count)).views.sun
    fold = folds_of_views(free, min(MOST_FOLDS, count))
    by_part = []
    for part in range(fold.max() + 1):
        others = np.flatnonzero(fold != part)
        without = np.full((count, 3), np.nan)
        without[others] = photometry_by(free, reflectance, others).views.sun
        by_part.append(without)
    spread = np.array([jackknife_sigma(own[np.isfinite(own).all(1)]) for own in np.swapaxes(by_part, 0, 1)])
    return OwnSuns(sun=sun, off=angle_between(sun, views.sun), sigma=np.linalg.norm(spread, axis=1) / math.sqrt(2.0))
