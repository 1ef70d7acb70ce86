"""Stated uncertainties as one standard deviation each, for tables and maps; names end in the unit.

Of directions and positions it is the root of the covariance's trace, the root mean square length of the error.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.scene import Scene
from photoclinometry.model.sigma import sigma_along, sigma_of_length
from photoclinometry.surface.relief import local_frame


def landmark_sigmas(scene: Scene) -> dict[str, np.ndarray]:
    """(J,) by name, if the scene states them: position and height over the mean plane [GSD], normal [deg], albedo [%].

    Infinite where nothing was measured.
    """
    stated, found = scene.uncertainty, {}
    if "position" in stated:
        found["position_sigma_gsd"] = sigma_of_length(stated["position"], 3) / scene.gsd
        if stated["position"].ndim == 3:
            up = local_frame(scene).rotation[:, 2]
            found["height_sigma_gsd"] = sigma_along(stated["position"], up) / scene.gsd
    if "normal" in stated:
        found["normal_sigma_deg"] = np.degrees(sigma_of_length(stated["normal"], 2))
    if "albedo" in stated:
        found["albedo_sigma_percent"] = 100.0 * sigma_of_length(stated["albedo"], 1) / scene.landmarks.albedo
    if "albedo_relative" in stated:
        found["albedo_relative_sigma_percent"] = (
            100.0 * sigma_of_length(stated["albedo_relative"], 1) / scene.landmarks.albedo
        )
    return found


def view_sigmas(scene: Scene) -> dict[str, np.ndarray]:
    """(K,) by name, if the scene states them: rotation and Sun [deg], camera centre [GSD], scale [%]."""
    units = {
        "rotation": ("rotation_sigma_deg", np.degrees(1.0), 3),
        "center": ("center_sigma_gsd", 1.0 / scene.gsd, 3),
        "sun": ("sun_sigma_deg", np.degrees(1.0), 2),
        "scale": ("scale_sigma_percent", 100.0 / scene.views.scale, 1),
    }
    return {
        name: factor * sigma_of_length(scene.uncertainty[key], axes)
        for key, (name, factor, axes) in units.items()
        if key in scene.uncertainty
    }
