"""The reflectance model of a map, chosen by how well models predict views that were kept out (`--reflectance auto`)."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from photoclinometry.evaluate.cross_validation import is_larger
from photoclinometry.evaluate.model_ranking import ModelFit, RankingOptions, rank_models
from photoclinometry.model.errors import InputError
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.reflectance import Reflectance, starting_model
from photoclinometry.model.scene import Scene
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.map_stages import IntermediateMap

log = logging.getLogger(__name__)

CROSS_VALIDATION_LANDMARKS = 400
"""Landmarks that take part in a choice. 1500 rank the models of three sites alike, and take more than twice as long."""


ONE_ERROR = 0.84
"""Probability within one standard error, one-sided: the model of a map is kept unless the best one is better by more
than that (Breiman et al. 1984, Classification and Regression Trees). If two differ by less, either will do."""


@dataclass(frozen=True, kw_only=True)
class ChosenModel:
    """The model to finish a map with."""

    reflectance: Reflectance
    """As it is known beforehand."""


@dataclass(frozen=True, kw_only=True)
class ChooseModel(Stage[ChosenModel]):
    """The best of several models for a relit map; the present one where no other is significantly better.

    Only the last estimate gains from a better model. Earlier stages serve the matches, which hardly depend on it.
    """

    name = "reflectance"
    result = ChosenModel
    relit: Keyed[IntermediateMap]
    known: Reflectance
    """The model of the map, as it is known beforehand."""
    candidates: tuple[str, ...]
    """Names of models, that of the map among them."""
    again: bool = False
    """Whether this is the second choice, as Suns were found to be off in between."""

    @property
    def file_name(self) -> str:
        return f"{self.name}_again" if self.again else self.name

    def make(self, tools: Tools) -> ChosenModel:
        found, why = model_by_cross_validation(self.relit.value.scene, self.known, self.candidates, tools.progress)
        say_found(why)
        return ChosenModel(reflectance=found)


def model_by_cross_validation(
    scene: Scene, known: Reflectance, candidates: tuple[str, ...], progress: Progress = no_progress
) -> tuple[Reflectance, str]:
    """The model of `candidates` to finish a scene with, as it is known beforehand, and the reason in a few words.

    Of the models that predict the pattern within views best, it is the one of the least error, level included. It is
    `known`, the scene's own as it is known beforehand, where no other is significantly better or nothing is compared.
    """
    try:
        options = RankingOptions(models=candidates, landmarks=CROSS_VALIDATION_LANDMARKS)
        ranking = rank_models(scene, options, progress, with_parameters=False)
    except InputError as error:
        log.info("reflectance models are not compared: %s", error)
        return known, f"{known.name}, models are not compared"
    of_best_pattern = ranking.of_best_pattern(ONE_ERROR)
    best = of_best_pattern[0]
    own = next(fit for fit in ranking.fits if fit.reflectance.name == known.name)
    if own is best:
        return known, _missed_by(best)
    if any(fit is own for fit in of_best_pattern) and not is_larger(own.error, best.error, ONE_ERROR):
        return known, f"{_missed_by(own)}, {_missed_by(best)}"
    return starting_model(best.reflectance.name, scene.body), f"{_missed_by(best)}, {_missed_by(own)}"


def _missed_by(fit: ModelFit) -> str:
    """A model's errors in words; both where the level of views counts."""
    level = f" ({fit.pattern_percent:.2f} % within views)" if fit.level.any() else ""
    return f"{fit.reflectance.name} misses {fit.error_percent:.2f} %{level}"
