"""Whether the numbers of images are linear in radiance, determined from views that were kept out.

Images encoded for display have numbers V that grow as a power of the radiance L: V ~ L^(1 / gamma). Taken for linear,
they have too little contrast in bright ground and too much in dark. Views that are kept out are predicted best by the
others if all are raised to the power gamma first: a wrong power distorts the relation between brightness and the slopes
that all views have in common. Heights and positions, which parallax determines, are held.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from photoclinometry.evaluate.cross_validation import (
    FOLDS,
    cross_validated_predictions,
    folds_of_views,
    sample_of,
)
from photoclinometry.model.gamma import gamma_corrected
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.robust import jackknife_sigma
from photoclinometry.model.scene import Scene
from photoclinometry.model.tiny import TINY

LOG_GAMMA_STEP = 0.15
"""Step between the logarithms of the exponents that are tried: about the exponent that a wrong reflectance model causes
or hides."""
MOST_STEPS = 9
"""Exponents from 1/3.9 to 3.9 are tried: those of displays are 1.8 to 2.6, and decoding has them inverted."""
FEWEST = 20
"""Fewest lit landmarks of a view for which an error is computed: a gain and an offset are fitted to them."""
FOR_THE_EYE = 5
"""Steps to 2.1, which is tried at once: sites whose geometry was bent by a wrong response have a local minimum at 1."""


@dataclass(frozen=True, kw_only=True)
class Response:
    """The exponent with which views predict each other best, and the errors of these predictions."""

    log_gamma: float
    """Natural logarithm of the exponent [-]; 0 of linear images."""
    sigma: float
    """Its standard deviation, by leaving parts of the views out [-]."""
    linear_error: np.ndarray
    """(K,) RMS residual of each view over its mean brightness, predicted as if images were linear [-]; NaN of views
    without lit landmarks."""
    decoded_error: np.ndarray
    """(K,) the same, predicted with the exponent."""

    @property
    def gamma(self) -> float:
        """The power to which the numbers are to be raised."""
        return math.exp(self.log_gamma)

    @property
    def gain(self) -> float:
        """Share by which the exponent reduces the errors; geometric mean over the views."""
        return 1.0 - math.exp(float(np.nanmean(np.log(self.decoded_error / self.linear_error))))


def response_of(scene: Scene, models: Sequence[Reflectance], landmarks: int) -> Response:
    """The exponent of the images' response that makes views predict each other best.

    About `landmarks` landmarks are used, at the scene's positions, without smoothness between neighbours. models:
    reflectance, as it is known beforehand, the one that fits linear images best first. Others are used where they
    predict images encoded for display better than the first does. Raises InputError as `rank_models` does.
    """
    sample = sample_of(scene, landmarks)
    part = folds_of_views(sample, min(FOLDS, len(sample.views)))
    first, *others = (partial(_log_errors, sample, model, part) for model in models)
    linear = first(0)
    tried = _searched(first, {0: linear, FOR_THE_EYE: first(FOR_THE_EYE)})
    for other in others:
        begin = {FOR_THE_EYE: other(FOR_THE_EYE)}
        if _mean(begin[FOR_THE_EYE]) < _mean(tried[_best(tried)]):
            tried = _searched(other, begin)
    best = _best(tried)
    middle = min(max(best, 1 - MOST_STEPS), MOST_STEPS - 1)
    around = np.array([tried[middle + n] for n in (-1, 0, 1)])
    without_part = [_lowest(around[:, part != number]) for number in range(part.max() + 1)]
    return Response(
        log_gamma=LOG_GAMMA_STEP * (middle + _lowest(around)),
        sigma=LOG_GAMMA_STEP * float(jackknife_sigma(np.array(without_part))),
        linear_error=np.exp(linear),
        decoded_error=np.exp(tried[best]),
    )


def _searched(errors: Callable[[int], np.ndarray], tried: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Errors (K,) of views by number of steps: those tried so far, and further ones until a minimum has both
    neighbours."""
    tried = dict(tried)
    while True:
        best = _best(tried)
        missing = [n for n in (best - 1, best + 1) if n not in tried and abs(n) <= MOST_STEPS]
        if not missing:
            return tried
        tried |= {n: errors(n) for n in missing}


def _best(tried: dict[int, np.ndarray]) -> int:
    """The number of steps with the lowest mean error."""
    return min(tried, key=lambda n: _mean(tried[n]))


def _mean(errors: np.ndarray) -> float:
    """Of those that are known."""
    return float(np.nanmean(errors))


def _lowest(around: np.ndarray) -> float:
    """Position of the lowest mean of errors (3, K) a step apart, in steps from the middle one: a parabola's vertex."""
    before, middle, after = np.nanmean(around, axis=1)
    bend = before - 2.0 * middle + after
    if bend <= 0.0:
        return float(np.argmin([before, middle, after]) - 1)
    return float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))


def _log_errors(scene: Scene, reflectance: Reflectance, part: np.ndarray, steps: int) -> np.ndarray:
    """(K,) logarithms of the RMS residuals of views, in the images' own numbers, predicted after raising these."""
    tracks, views, gamma = scene.tracks, len(scene.views), math.exp(steps * LOG_GAMMA_STEP)
    level = float(np.median(tracks.brightness[tracks.lit]))
    decoded = replace(scene, tracks=replace(tracks, brightness=gamma_corrected(tracks.brightness, gamma, level)))
    found, _ = cross_validated_predictions(decoded, reflectance, part)
    encoded = replace(
        found,
        measured=gamma_corrected(found.measured, 1.0 / gamma, level),
        predicted=gamma_corrected(found.predicted, 1.0 / gamma, level),
    )
    residual = encoded.residual(views, free_bias=scene.brightness == "dn")
    number = np.bincount(found.view, minlength=views)
    return np.where(number < FEWEST, np.nan, 0.5 * np.log(encoded.mean_by_view(residual**2, views) + TINY))
