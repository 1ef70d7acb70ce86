"""Which reflectance model fits a map: each is fitted to most of its views, and judged by the views that were kept out.

Residuals of views that a model was fitted to say little: normals and albedos are free at every landmark. A view that
took no part has nothing of its own but its exposure, so that its brightness tests the model and its parameters.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated

import numpy as np
from scipy.special import stdtrit

from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.adjust.graph.sun_directions import common_turn
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import angle_between, so3_exp
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.reflectance import GRAZING, MODELS, Reflectance, model_named, models_for, starting_model
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.albedo import with_model
from photoclinometry.photometry.predict import exposure_is_free, phase_of_views, reflectance_of, shading

log = logging.getLogger(__name__)

FEWEST_LIT = 5
"""Lit views of a landmark that takes part: one more than it has unknowns (two of the normal, the albedo), and one that
is kept out."""

FEWEST_LANDMARKS = 50
"""Landmarks without which nothing is said."""

HELD_GSD = 1e-3
"""Standard deviation of the positions, which are held [GSD]."""

REWEIGHTINGS = 2
"""Reweightings of each estimate. Four rank the models of four sites alike, and take twice as long."""

CONFIDENCE = 0.975
"""A model is told from the best one if it predicts worse with this probability."""

FREE_SUNS_RAD = math.radians(3.0)
"""Standard deviation of an error that all Suns have in common, where it is to be found [rad]."""

UNDETERMINED = 0.7
"""Share of its prior's standard deviation that a parameter keeps which the images hardly determine: they then know less
of it than the prior does."""


@dataclass(frozen=True, kw_only=True)
class RankingOptions(Ranged):
    """How reflectance models are compared."""

    models: tuple[str, ...] = ()
    """Names of the models; none for all that have values for the body, or need none."""
    landmarks: Annotated[int, Range(least=FEWEST_LANDMARKS, most=1_000_000)] = 1500
    """Landmarks that take part, about: of every so many rows and columns of the map."""
    folds: Annotated[int, Range(least=2, most=100)] = 5
    """Parts of the views, of which each is kept out once."""


@dataclass(frozen=True, kw_only=True)
class Predictions:
    """N brightnesses of views that were kept out, as the other views predict them."""

    view: np.ndarray
    """(N,) index."""
    measured: np.ndarray
    """(N,)"""
    predicted: np.ndarray
    """(N,)"""
    angles_deg: np.ndarray
    """(N, 3) incidence, emission and phase [degrees]."""

    @classmethod
    def joined(cls, parts: Sequence[Predictions]) -> Predictions:
        """Of several parts of the views."""
        return cls(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)})

    def residual(self, views: int, *, free_bias: bool) -> np.ndarray:
        """(N,) predicted minus measured brightness over the mean brightness of its view [-].

        The exposure of each view is fitted to it, so that models with and without a phase function compare: a factor,
        and a bias if that is free.
        """
        exposed = self.predicted.copy()
        for k in range(views):
            mine = self.view == k
            if mine.any():
                columns = np.stack([self.predicted[mine], np.full(mine.sum(), float(free_bias))], -1)
                exposed[mine] = columns @ np.linalg.lstsq(columns, self.measured[mine], rcond=None)[0]
        return (exposed - self.measured) / self.mean_by_view(self.measured, views)[self.view]

    def mean_by_view(self, values: np.ndarray, views: int) -> np.ndarray:
        """(K,) means of values (N,); NaN of views without any."""
        number = np.bincount(self.view, minlength=views)
        mean = np.bincount(self.view, values, views) / np.maximum(number, 1)
        return np.where(number > 0, mean, np.nan)


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
    """(K,) how much brighter a view is predicted to be than it is [-]; 0 where that is not compared."""

    @property
    def error(self) -> np.ndarray:
        """(K,) of pattern and level together [-]."""
        return np.hypot(self.pattern, self.level)

    @property
    def error_percent(self) -> float:
        """Geometric mean of `error`: views differ in how hard they are to predict, and each counts alike."""
        return 100.0 * float(np.exp(np.nanmean(np.log(self.error))))

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
    """By name of model, why it was not fitted."""
    views: tuple[str, ...]
    """(K,) names, as `ModelFit.error` has them."""

    @property
    def best(self) -> ModelFit:
        return self.fits[0]

    def is_as_good(self, fit: ModelFit, confidence: float = CONFIDENCE) -> bool:
        """Whether kept-out views cannot tell a fit from the best, neither by their patterns nor by all errors."""
        pairs = ((fit.error, self.best.error), (fit.pattern, self.best.pattern))
        return fit is self.best or not any(is_larger(mine, best, confidence) for mine, best in pairs)


def is_larger(error: np.ndarray, other: np.ndarray, confidence: float = CONFIDENCE) -> bool:
    """Whether errors (K,) of views are larger than others of the same views, by Student's t of their logarithms.

    Views are paired: what is hard to predict in one is so for every model.
    """
    ratio = np.log(error / other)
    known = ratio[np.isfinite(ratio)]
    if len(known) < 2:
        return False
    limit = float(stdtrit(len(known) - 1, confidence))
    return float(known.mean()) > limit * float(known.std(ddof=1)) / math.sqrt(len(known))


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
    The brightness of the part is then predicted under its measured Suns, turned by the error that all Suns have in
    common. A factor on each view's brightness is fitted then; it counts as an error, too, unless a model, or
    uncalibrated images, leave it open. with_parameters: the parameters of each model are estimated from all views, too;
    the order of the models does not depend on it. Raises InputError for scenes without a reflectance model (brightness
    was not measured), of too few views or lit landmarks, and for unknown models.
    """
    options = options or RankingOptions()
    reflectance_of(scene)
    sample = _sample(scene, options.landmarks)
    names, left_out = _usable_models(options.models, scene)
    absolute = all(not exposure_is_free(scene.brightness, starting_model(name, scene.body)) for name in names)
    fold = _folds(sample, min(options.folds, len(scene.views)))
    fits = []
    for number, name in enumerate(names):
        progress("models", number, len(names))
        start = starting_model(name, scene.body)
        fits.append(_fit(sample, start, fold, absolute=absolute, with_parameters=with_parameters))
        log.info("%s: %.3f %% on views kept out", name, fits[-1].error_percent)
    progress("models", len(names), len(names))
    fits.sort(key=lambda fit: fit.error_percent)
    return ModelRanking(fits=tuple(fits), left_out=left_out, views=scene.views.name)


def common_sun_turn(scene: Scene, reflectance: Reflectance, landmarks: int) -> tuple[np.ndarray, np.ndarray]:
    """The rotation vector (3,) in C by which all measured Suns are off alike as brightness tells it, and its standard
    deviations (3,) by leaving parts of the views out [rad].

    Some landmarks, about so many, take part, at the scene's positions, without smoothness between neighbours.
    reflectance: as it is known beforehand. Raises InputError as `rank_models` does.
    """
    sample = _sample(scene, landmarks)
    views = sample.views
    free = replace(sample, views=replace(views, sun_common_sigma=np.full(len(views), FREE_SUNS_RAD)))
    fold = _folds(free, min(RankingOptions().folds, len(views)))
    parts = [_estimated(free, reflectance, np.flatnonzero(fold != part)) for part in range(fold.max() + 1)]
    turn = common_turn(_estimated(free, reflectance, np.arange(len(views))).views)
    return turn, jackknife_sigma(np.array([common_turn(part.views) for part in parts]))


def _sample(scene: Scene, count: int) -> Scene:
    """The scene with some of its landmarks, lit in enough views, as before any estimate: Suns are the measured ones."""
    tracks = scene.tracks
    lit = np.bincount(tracks.landmark[tracks.lit], minlength=len(scene.landmarks))
    able = np.flatnonzero(lit >= FEWEST_LIT)
    if len(able) < FEWEST_LANDMARKS:
        raise InputError(
            f"scene {scene.name!r}: {len(able)} landmarks are lit in {FEWEST_LIT} views or more, "
            f"{FEWEST_LANDMARKS} are needed to compare reflectance models"
        )
    row, col = (cell[able] for cell in scene.cells)
    step = 1
    while np.count_nonzero((row % (step + 1) == 0) & (col % (step + 1) == 0)) >= count:
        step += 1
    part = replace(scene, landmarks=scene.landmarks[able], tracks=tracks.of_landmarks(able)[0]).of_every(step)
    return replace(part, views=scene.views.at_poses(scene.views.body_from_cam))


def _usable_models(asked: Sequence[str], scene: Scene) -> tuple[tuple[str, ...], dict[str, str]]:
    """Those asked for, or all that compare; and why others are left out. Raises InputError."""
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


def _folds(scene: Scene, count: int) -> np.ndarray:
    """(K,) int: which part each view is in. Dealt out by phase, so that each part has the whole range."""
    fold = np.empty(len(scene.views), int)
    fold[np.argsort(phase_of_views(scene), kind="stable")] = np.arange(len(fold)) % count
    return fold


def _fit(scene: Scene, start: Reflectance, fold: np.ndarray, *, absolute: bool, with_parameters: bool) -> ModelFit:
    """Predictions of every part by the others.

    absolute: the level counts. with_parameters: as of `rank_models`.
    """
    parts, models = [], []
    for part in range(fold.max() + 1):
        others = _estimated(scene, start, np.flatnonzero(fold != part))
        models.append(reflectance_of(others))
        parts.append(_predicted(scene, others, np.flatnonzero(fold == part)))
    found, views = Predictions.joined(parts), len(fold)
    residual = found.residual(views, free_bias=scene.brightness == "dn")
    measured, predicted = (found.mean_by_view(values, views) for values in (found.measured, found.predicted))
    return ModelFit(
        reflectance=reflectance_of(_estimated(scene, start, np.arange(views))) if with_parameters else start,
        without_part=tuple(models),
        prior_sigma=AdjustOptions().reflectance_sigma * np.abs(start.parameter_scale),
        predictions=found,
        residual=residual,
        pattern=np.sqrt(found.mean_by_view(residual**2, views)),
        level=predicted / measured - 1.0 if absolute else np.zeros(views),
    )


def jackknife_sigma(values: np.ndarray) -> np.ndarray:
    """(...,) standard deviations from estimates (n, ...) that lack one of n parts of the data each (Efron and Stein
    1981, doi:10.1214/aos/1176345462)."""
    count = len(values)
    return np.sqrt((count - 1) / count * np.sum((values - values.mean(0)) ** 2, axis=0))


def _estimated(scene: Scene, start: Reflectance, used: np.ndarray) -> Scene:
    """Some of the views with their photometry by the joint estimate."""
    part = with_model(scene.of_views(used), start)
    options = AdjustOptions(
        smooth_sigma_rad=0.0, position_sigma_gsd=HELD_GSD, uncertainty=False, max_reweightings=REWEIGHTINGS
    )
    return adjust(part, replace(options, solver=options.solver.roughly())).scene


def _predicted(scene: Scene, found: Scene, kept_out: np.ndarray) -> Predictions:
    """The brightness of views kept out, by what the others tell."""
    landmarks, model, tracks = found.landmarks, reflectance_of(found), scene.tracks
    turned = so3_exp(common_turn(found.views)) @ scene.views.sun_measured[..., None]
    sun = (scene.views.body_from_cam.rotation @ turned)[..., 0]
    views = replace(scene.views, sun=sun)
    at = np.flatnonzero(np.isin(tracks.view, kept_out) & tracks.lit)
    landmark, view = tracks.landmark[at], tracks.view[at]
    mu0, mu, rho = shading(landmark, view, views, landmarks.position, landmarks.normal, model)
    used = (mu0 > GRAZING) & (mu > GRAZING)
    at, landmark, view, mu0, mu, rho = (each[used] for each in (at, landmark, view, mu0, mu, rho))
    measured, predicted = tracks.brightness[at], landmarks.albedo[landmark] * rho
    to_camera = views.body_from_cam.translation[view] - landmarks.position[landmark]
    cosines = np.degrees(np.arccos(np.minimum([mu0, mu], 1.0)))
    phase = np.degrees(angle_between(sun[view], to_camera))
    return Predictions(view=view, measured=measured, predicted=predicted, angles_deg=np.stack([*cosines, phase], -1))
