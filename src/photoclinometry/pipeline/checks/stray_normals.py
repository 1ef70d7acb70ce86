"""Normals that have strayed: landmarks whose brightness the finished map does not explain at all.

Beyond the terminator and on dark walls brightness has more than one minimum, and the estimate's loss lets single
landmarks stay at a false one: its normal may then point away from the Sun that lights it in every image.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.robust import robust_sigma
from photoclinometry.model.scene import Scene, Tracks
from photoclinometry.photometry.predict import brightness_residuals
from photoclinometry.photometry.shading import fitted_to_brightness

log = logging.getLogger(__name__)

UNEXPLAINED = 10.0
"""Root mean square of a landmark's lit residuals of brightness over the map's standard deviation from which on its
normal has strayed: noise and errors of the model reach three to five."""

LEAST_REDUCTION = 3.0
"""Factor by which a new normal must reduce the residuals of a stray landmark; otherwise the landmark keeps its normal.
Where the edge of a shadow spoils the brightness, no other normal explains it much better or is nearer to the truth."""

WINDOW = 5
"""Side of the square of landmarks whose normals and albedos a stray one starts again from."""


def with_strays_fitted_again(scene: Scene) -> Scene:
    """The scene with normals and albedos of stray landmarks fitted again, starting from those of their neighbours.

    A landmark whose brightness is then explained no better keeps its normal and albedo. Positions and their stated
    uncertainties stay. A scene of geometry alone, or whose brightness is explained everywhere, stays as it is.
    """
    if scene.reflectance is None or not scene.tracks.lit.any():
        return scene
    residual = brightness_residuals(scene)
    sigma = robust_sigma(residual[scene.tracks.lit])
    before = _rms(residual, scene.tracks)
    stray = np.flatnonzero(before > UNEXPLAINED * sigma)
    if not len(stray) or not sigma > 0:
        return scene
    normal, albedo = (
        _of_neighbours(scene, values, stray) for values in (scene.landmarks.normal, scene.landmarks.albedo)
    )
    known = np.isfinite(albedo) & np.isfinite(normal).all(-1)
    stray, normal, albedo = stray[known], unit(normal[known]), albedo[known]
    tracks, _ = scene.tracks.of_landmarks(stray)
    begun = replace(scene.landmarks[stray], normal=normal, albedo=albedo)
    fitted = fitted_to_brightness(replace(scene, landmarks=begun, tracks=tracks), sigma)
    better = LEAST_REDUCTION * _rms(brightness_residuals(fitted), tracks) < before[stray]
    log.info("%d landmarks had strayed normals, of which %d are fitted again", len(known), np.count_nonzero(better))
    normals, albedos = scene.landmarks.normal.copy(), scene.landmarks.albedo.copy()
    normals[stray[better]], albedos[stray[better]] = fitted.landmarks.normal[better], fitted.landmarks.albedo[better]
    return replace(scene, landmarks=replace(scene.landmarks, normal=normals, albedo=albedos))


def _rms(residual: np.ndarray, tracks: Tracks) -> np.ndarray:
    """(J,) root mean square of each landmark's lit residuals (N,); 0 where it is nowhere lit."""
    count, landmark = len(tracks.start) - 1, tracks.landmark
    lit = np.bincount(landmark[tracks.lit], minlength=count)
    total = np.bincount(landmark[tracks.lit], residual[tracks.lit] ** 2, minlength=count)
    return np.sqrt(total / np.maximum(lit, 1))


def _of_neighbours(scene: Scene, values: np.ndarray, stray: np.ndarray) -> np.ndarray:
    """Medians (n, ...) of values (J, ...) around stray landmarks (n,), of those that are not; NaN without any."""
    sound = values.copy()
    sound[stray] = np.nan
    margin = WINDOW // 2
    around = [(margin, margin)] * 2 + [(0, 0)] * (values.ndim - 1)
    grid = np.pad(scene.grid(sound), around, constant_values=np.nan)
    row, col = (of[stray] for of in scene.cells)
    window = np.stack([grid[row + r, col + c] for r in range(WINDOW) for c in range(WINDOW)])
    found = np.full(window.shape[1:], np.nan)
    some = np.isfinite(window).reshape(len(window), len(stray), -1).any((0, 2))
    found[some] = np.nanmedian(window[:, some], axis=0)
    return found
