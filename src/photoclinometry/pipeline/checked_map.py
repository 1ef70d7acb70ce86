"""The map of a place, checked against the parallax of its images, and made once more where it contradicts that."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.photometry.inconsistent_views import warn_undecided
from photoclinometry.pipeline.checks.blurred_views import views_to_leave_out, why_left_out
from photoclinometry.pipeline.checks.relief_check import ReliefCheck, relief_by_parallax
from photoclinometry.pipeline.choices import Choices
from photoclinometry.pipeline.common_sun_error import CheckSuns
from photoclinometry.pipeline.dense_stages import InitialScene, MatchDensely, tie_points_from
from photoclinometry.pipeline.doubtful_suns import CheckDoubtfulSuns
from photoclinometry.pipeline.folder.run_folder import RunFolder
from photoclinometry.pipeline.folder.stage import Keyed, digest
from photoclinometry.pipeline.frame.pose_priors import usable_priors
from photoclinometry.pipeline.joint_estimate import JointEstimate
from photoclinometry.pipeline.map_stages import FinishedMap, IntermediateMap, MapStages, Relit
from photoclinometry.pipeline.model_choice import ChooseModel
from photoclinometry.pipeline.posed_site import PosedSite
from photoclinometry.pipeline.relighting import IterationFigures
from photoclinometry.pipeline.response_check import CheckResponse, ResponseCheck, response_models
from photoclinometry.pipeline.sparse_stages import ChosenViews, PosedImages

log = logging.getLogger(__name__)

NOT_OF_ONE_MAP = ("file-damaged", "response-not-linear", "sun-undecided")
"""Codes of warnings about files, images and stated Suns: they stay when the map that revealed them is discarded."""


@dataclass(frozen=True, kw_only=True)
class CheckedMap:
    """A finished map and what is known of how it was made."""

    finished: Keyed[FinishedMap]
    iterations: tuple[IterationFigures, ...]
    """Of all maps, the finished one included."""
    pose_priors: Mapping[str, PosePrior]
    """The pose priors that determine its frame; none where they do not determine one."""
    relief: ReliefCheck | None
    left_out: Mapping[str, str]
    """Views that the first estimate found to blur the map, by name, with the reason."""
    response: ResponseCheck | None
    """Whether images are linear, as the map with estimated photometry shows; None where photometry is not estimated."""

    @property
    def contradicts_parallax(self) -> bool:
        return self.relief is not None and self.relief.is_off()


def checked_map(folder: RunFolder, posed_site: PosedSite, chosen: ChosenViews, dense: MatchDensely) -> CheckedMap:
    """All stages from dense matching to the finished map.

    A map whose relief contradicts the parallax is made a second time with Suns, biases and reflectance held at what is
    known of them. The map that is nearer to the parallax is returned. Warnings of the other are taken back.
    chosen: the views to map with.
    """
    made = partial(_mapped, folder, posed_site, chosen, dense)
    before = len(folder.warned)
    found = made(holds_photometry=False)
    if posed_site.choices.reflectance is None or not found.contradicts_parallax:
        return found
    assert found.relief is not None
    log.info("the relief is %.2f of the parallax's: once more, with photometry held", found.relief.ratio)
    between = len(folder.warned)
    held = made(holds_photometry=True)
    if held.relief is None or abs(held.relief.ratio - 1.0) >= abs(found.relief.ratio - 1.0):
        folder.withdraw(between, len(folder.warned), NOT_OF_ONE_MAP)
        return found
    withdrawn = folder.withdraw(before, between, NOT_OF_ONE_MAP)
    moved = [warned.view for warned in withdrawn if warned.code == "suns-moved" and warned.view in chosen.doubtful]
    if moved:  # the sparse points contradict these Suns, at which the returned map holds
        warn_undecided(moved, len(held.finished.value.adjustment.scene.views))
    warn(
        log, "photometry-held",
        "Suns, biases and reflectance are held at what is stated of them: estimated along, they gave %.2f of the "
        "relief that the parallax of the images shows, held %.2f. Their sigmas, and those of albedos, are too small",
        found.relief.ratio, held.relief.ratio,
    )  # fmt: skip
    return replace(held, response=found.response)  # like its warning, it is about the images


def _mapped(
    folder: RunFolder, posed_site: PosedSite, chosen: ChosenViews, dense: MatchDensely, *, holds_photometry: bool
) -> CheckedMap:
    choices, used = posed_site.choices, chosen.used
    tracks = folder.result_of(dense)
    scene = folder.result_of(InitialScene(posed=used, place=dense.place, dense=tracks, reflectance=choices.reflectance))
    matched = tracks.value.position, tracks.value.pixel
    maps = _stages(folder, posed_site, used, dense, scene.value, holds_photometry=holds_photometry)
    first = maps.first_map(scene)
    del tracks, scene  # of all maps, the latest two are held in memory
    left_out = _blurred(first.value, posed_site, maps.estimate.pose_priors)
    if left_out:
        used, first = _without(used, first, left_out)
        maps = _stages(folder, posed_site, used, dense, first.value.scene, holds_photometry=holds_photometry)
    relit = maps.relight(first)
    del first
    model = _last_model(folder, choices, relit, holds_photometry=holds_photometry)
    response = None
    if model is not None and not holds_photometry:
        relit, model, response = _with_photometry_checked(folder, posed_site, relit, model, chosen.doubtful)
    finished = maps.last_estimate(relit, model)
    return CheckedMap(
        finished=finished,
        iterations=(*relit.figures, finished.value.figures),
        pose_priors=maps.estimate.pose_priors,
        relief=relief_by_parallax(finished.value.adjustment.scene, *matched),
        left_out=left_out,
        response=response,
    )


def _with_photometry_checked(
    folder: RunFolder, posed_site: PosedSite, relit: Relit, model: Reflectance, doubtful: Sequence[str]
) -> tuple[Relit, Reflectance, ResponseCheck]:
    """The start and the model of the last estimate, after checks of doubtful Suns, given by name, and of errors that
    all views have in common."""
    if doubtful:
        own = folder.result_of(CheckDoubtfulSuns(relit=relit.start, reflectance=model, doubtful=doubtful)).value
        if own.wrong.any():
            relit = _with_scene(relit, own.taken_into_account(relit.start.value.scene))
    suns = folder.result_of(CheckSuns(relit=relit.start, reflectance=model)).value
    if suns.is_clear:
        relit = _with_scene(relit, suns.taken_into_account(relit.start.value.scene))
        model = _last_model(folder, posed_site.choices, relit, holds_photometry=False, again=True) or model
    models = response_models(relit.start.value.scene, model)
    stated = tuple(sorted({view.gamma for view in posed_site.site.views}))
    response = folder.result_of(CheckResponse(relit=relit.start, models=models, stated=stated)).value
    return relit, model, response


def _with_scene(relit: Relit, scene: Scene) -> Relit:
    """With another scene to start the last estimate from."""
    views = scene.views
    key = digest(relit.start, views.sun, views.sun_sigma, views.sun_common_sigma)
    return replace(relit, start=Keyed(replace(relit.start.value, scene=scene), key))


def _last_model(
    folder: RunFolder, choices: Choices, relit: Relit, *, holds_photometry: bool, again: bool = False
) -> Reflectance | None:
    """The reflectance model of the last estimate: given, chosen for the map, or that of the estimates before.

    A model is chosen with Suns and parameters free, and therefore not where photometry is held. again: see
    `ChooseModel`.
    """
    known = choices.reflectance
    if known is None or not choices.candidates or holds_photometry:
        return choices.last_reflectance or known
    stage = ChooseModel(relit=relit.start, known=known, candidates=choices.candidates, again=again)
    return folder.result_of(stage).value.reflectance


def _stages(
    folder: RunFolder,
    posed_site: PosedSite,
    used: PosedImages,
    dense: MatchDensely,
    scene: Scene,
    *,
    holds_photometry: bool,
) -> MapStages:
    """The stages from a scene of the used views to the finished map."""
    choices, options = posed_site.choices, posed_site.options
    return MapStages(
        folder=folder,
        estimate=JointEstimate(
            options=options.adjust,
            reflectance=choices.reflectance,
            tie_points=tie_points_from(used),
            sparse_views=posed_site.posed.views,
            pose_priors=usable_priors(posed_site.site.pose_priors, scene) if options.pose_priors else {},
            known_views=posed_site.known_views,
            control=choices.control,
            altimetry=choices.altimetry,
            holds_photometry=holds_photometry,
        ),
        posed=used,
        matcher=choices.relit_matcher,
        densify=dense.densify,
        options=options.relight,
        max_iterations=choices.max_iterations,
    )


def _blurred(first: IntermediateMap, posed_site: PosedSite, priors: Mapping[str, PosePrior]) -> dict[str, str]:
    """Views that blur the first map, by name, with the reason; a warning of each. priors: those that are used."""
    if first.is_start_of_last or not posed_site.options.check_views:
        return {}
    fewest = posed_site.options.densify.views_needed(len(first.scene.views))
    has_prior = np.array([name in priors for name in first.scene.views.name])
    found = views_to_leave_out(first.scene, fewest, has_prior)
    reasons = {first.scene.views.name[k]: why_left_out(blur) for k, blur in found.items()}
    for name, reason in reasons.items():
        warn(log, "view-blurred", "%s is left out: %s", name, reason, view=name)
    return reasons


def _without(
    used: PosedImages, first: Keyed[IntermediateMap], names: Mapping[str, str]
) -> tuple[PosedImages, Keyed[IntermediateMap]]:
    """Images and first map without some of the views."""
    left_out = np.array([name in names for name in used.views.name])
    scene = first.value.scene
    kept = np.array([k for k, name in enumerate(scene.views.name) if name not in names])
    return used.without(left_out), Keyed(replace(first.value, scene=scene.of_views(kept)), digest(first, kept))
