"""Stated uncertainties as one standard deviation each, for tables and maps; names end in the unit.

Of directions and positions it is the root of the covariance's trace, the root mean square length of the error.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.scene import Scene
from photoclinometry.surface.relief import local_frame


def size(stated: np.ndarray) -> np.ndarray:
    """(n,) root mean square length of errors with covariances (n, d, d), or sigmas (n, d) along axes or (n,)."""
    if stated.ndim == 3:
        return np.sqrt(np.trace(stated, axis1=1, axis2=2))
    return np.abs(stated) if stated.ndim == 1 else np.linalg.norm(stated, axis=1)


def along(stated: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(n,) sigmas along a unit vector (3,), of covariances (n, 3, 3), or of sigmas (n, 3) along axes or (n,)."""
    if stated.ndim == 3:
        return np.sqrt(stated @ direction @ direction)
    return np.abs(stated) if stated.ndim == 1 else np.linalg.norm(stated * direction, axis=1)


def landmark_sigmas(scene: Scene) -> dict[str, np.ndarray]:
    """(J,) by name, if the scene states them: position and height over the mean plane [GSD], normal [deg], albedo [%].

    Infinite where nothing was measured.
    """
    stated, found = scene.uncertainty, {}
    if "position" in stated:
        found["position_sigma_gsd"] = size(stated["position"]) / scene.gsd
        if stated["position"].ndim == 3:
            up = local_frame(scene).rotation[:, 2]
            found["height_sigma_gsd"] = along(stated["position"], up) / scene.gsd
    if "normal" in stated:
        found["normal_sigma_deg"] = np.degrees(size(stated["normal"]))
    if "albedo" in stated:
        found["albedo_sigma_percent"] = 100.0 * size(stated["albedo"]) / scene.landmarks.albedo
    if "albedo_relative" in stated:
        found["albedo_relative_sigma_percent"] = 100.0 * size(stated["albedo_relative"]) / scene.landmarks.albedo
    return found


def view_sigmas(scene: Scene) -> dict[str, np.ndarray]:
    """(K,) by name, if the scene states them: rotation and Sun [deg], camera centre [GSD], scale [%]."""
    units = {
        "rotation": ("rotation_sigma_deg", np.degrees(1.0)),
        "center": ("center_sigma_gsd", 1.0 / scene.gsd),
        "sun": ("sun_sigma_deg", np.degrees(1.0)),
        "scale": ("scale_sigma_percent", 100.0 / scene.views.scale),
    }
    return {
        name: factor * size(scene.uncertainty[key]) for key, (name, factor) in units.items() if key in scene.uncertainty
    }
