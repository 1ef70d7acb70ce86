"""The map of a place, checked against the parallax of its images, and made once more where it contradicts that."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.dense_stages import InitialScene, MatchDensely, tie_points_from
from photoclinometry.pipeline.joint_estimate import JointEstimate
from photoclinometry.pipeline.map_stages import FinishedMap, MapStages
from photoclinometry.pipeline.model_choice import ChooseModel
from photoclinometry.pipeline.pose_priors import usable_priors
from photoclinometry.pipeline.posed_site import PosedSite
from photoclinometry.pipeline.relief_check import ReliefCheck, relief_by_parallax
from photoclinometry.pipeline.relighting import IterationFigures
from photoclinometry.pipeline.run_folder import RunFolder
from photoclinometry.pipeline.sparse_stages import PosedImages
from photoclinometry.pipeline.stage import Keyed

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CheckedMap:
    """A finished map and what is known of how it was made."""

    finished: Keyed[FinishedMap]
    iterations: tuple[IterationFigures, ...]
    """Of all maps, the finished one included."""
    pose_priors: Mapping[str, PosePrior]
    """Those that determine its frame; none where they do not."""
    relief: ReliefCheck | None

    @property
    def contradicts_parallax(self) -> bool:
        return self.relief is not None and self.relief.is_off()


def checked_map(folder: RunFolder, posed_site: PosedSite, used: PosedImages, dense: MatchDensely) -> CheckedMap:
    """All stages from dense matching to the finished map.

    A map whose relief contradicts the parallax is made a second time with Suns, biases and reflectance held at what is
    known of them, and the one that is nearer to the parallax is returned. used: the views to map with.
    """
    made = partial(_mapped, folder, posed_site, used, dense)
    found = made(holds_photometry=False)
    if posed_site.choices.reflectance is None or not found.contradicts_parallax:
        return found
    assert found.relief is not None
    log.info("the relief is %.2f of the parallax's: once more, with photometry held", found.relief.ratio)
    held = made(holds_photometry=True)
    if held.relief is None or abs(held.relief.ratio - 1.0) >= abs(found.relief.ratio - 1.0):
        return found
    warn(
        log, "photometry-held",
        "Suns, biases and reflectance are held at what is stated of them: estimated along, they gave %.2f of the "
        "relief that the parallax of the images shows, held %.2f. Their sigmas, and those of albedos, are too small",
        found.relief.ratio, held.relief.ratio,
    )  # fmt: skip
    return held


def _mapped(
    folder: RunFolder, posed_site: PosedSite, used: PosedImages, dense: MatchDensely, *, holds_photometry: bool
) -> CheckedMap:
    choices, options = posed_site.choices, posed_site.options
    tracks = folder.done(dense)
    scene = folder.done(InitialScene(posed=used, place=dense.place, dense=tracks, reflectance=choices.reflectance))
    matched = tracks.value.position, tracks.value.pixel
    priors = usable_priors(posed_site.site.pose_priors, scene.value) if options.pose_priors else {}
    maps = MapStages(
        folder=folder,
        estimate=JointEstimate(
            options=options.adjust,
            reflectance=choices.reflectance,
            tie_points=tie_points_from(used),
            sparse_views=posed_site.posed.views,
            pose_priors=priors,
            known_views=posed_site.known_views,
            control=choices.control,
            holds_photometry=holds_photometry,
        ),
        posed=used,
        matcher=choices.relit_matcher,
        densify=dense.densify,
        options=options.relight,
        max_iterations=choices.max_iterations,
    )
    first = maps.first_map(scene)
    del tracks, scene  # of all maps, the latest two are held in memory
    relit = maps.relight(first)
    del first
    model = choices.reflectance
    if model is not None and choices.candidates and not holds_photometry:
        stage = ChooseModel(relit=relit.start, known=model, candidates=choices.candidates)
        model = folder.done(stage).value.reflectance
    finished = maps.last_estimate(relit, model)
    return CheckedMap(
        finished=finished,
        iterations=(*relit.figures, finished.value.figures),
        pose_priors=priors,
        relief=relief_by_parallax(finished.value.adjustment.scene, *matched),
    )
