"""How sharp each view is, against the brightness that a map of all views predicts for it."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import observation_brightness
from photoclinometry.surface.sampling import gaussian, masked_filter

COARSE = 4.0
"""Waves longer than those that a Gaussian of this standard deviation leaves tell nothing of sharpness, and are taken
away first [landmarks]."""

WIDTHS = np.array([0.0, *np.geomspace(0.3, COARSE, 10)])
"""Standard deviations of Gaussians that are tried [landmarks]."""

SIDE = 128
"""So many landmarks, down and across, in the middle of the map are enough."""

INSIDE = 0.9
"""Share of the weight within two landmarks that must be known where a landmark counts: edges of shadows do not."""

FEWEST = 200
"""Landmarks below which nothing is said of a view."""


def blur_px(scene: Scene) -> np.ndarray:
    """(K,) standard deviation [px, of the view] of the Gaussian that makes the predicted brightness likest to a view.

    Likest is the highest correlation of what is fine in both. 0 where the view is at least as sharp as the map; NaN
    where it shows too little of it. Raises InputError for a scene without reflectance.
    """
    tracks, views = scene.tracks, scene.views
    both = np.column_stack((tracks.brightness, observation_brightness(scene)))
    middle = tuple(slice(max(0, (n - SIDE) // 2), (n + SIDE) // 2) for n in scene.region.grid_shape)
    gsd = np.array([views.gsd(k, scene.landmarks.position) for k in range(len(views))])
    found = np.full(len(views), np.nan)
    for k in range(len(views)):
        seen = np.flatnonzero((tracks.view == k) & tracks.lit)
        measured, predicted = np.moveaxis(scene.grid_of_observations(both, seen)[middle], -1, 0)
        found[k] = _likest_width(measured, predicted)
    return found * scene.spacing / gsd


def _likest_width(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Of WIDTHS, and between them; NaN with too little of both (h, w), which are NaN where not known."""
    inside = np.isfinite(measured) & (masked_filter(measured, gaussian(2.0))[1] > INSIDE)
    if np.count_nonzero(inside) < FEWEST:
        return np.nan
    fine = _fine(measured)[inside]
    likeness = np.array([np.corrcoef(fine, _fine(_blurred(predicted, width))[inside])[0, 1] for width in WIDTHS])
    if not np.isfinite(likeness).all():
        return np.nan
    best = int(np.argmax(likeness))
    if best in (0, len(WIDTHS) - 1):
        return float(WIDTHS[best])
    curvature, slope, _ = np.polyfit(WIDTHS[best - 1 : best + 2], likeness[best - 1 : best + 2], 2)
    return float(-slope / (2.0 * curvature)) if curvature < 0 else float(WIDTHS[best])


def _blurred(values: np.ndarray, width: float) -> np.ndarray:
    return np.where(np.isfinite(values), masked_filter(values, gaussian(width))[0], np.nan) if width else values


def _fine(values: np.ndarray) -> np.ndarray:
    return values - masked_filter(values, gaussian(COARSE))[0]
