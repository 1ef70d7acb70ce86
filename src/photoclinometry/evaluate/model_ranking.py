"""Ranking of reflectance models for a map: each is fitted to most of the views, and judged by those kept out."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from photoclinometry.adjust import AdjustOptions
from photoclinometry.evaluate.cross_validation import (
    CONFIDENCE,
    FEWEST_LANDMARKS,
    FOLDS,
    Predictions,
    cross_validated_predictions,
    folds_of_views,
    is_larger,
    photometry_by,
    sample_of,
)
from photoclinometry.model.errors import InputError
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.reflectance import MODELS, Reflectance, model_named, models_for, starting_model
from photoclinometry.model.robust import jackknife_sigma
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import exposure_is_free, reflectance_of

log = logging.getLogger(__name__)

UNDETERMINED = 0.7
"""A parameter whose standard deviation is more than this share of its prior's is hardly determined by the images: they
then contribute less than the prior."""


@dataclass(frozen=True, kw_only=True)
class RankingOptions(Ranged):
    """How reflectance models are compared."""

    models: tuple[str, ...] = ()
    """Names of the models; none for all that have values for the body, or need none."""
    landmarks: Annotated[int, Range(least=FEWEST_LANDMARKS, most=1_000_000)] = 1500
    """Approximate number of landmarks that are used, evenly spaced over rows and columns of the map."""
    folds: Annotated[int, Range(least=2, most=100)] = FOLDS
    """Parts of the views, of which each is kept out once."""


@dataclass(frozen=True, kw_only=True)
class ModelFit:
    """One model fitted to the brightness of a map."""

    reflectance: Reflectance
    """With parameters estimated from all views, or as it is known beforehand (`rank_models`)."""
    without_part: tuple[Reflectance, ...]
    """With parameters estimated without one part of the views each."""
    prior_sigma: np.ndarray
    """(T,) standard deviations of the parameters before any image."""
    predictions: Predictions
    residual: np.ndarray
    """(N,) of the predictions, see `Predictions.residual`."""
    pattern: np.ndarray
    """(K,) RMS residual of each view [-]; NaN of views without lit landmarks."""
    level: np.ndarray
    """(K,) predicted excess of a view's brightness over the measured one [-]; 0 where that is not compared."""

    @property
    def error(self) -> np.ndarray:
        """(K,) of pattern and level together [-]."""
        return np.hypot(self.pattern, self.level)

    @property
    def error_percent(self) -> float:
        """Geometric mean of `error`: views are not equally hard to predict, and each has the same weight."""
        return 100.0 * _geometric_mean(self.error)

    @property
    def pattern_percent(self) -> float:
        """Geometric mean of `pattern` over the views."""
        return 100.0 * _geometric_mean(self.pattern)

    @property
    def level_percent(self) -> float:
        """Median size of `level`."""
        return 100.0 * float(np.nanmedian(np.abs(self.level)))

    @property
    def phases_seen_deg(self) -> tuple[float, float]:
        """The least and the greatest phase angle of the predictions."""
        phase = self.predictions.angles_deg[:, 2]
        return float(phase.min()), float(phase.max())

    @property
    def parameter_sigma(self) -> np.ndarray:
        """(T,) standard deviations of the parameters, by leaving parts of the views out."""
        return jackknife_sigma(np.array([each.parameters for each in self.without_part]))

    @property
    def determined(self) -> np.ndarray:
        """(T,) bool: the images know a parameter better than its prior does."""
        return self.parameter_sigma < UNDETERMINED * self.prior_sigma


@dataclass(frozen=True, kw_only=True)
class ModelRanking:
    """Reflectance models, the best first."""

    fits: tuple[ModelFit, ...]
    left_out: dict[str, str]
    """Reasons why models were not fitted, by name of model."""
    views: tuple[str, ...]
    """(K,) names, as `ModelFit.error` has them."""

    @property
    def best(self) -> ModelFit:
        return self.fits[0]

    def is_as_good(self, fit: ModelFit, confidence: float = CONFIDENCE) -> bool:
        """Whether kept-out views do not distinguish a fit from the best, neither by their patterns nor by all
        errors."""
        pairs = ((fit.error, self.best.error), (fit.pattern, self.best.pattern))
        return not any(is_larger(mine, best, confidence) for mine, best in pairs)

    def of_best_pattern(self, confidence: float = CONFIDENCE) -> tuple[ModelFit, ...]:
        """Fits whose patterns are not significantly larger than the least one, in order of their errors.

        The shape of the ground follows from the pattern of brightness within views. The level of a view kept out at one
        end of the phases is an extrapolation, which a map from all views does not make.
        """
        least = min(self.fits, key=lambda fit: fit.pattern_percent)
        return tuple(fit for fit in self.fits if not is_larger(fit.pattern, least.pattern, confidence))


def rank_models(
    scene: Scene,
    options: RankingOptions | None = None,
    progress: Progress = no_progress,
    *,
    with_parameters: bool = True,
) -> ModelRanking:
    """Ranks reflectance models by how well they predict views that were kept out.

    The positions of the scene are held. For each model and each part of the views the joint estimate gives normals,
    albedos, Suns, exposures and the model's parameters from the other views, without smoothness between neighbours.
    The brightness of the part is then predicted under its measured Suns, turned by the common error of all Suns. A
    factor on each view's brightness is fitted then; it counts as an error, too, unless a model, or uncalibrated images,
    leave it open. with_parameters: the parameters of each model are estimated from all views, too; the order of the
    models does not depend on it. Raises InputError for scenes without a reflectance model (brightness was not
    measured), of too few views or lit landmarks, and for unknown models.
    """
    options = options or RankingOptions()
    reflectance_of(scene)
    sample = sample_of(scene, options.landmarks)
    names, left_out = _usable_models(options.models, scene)
    absolute = all(not exposure_is_free(scene.brightness, starting_model(name, scene.body)) for name in names)
    fold = folds_of_views(sample, min(options.folds, len(scene.views)))
    fits = []
    for number, name in enumerate(names):
        progress("models", number, len(names))
        start = starting_model(name, scene.body)
        fits.append(_fit(sample, start, fold, absolute=absolute, with_parameters=with_parameters))
        log.info("%s: %.3f %% on views kept out", name, fits[-1].error_percent)
    progress("models", len(names), len(names))
    fits.sort(key=lambda fit: fit.error_percent)
    return ModelRanking(fits=tuple(fits), left_out=left_out, views=scene.views.name)


def _geometric_mean(values: np.ndarray) -> float:
    """Of those that are not NaN."""
    return float(np.exp(np.nanmean(np.log(values))))


def _usable_models(asked: Sequence[str], scene: Scene) -> tuple[tuple[str, ...], dict[str, str]]:
    """The models asked for, or all that can be compared; and reasons why others are left out. Raises InputError."""
    of_body = usable = models_for(scene.body)
    names = [model_named(name).name for name in asked or MODELS]
    if asked:
        usable = tuple(name for name in names if name in of_body)
    elif scene.brightness == "iof":
        usable = models_for(scene.body, absolute=True) or of_body
    unknown = f"no values of its parameters are published for body {scene.body!r}"
    relative = "it has no phase function to compare with calibrated images"
    left_out = {name: relative if name in of_body else unknown for name in names if name not in usable}
    if not usable:
        raise InputError(f"none of the models can be fitted: {'; '.join(f'{n}: {why}' for n, why in left_out.items())}")
    return usable, left_out


def _fit(scene: Scene, start: Reflectance, fold: np.ndarray, *, absolute: bool, with_parameters: bool) -> ModelFit:
    """Predictions of every part by the others.

    absolute: the level counts. with_parameters: as of `rank_models`.
    """
    (found, models), views = cross_validated_predictions(scene, start, fold), len(fold)
    residual = found.residual(views, free_bias=scene.brightness == "dn")
    measured, predicted = (found.mean_by_view(values, views) for values in (found.measured, found.predicted))
    return ModelFit(
        reflectance=reflectance_of(photometry_by(scene, start, np.arange(views))) if with_parameters else start,
        without_part=models,
        prior_sigma=AdjustOptions().reflectance_sigma * np.abs(start.parameter_scale),
        predictions=found,
        residual=residual,
        pattern=np.sqrt(found.mean_by_view(residual**2, views)),
        level=predicted / measured - 1.0 if absolute else np.zeros(views),
    )
