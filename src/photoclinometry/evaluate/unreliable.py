"""Landmarks whose normal or albedo no measurement determines.

`scene.h5` keeps the values that the estimate left there. Figures, exports and the layers of the viewer show no data.
"""

from __future__ import annotations

import math

import numpy as np

from photoclinometry.evaluate.sigmas import landmark_sigmas
from photoclinometry.model.scene import Scene
from photoclinometry.model.sigma import UNTOLD_NORMAL_RAD, largest_sigma
from photoclinometry.surface.relief import local_frame

UNKNOWN_ALBEDO = 0.3
"""Standard deviation of an albedo, as a share of it, beyond which it is not known: albedos of one body's ground differ
by less."""

UNTOLD_SHARE = math.sqrt(0.5)
"""A normal is undetermined if its standard deviation about an axis is more than this share of UNTOLD_NORMAL_RAD (31
degrees): the fact that it points away from the ground then constrains it more than all measurements together."""

_OF_NORMALS, _OF_ALBEDOS = ("normal_sigma_deg",), ("albedo_sigma_percent", "albedo_relative_sigma_percent")
"""Names of sigmas, as of `landmark_sigmas`."""


def normal_is_known(scene: Scene) -> np.ndarray:
    """(J,) bool: whether a normal points out of the mean plane, and measurements determine it.

    Only the former is required in a scene that states no uncertainty of normals.
    """
    out_of_plane = scene.landmarks.normal @ local_frame(scene).rotation[:, 2] > 0.0
    if "normal" not in scene.uncertainty:
        return out_of_plane
    return out_of_plane & (largest_sigma(scene.uncertainty["normal"]) <= UNTOLD_SHARE * UNTOLD_NORMAL_RAD)


def albedo_is_known(scene: Scene) -> np.ndarray:
    """(J,) bool: whether an albedo is known among the others; all of a scene that states no uncertainty of albedos."""
    if "albedo_relative" not in scene.uncertainty:
        return np.ones(len(scene.landmarks), bool)
    return np.asarray(scene.uncertainty["albedo_relative"] <= UNKNOWN_ALBEDO * scene.landmarks.albedo)


def only_known(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values (J, ...) of landmarks, NaN of those that are not known (J,)."""
    return np.where(known if values.ndim == 1 else known[:, None], values, np.nan)


def known_sigmas(scene: Scene) -> dict[str, np.ndarray]:
    """(J,) by name as `landmark_sigmas`, NaN where nothing determines the normal or the albedo."""
    found = landmark_sigmas(scene)
    for names, is_known in ((_OF_NORMALS, normal_is_known), (_OF_ALBEDOS, albedo_is_known)):
        for name in set(names) & set(found):
            found[name] = only_known(found[name], is_known(scene))
    return found


def unreliable_counts(scene: Scene) -> dict[str, float]:
    """How many landmarks have no known normal, and no known albedo, for `metrics.json`."""
    found = {"landmarks_without_normal": float(np.count_nonzero(~normal_is_known(scene)))}
    if scene.reflectance is not None:
        found["landmarks_without_albedo"] = float(np.count_nonzero(~albedo_is_known(scene)))
    return found
