"""How sharp each view is, against the brightness that a map of all views predicts for it.

A blur reduces the contrast of fine detail and leaves that of coarser detail. The ratio of the view's contrast to the
prediction's is therefore compared between two bands. The prediction, too, has errors of detail where a view's Sun shows
slopes that other views hardly constrain. A regression on the prediction would be attenuated by them as by a blur. The
prediction is therefore regressed on the view (regression with errors in the predictor; Fuller 1987, Measurement Error
Models, 1.1).
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.robust import FEWEST_FOR_SIGMA
from photoclinometry.model.sampling import gaussian, masked_filter
from photoclinometry.model.scene import Scene
from photoclinometry.model.threads import in_threads
from photoclinometry.model.tiny import TINY
from photoclinometry.photometry.predict import observation_brightness

COARSE = 4.0
"""Standard deviation of the Gaussian whose average is subtracted first [landmarks]: longer waves do not depend on
sharpness."""

FINE = 1.5
"""Standard deviation of the Gaussian that separates fine detail, which it removes, from coarser detail, which it leaves
[landmarks]. It lies between the blurs that matter, of one landmark, and COARSE."""

WIDTHS = np.array([0.0, *np.geomspace(0.3, COARSE, 10)])
"""Standard deviations of Gaussians that are tried [landmarks]."""

SIDE = 128
"""Side of the square of landmarks in the middle of the map that is used."""

INSIDE = 0.9
"""Least known share of the weight within two landmarks for a landmark to count; edges of shadows have less."""


def blur_px(scene: Scene) -> np.ndarray:
    """(K,) standard deviation [px, of the view] of the Gaussian that reduces the contrast of the predicted detail to
    that of the view.

    0 where the view is at least as sharp as the map; NaN where it shows too little of the map. Raises InputError for a
    scene without reflectance.
    """
    tracks, views = scene.tracks, scene.views
    both = np.column_stack((tracks.brightness, observation_brightness(scene)))
    middle = tuple(slice(max(0, (n - SIDE) // 2), (n + SIDE) // 2) for n in scene.region.grid_shape)
    gsd = np.array([views.gsd(k, scene.landmarks.position) for k in range(len(views))])

    def width_of(k: int) -> float:
        seen = np.flatnonzero((tracks.view == k) & tracks.lit)
        measured, predicted = np.moveaxis(scene.grid_of_observations(both, seen)[middle], -1, 0)
        return _width_of_blur(measured, predicted)

    return np.array(in_threads(width_of, range(len(views)))) * scene.spacing / gsd


def _width_of_blur(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Standard deviation [landmarks]; NaN with too little of both (h, w), which are NaN where not known."""
    inside = np.isfinite(measured) & (masked_filter(measured, gaussian(2.0))[1] > INSIDE)
    if np.count_nonzero(inside) < FEWEST_FOR_SIGMA:
        return np.nan
    own = _bands(measured, inside)
    ratio = [_contrast_ratio(own, _bands(_blurred(predicted, width), inside)) for width in WIDTHS]
    if not np.isfinite(ratio).all():
        return np.nan
    return float(np.interp(1.0, np.maximum.accumulate(ratio), WIDTHS))


def _contrast_ratio(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Contrast of the measured over that of the predicted detail, in the fine band over that in the coarser one.

    Bands (2, n). Contrasts are those of the regression of `predicted` on `measured`, huge where the two are not
    correlated.
    """
    common = np.mean(measured * predicted, axis=-1)
    contrast = np.mean(measured**2, axis=-1) / np.maximum(common, TINY)
    return float(contrast[0] / contrast[1])


def _bands(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """(2, n) the fine and the coarser detail of values (h, w) where `inside`, about their means."""
    smooth, background = (masked_filter(values, gaussian(width))[0] for width in (FINE, COARSE))
    bands = np.stack([(values - smooth)[inside], (smooth - background)[inside]])
    return bands - bands.mean(axis=-1, keepdims=True)


def _blurred(values: np.ndarray, width: float) -> np.ndarray:
    return np.where(np.isfinite(values), masked_filter(values, gaussian(width))[0], np.nan) if width else values
