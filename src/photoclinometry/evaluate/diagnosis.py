"""Figures that point to the cause of a wrong map: Suns, optics, the response of images, shading left in albedos.

They are no verdict: `docs/reference/metrics.md` has their meaning, and their values for sound maps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from photoclinometry.evaluate.illumination import view_angles_deg
from photoclinometry.evaluate.unreliable import albedo_is_known, normal_is_known
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.projection import keypoint_residuals
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import observation_brightness, shading

RINGS, QUINTILES = 5, 5
"""Parts of the radius from the principal point to the farthest corner, and of the observations by brightness."""
FEWEST = 30
"""Observations that a ring or a quintile must have: medians of fewer scatter by a fifth of the residuals and more."""
DETREND = 9
"""Side of the square of landmarks whose mean is subtracted from albedos and shading before they are compared. Errors of
slopes, for which albedos compensate, differ between neighbours; larger patches differ in albedo anyway."""

Diagnosis = dict[str, list[float | None]]
"""Short lists by name, whose ends are units; None where observations are too few."""


def view_diagnosis(scene: Scene) -> list[dict[str, Any]]:
    """One row per view: ground sample distance, medians of incidence, emission and phase, and the distance of the
    estimated Sun from the stated one: as an angle, and in standard deviations (root mean square over the two axes)."""
    views, angles = scene.views, view_angles_deg(scene)
    stated = np.einsum("kij,kj->ki", views.body_from_cam.rotation, views.sun_measured)
    moved, sigma = angle_between(views.sun, stated), np.hypot(views.sun_sigma, views.sun_common_sigma)
    rows = []
    for k in range(len(views)):
        unit = "gsd_m" if scene.unit == "m" else "gsd_in_scene_unit"
        row = {unit: views.gsd(k, scene.landmarks.position)}
        row |= {f"{name}_median_deg": float(of[k]) for name, of in angles.items() if np.isfinite(of[k])}
        if scene.reflectance is not None:
            row["sun_moved_deg"] = float(np.degrees(moved[k]))
            if sigma[k] > 0.0:
                row["sun_moved_sigmas"] = float(moved[k] / sigma[k] / np.sqrt(2.0))
        rows.append(row)
    return rows


def diagnosis(scene: Scene) -> Diagnosis:
    """Residuals of keypoints by radius in the detector, and of brightness by brightness."""
    found = keypoints_by_radius(scene)
    return found if scene.reflectance is None else found | residuals_by_brightness(scene)


def keypoints_by_radius(scene: Scene) -> Diagnosis:
    """Medians over RINGS of equal width about the principal point, from the middle outwards: of the lengths of keypoint
    residuals, and of their parts outwards (measured minus projected) [px]."""
    tracks, intrinsics = scene.tracks, scene.views.intrinsics
    sizes = np.array([(camera.width, camera.height) for camera in scene.views.cameras], float)
    middle = intrinsics[:, 2:]
    farthest = np.linalg.norm(np.maximum(middle, sizes - middle), axis=1)
    off = -keypoint_residuals(scene)
    outwards = tracks.keypoint - middle[tracks.view]
    radius = np.linalg.norm(outwards, axis=1)
    along = np.sum(off * outwards, axis=1) / np.where(radius > 0.0, radius, 1.0)
    ring = np.minimum((RINGS * radius / farthest[tracks.view]).astype(int), RINGS - 1)
    chosen = [ring == n for n in range(RINGS)]
    length = np.linalg.norm(off, axis=1)
    return {
        "keypoint_residual_by_radius_px": _of_parts(chosen, lambda part: np.median(length[part])),
        "keypoint_outwards_by_radius_px": _of_parts(chosen, lambda part: np.median(along[part])),
    }


def residuals_by_brightness(scene: Scene) -> Diagnosis:
    """Medians of measured minus predicted brightness, in per cent of the predicted one, over the QUINTILES of the lit
    observations by predicted brightness, the darkest first.

    Sorted by the predicted one, since noise alone makes the brightest measurements brighter than predicted.
    """
    lit = np.flatnonzero(scene.tracks.lit)
    predicted = observation_brightness(scene, lit)
    residual = scene.tracks.brightness[lit] - predicted
    edges = np.quantile(predicted, np.arange(1, QUINTILES) / QUINTILES) if len(lit) else np.zeros(QUINTILES - 1)
    part_of = np.searchsorted(edges, predicted)
    chosen = [part_of == n for n in range(QUINTILES)]

    def share(part: np.ndarray) -> float:
        return 100.0 * np.median(residual[part]) / np.median(predicted[part])

    return {"brightness_residual_by_quintile_percent": _of_parts(chosen, share)}


def albedo_shading_correlation(scene: Scene) -> float | None:
    """Spearman's rank correlation between albedos and the shading that the map predicts for the reference view, both
    less their means over DETREND x DETREND landmarks; None where too few landmarks are lit and known.

    Above 0 albedos are bright where slopes are bright: shading is left in the albedos, and the relief is too flat.
    Below 0 albedos compensate for shading that is too strong, and the relief is too steep.
    """
    from scipy.stats import rankdata

    if scene.reflectance is None:
        return None
    landmarks, every = scene.landmarks, np.arange(len(scene.landmarks))
    view = np.full(len(every), scene.reference)
    rho = shading(every, view, scene.views, landmarks.position, landmarks.normal, scene.reflectance)[2]
    known = (rho > 0.0) & albedo_is_known(scene) & normal_is_known(scene) & _lit_in_reference(scene)
    grids = [scene.grid(np.where(known, values, np.nan)) for values in (landmarks.albedo, rho)]
    there = np.isfinite(grids[0])
    if np.count_nonzero(there) < DETREND**2:
        return None
    fine = [_less_local_mean(grid, there)[there] for grid in grids]
    if min(np.ptp(values) for values in fine) == 0.0:
        return None
    return float(np.corrcoef(*(rankdata(values) for values in fine))[0, 1])


def _lit_in_reference(scene: Scene) -> np.ndarray:
    """(J,) bool."""
    tracks, found = scene.tracks, np.zeros(len(scene.landmarks), bool)
    found[tracks.landmark[tracks.lit & (tracks.view == scene.reference)]] = True
    return found


def _less_local_mean(grid: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Values (h, w) less the mean of the values around that exist (h, w) bool; 0 elsewhere."""

    def mean(values: np.ndarray) -> np.ndarray:
        return cv2.blur(values, (DETREND, DETREND), borderType=cv2.BORDER_CONSTANT)

    filled = np.where(there, grid, 0.0)
    share = mean(there.astype(float))
    return np.where(there, filled - mean(filled) / np.where(there, share, 1.0), 0.0)


def _of_parts(chosen: list[np.ndarray], figure: Callable[[np.ndarray], float]) -> list[float | None]:
    """A figure of each part (N,) bool that has FEWEST observations."""
    return [float(figure(part)) if np.count_nonzero(part) >= FEWEST else None for part in chosen]
