"""The brightness that counts, and the standard deviation of each observation's error.

Errors of brightness that follows its landmark have three sources, which estimation of variance components separates
(Foerstner 1979): noise, equal everywhere; the error of the place in the image, times the image's gradient; and relief
below a pixel, times the change of brightness with slope. Boulders and rims have steep gradients, and low Suns make
large changes with slope. There brightness is several times less certain than elsewhere.
"""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np

from photoclinometry.adjust.graph.observations import ImageGradients
from photoclinometry.adjust.noise import MIN_BRIGHTNESS_SHARE
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.model.reflectance.angles import GRAZING
from photoclinometry.model.robust import REWEIGHTINGS, robust_sigma
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import brightness_by_slope, brightness_residuals, reflectance_of, shading
from photoclinometry.photometry.sampled_brightness import landmark_spacing_px

log = logging.getLogger(__name__)

SAMPLE = 200_000
"""Observations at most, chosen at random, that determine the variances: thousands in each of the cells below."""

GRADIENT_CELLS, SLOPE_CELLS = 12, 6
"""Parts of equal number into which observations are divided by the image's gradient and, within each, by the response
to slope. The variance of each cell is a median's, which outliers do not move."""

FEWEST_IN_CELL = 50
"""Observations whose median determines a variance to a quarter or so: enough beside dozens of other cells, and maps of
some thousand observations have no more."""

LEAST_SIGMA = 0.25
"""Least standard deviation relative to the median one: errors that are equal everywhere may be too small to be found
beside the others."""


class VarianceComponents(NamedTuple):
    """Components of the errors of brightness, as standard deviations."""

    noise: float
    """Of noise that is equal everywhere [brightness]."""
    place_px: float
    """Of the place where brightness is taken, along the image's gradient [px]."""
    slope_rad: float
    """Of the relief's slopes below a pixel [rad]."""

    def sigma(self, gradient: np.ndarray, by_slope: np.ndarray) -> np.ndarray:
        """(n,) standard deviations of brightness. gradient: (n,) of the image [brightness/px]; by_slope: (n,)
        `brightness_by_slope`."""
        return np.sqrt(self.noise**2 + (self.place_px * gradient) ** 2 + (self.slope_rad * by_slope) ** 2)


def usable_brightness(scene: Scene, options: AdjustOptions) -> np.ndarray:
    """Observations (N,) whose brightness counts: lit in the image, and neither Sun nor camera too low."""
    if scene.reflectance is None:
        return np.zeros(len(scene.tracks), bool)
    tracks, points = scene.tracks, scene.landmarks
    mu0, mu, _ = shading(tracks.landmark, tracks.view, scene.views, points.position, points.normal, scene.reflectance)
    high = mu0 > np.cos(np.radians(options.max_incidence_deg))
    return tracks.lit & high & (mu > np.cos(np.radians(options.max_emission_deg)))


def footprint_of(scene: Scene, mapped: int) -> np.ndarray:
    """(N,) square root of the ratio of the ground that an observation's pixel covers to that of a vertical view as fine
    as the map. mapped: number of the map's landmarks, which come first.

    A pixel that covers n landmarks measures their mean, so its noise counts as sqrt(n) times as large for each of them.
    n is larger where a view is coarser than the map, and where it sees the ground obliquely. The detail within a pixel
    is not measured; for coarse views it is taken from the map (`shading.unresolved_detail`).
    """
    tracks, views, points = scene.tracks, scene.views, scene.landmarks
    spacing = landmark_spacing_px(views, points.position[:mapped], scene.reference)
    _, emission, _ = shading(tracks.landmark, tracks.view, views, points.position, points.normal, reflectance_of(scene))
    return np.maximum(1.0 / spacing, 1.0)[tracks.view] / np.sqrt(np.maximum(emission, GRAZING))


def relative_sigma(scene: Scene, gradients: ImageGradients, lit: np.ndarray, mapped: int) -> np.ndarray:
    """(N,) standard deviation of each brightness relative to that of the median pixel in a vertical view as fine as the
    map.

    scene: an earlier estimate, whose residuals give the variances. lit: (N,) brightness that counts; mapped: number of
    the map's landmarks, which come first. By the footprint alone where residuals are too few or too small.
    """
    footprint = footprint_of(scene, mapped)
    gradient, by_slope = np.linalg.norm(gradients.gradient, axis=-1), brightness_by_slope(scene)
    which = some_of(np.flatnonzero(lit))
    residual = brightness_residuals(scene, which) / footprint[which]
    found = variance_components(residual, gradient[which], by_slope[which])
    if found is None or robust_sigma(residual) < MIN_BRIGHTNESS_SHARE * np.median(scene.tracks.brightness[which]):
        return footprint
    log.info(
        "errors of brightness: noise of %.2g, %.3f px of place, %.4f rad of slopes below a pixel",
        found.noise, found.place_px, found.slope_rad,
    )  # fmt: skip
    middle = float(np.median(found.sigma(gradient[which], by_slope[which])))
    return footprint * np.maximum(found.sigma(gradient, by_slope) / middle, LEAST_SIGMA)


def some_of(observations: np.ndarray, most: int = SAMPLE) -> np.ndarray:
    """Up to `most` of the indices (n,), the same ones each time, in their order.

    They are drawn at random: observations of a landmark follow each other, so that with even steps all might belong to
    one view.
    """
    if len(observations) <= most:
        return observations
    return np.sort(np.random.default_rng(0).choice(observations, most, replace=False))


def variance_components(residual: np.ndarray, gradient: np.ndarray, by_slope: np.ndarray) -> VarianceComponents | None:
    """Components of the variance of residuals (n,) that grow with gradients (n,) and responses to slope (n,).

    By non-negative least squares on robust variances of cells of similar observations. None where there are too few
    observations, or no errors.
    """
    from scipy.optimize import nnls

    rows, variance, count = [], [], []
    for steep in _parts(gradient, np.arange(len(residual)), GRADIENT_CELLS):
        for cell in _parts(by_slope, steep, SLOPE_CELLS):
            if len(cell) >= FEWEST_IN_CELL:
                rows.append([1.0, np.mean(gradient[cell] ** 2), np.mean(by_slope[cell] ** 2)])
                variance.append(robust_sigma(residual[cell]) ** 2)
                count.append(len(cell))
    if len(rows) < GRADIENT_CELLS or not np.median(variance) > 0.0:
        return None
    matrix, measured = np.array(rows), np.array(variance)
    unit_of = np.where(matrix.max(0) > 0.0, matrix.max(0), 1.0)  # columns of one size, for the solver's tolerance
    level = float(np.median(measured))
    matrix, measured = matrix / unit_of, measured / level
    predicted, component = np.ones(len(measured)), np.zeros(3)
    for _ in range(REWEIGHTINGS):
        weight = np.sqrt(count) / predicted
        component, _ = nnls(matrix * weight[:, None], measured * weight)
        predicted = np.maximum(matrix @ component, LEAST_SIGMA**2)
    return VarianceComponents(*map(float, np.sqrt(level * component / unit_of)))


def _parts(value: np.ndarray, which: np.ndarray, count: int) -> list[np.ndarray]:
    """Indices `which` (m,) divided into `count` parts of equal number, by value (n,)."""
    return np.array_split(which[np.argsort(value[which], kind="stable")], count)
