"""Reflectance corrected for incidence: what the images measured, reduced to one geometry of light and sight."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.scene import Scene


def corrected_reflectance(scene: Scene, geometry_deg: tuple[float, float, float]) -> np.ndarray:
    """(J,) what each landmark would measure at one incidence, emission and phase; NaN where no view saw it lit.

    In a view, brightness = scale * albedo * rho + bias; of a landmark's lit measurements the albedo of least squares is
    sum(rho I) / sum(rho^2), I = (brightness - bias) / scale, so that grazing light counts little. That times rho of
    the standard geometry. It differs from the albedo map as measurement does from estimate: nothing is smoothed between
    neighbours. I/F where the model predicts absolute brightness, else in units of the scene's scales.

    Raises InputError for a scene without reflectance model, and for a geometry that cannot be.
    """
    if scene.reflectance is None:
        raise InputError(f"scene {scene.name!r} holds geometry alone: it has no reflectance; leave that map out")
    rho = np.zeros(len(scene.tracks))
    measured = np.zeros(len(scene.tracks))
    views, tracks, marks, landmark = scene.views, scene.tracks, scene.landmarks, scene.tracks.landmark
    for k in range(len(views)):
        seen = np.flatnonzero((tracks.view == k) & tracks.lit)
        at = landmark[seen]
        center = views.body_from_cam.translation[k]
        rho[seen] = scene.reflectance(*photometric_angles(views.sun[k], center, marks.position[at], marks.normal[at]))
        measured[seen] = (tracks.brightness[seen] - views.bias[k]) / views.scale[k]
    weight = np.bincount(landmark, rho**2, len(marks))
    total = np.bincount(landmark, rho * measured, len(marks))
    albedo = np.divide(total, weight, out=np.full(len(marks), np.nan), where=weight > 0)
    return albedo * scene.reflectance(*_cosines(geometry_deg))


def _cosines(geometry_deg: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines of incidence and emission, and phase [rad]."""
    incidence, emission, phase = geometry_deg
    possible = abs(incidence - emission) - 1e-9 <= phase <= incidence + emission + 1e-9
    if not (0 <= incidence < 90 and 0 <= emission < 90 and possible):
        raise InputError(
            f"--standard-geometry-deg {incidence:g} {emission:g} {phase:g}: incidence and emission are from 0 to below "
            "90, and the phase between their difference and their sum"
        )
    return np.cos(np.radians(incidence)), np.cos(np.radians(emission)), np.asarray(np.radians(phase))
