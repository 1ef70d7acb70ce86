"""Measured reflectance, reduced to one geometry of incidence, emission and phase."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.scene import Scene

_ROUNDING_DEG = 1e-9
"""Sums of decimal degrees may differ by this from the exact limit."""


def corrected_reflectance(scene: Scene, geometry_deg: tuple[float, float, float]) -> np.ndarray:
    """(J,) reflectance of each landmark at one incidence, emission and phase; NaN if no view saw it lit.

    In a view, brightness = scale * albedo * rho + bias. The least-squares albedo of a landmark's lit measurements is
    sum(rho I) / sum(rho^2) with I = (brightness - bias) / scale, so grazing light has little weight. The result is that
    albedo times rho at the given geometry. Unlike the albedo map it is not smoothed between neighbours. It is in
    I/F if the model predicts absolute brightness, else in units of the scene's scales.

    Raises InputError for a scene without reflectance model, and for an impossible geometry.
    """
    if scene.reflectance is None:
        raise InputError(
            f"scene {scene.name!r} holds geometry alone: it has no reflectance model; leave `reflectance` out"
        )
    rho = np.zeros(len(scene.tracks))
    measured = np.zeros(len(scene.tracks))
    views, tracks, landmarks, landmark = scene.views, scene.tracks, scene.landmarks, scene.tracks.landmark
    for k in range(len(views)):
        seen = np.flatnonzero((tracks.view == k) & tracks.lit)
        at = landmark[seen]
        center = views.body_from_cam.translation[k]
        angles = photometric_angles(views.sun[k], center, landmarks.position[at], landmarks.normal[at])
        rho[seen] = scene.reflectance(*angles)
        measured[seen] = (tracks.brightness[seen] - views.bias[k]) / views.scale[k]
    weight = np.bincount(landmark, rho**2, len(landmarks))
    total = np.bincount(landmark, rho * measured, len(landmarks))
    albedo = np.divide(total, weight, out=np.full(len(landmarks), np.nan), where=weight > 0)
    return albedo * scene.reflectance(*_cosines(geometry_deg))


def _cosines(geometry_deg: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines of incidence and emission, and phase [rad]."""
    incidence, emission, phase = geometry_deg
    possible = abs(incidence - emission) - _ROUNDING_DEG <= phase <= incidence + emission + _ROUNDING_DEG
    if not (0 <= incidence < 90 and 0 <= emission < 90 and possible):
        raise InputError(
            f"--standard-geometry-deg {incidence:g} {emission:g} {phase:g}: incidence and emission are from 0 to below "
            "90, and the phase between their difference and their sum"
        )
    return np.cos(np.radians(incidence)), np.cos(np.radians(emission)), np.asarray(np.radians(phase))
