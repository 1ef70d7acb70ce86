"""Cross-validation: the brightness of views that were kept out, as the other views predict it.

Residuals of the fitted views say little about a model, since normals and albedos are free at every landmark. A view
that was kept out has no free parameters but its exposure, so that its brightness tests the model that was fitted to the
others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.special import stdtrit

from photoclinometry.adjust import AdjustOptions, adjust
from photoclinometry.adjust.graph.sun_directions import common_turns
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import angle_between, so3_exp
from photoclinometry.model.reflectance import GRAZING, Reflectance
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.albedo import with_model
from photoclinometry.photometry.predict import phase_of_views, reflectance_of, shading

FEWEST_LIT = 5
"""Fewest lit views of a landmark that is used: one more than its unknowns (two of the normal, the albedo), and one that
is kept out."""

FEWEST_LANDMARKS = 50
"""Fewest landmarks for a comparison."""

HELD_GSD = 1e-3
"""Standard deviation of the positions, which are held [GSD]."""

REWEIGHTINGS = 2
"""Reweightings of each estimate. Four rank the models of four sites alike, and take twice as long."""

CONFIDENCE = 0.975
"""Confidence level at which errors of views count as larger than others."""

FOLDS = 5
"""Number of parts of the views; each part is kept out once."""


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

        The exposure of each view is fitted to it, a factor and a bias if that is free, so that models with and without
        a phase function can be compared.
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


def sample_of(scene: Scene, count: int) -> Scene:
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


def folds_of_views(scene: Scene, count: int) -> np.ndarray:
    """(K,) int: which part each view is in. Dealt out by phase, so that each part has the whole range."""
    fold = np.empty(len(scene.views), int)
    fold[np.argsort(phase_of_views(scene), kind="stable")] = np.arange(len(fold)) % count
    return fold


def photometry_by(scene: Scene, start: Reflectance, used: np.ndarray) -> Scene:
    """Some of the views with their photometry by the joint estimate."""
    part = with_model(scene.of_views(used), start)
    options = AdjustOptions(
        smooth_sigma_rad=0.0, position_sigma_gsd=HELD_GSD, uncertainty=False, max_reweightings=REWEIGHTINGS
    )
    return adjust(part, replace(options, solver=options.solver.roughly())).scene


def predicted_by(found: Scene, scene: Scene, kept_out: np.ndarray) -> Predictions:
    """The brightness of views kept out, predicted from the others."""
    landmarks, model, tracks = found.landmarks, reflectance_of(found), scene.tracks
    turned = so3_exp(common_turns(found.views, scene.views.arc)) @ scene.views.sun_measured[..., None]
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


def cross_validated_predictions(
    scene: Scene, start: Reflectance, part: np.ndarray
) -> tuple[Predictions, tuple[Reflectance, ...]]:
    """The brightness of every part (K,) of the views by the other parts, and the reflectance that these have."""
    parts, models = [], []
    for number in range(part.max() + 1):
        others = photometry_by(scene, start, np.flatnonzero(part != number))
        models.append(reflectance_of(others))
        parts.append(predicted_by(others, scene, np.flatnonzero(part == number)))
    return Predictions.joined(parts), tuple(models)


def is_larger(error: np.ndarray, other: np.ndarray, confidence: float = CONFIDENCE) -> bool:
    """Whether errors (K,) of views are larger than others of the same views, by Student's t of their logarithms.

    Views are paired: a view that is hard to predict is so for every model.
    """
    ratio = np.log(error / other)
    known = ratio[np.isfinite(ratio)]
    if len(known) < 2:
        return False
    limit = float(stdtrit(len(known) - 1, confidence))
    return float(known.mean()) > limit * float(known.std(ddof=1)) / math.sqrt(len(known))
