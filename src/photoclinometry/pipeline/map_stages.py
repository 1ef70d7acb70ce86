"""The stages from the initial scene to the finished map: first estimate, relighting iterations, last estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from photoclinometry.adjust import Adjustment, Noise
from photoclinometry.evaluate.held_out import Resected, resect_views, views_in_frame_of
from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.matching.interface import Matcher
from photoclinometry.model.image import Image
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.cast_shadows import surroundings_by_shadows
from photoclinometry.photometry.point_spread import reference_psf_sigma_px
from photoclinometry.pipeline.checks.stray_normals import with_strays_fitted_again
from photoclinometry.pipeline.checks.unknown_albedos import with_neighbours_albedos
from photoclinometry.pipeline.direct_refinement import refine_directly
from photoclinometry.pipeline.first_estimate import first_estimate
from photoclinometry.pipeline.folder.run_folder import RunFolder
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.joint_estimate import EstimateSettings, JointEstimate, by_relit_matches, in_prior_frame
from photoclinometry.pipeline.options import RelightOptions
from photoclinometry.pipeline.relighting import (
    IterationFigures,
    first_map_figures,
    is_settled,
    iteration_figures,
    keypoints_moved,
    rematch,
)
from photoclinometry.pipeline.sparse_stages import PosedImages
from photoclinometry.surface.fine_relief import with_fine_relief


@dataclass(frozen=True, kw_only=True)
class IntermediateMap:
    """A map on the way to the last one."""

    scene: Scene
    number: int = 0
    """Of the relighting iteration; 0 before the first."""
    is_start_of_last: bool = False
    """Whether the last estimate is to start from this scene. Its tracks are new then, and not estimated with yet."""
    keypoints_moved_px: float | None = None
    figures: IterationFigures | None = None
    """None before the estimate."""
    noise: Noise | None = None
    """As the latest estimate has found it; None before the first."""


@dataclass(frozen=True, kw_only=True)
class FinishedMap:
    """The last estimate."""

    adjustment: Adjustment
    figures: IterationFigures
    psf_sigma_px: float | None = None
    """Of the point-spread function with which fine relief was restored; None where it was not."""


@dataclass(frozen=True, kw_only=True)
class FirstEstimate(Stage[IntermediateMap]):
    """A rough estimate, good enough to be relit."""

    name = "first_estimate"
    result = IntermediateMap
    estimate: JointEstimate
    start: Keyed[Scene]

    @property
    def file_name(self) -> str:
        return f"{self.name}{_suffix(self.estimate)}"

    def make(self, tools: Tools) -> IntermediateMap:
        found = first_estimate(
            self.start.value, partial(self.estimate, settings=EstimateSettings(rough=True), progress=tools.progress)
        )
        figures = first_map_figures(found.scene)
        say_found(_quality(figures))
        return IntermediateMap(scene=found.scene, figures=figures, noise=found.noise)


@dataclass(frozen=True, kw_only=True)
class RelightingIteration(Stage[IntermediateMap]):
    """The map matched again with the relit reference and, unless that settles it, roughly estimated again."""

    name = "relighting"
    result = IntermediateMap
    number: int
    before: Keyed[IntermediateMap]
    estimate: JointEstimate
    posed: PosedImages
    """Of which the scene has the registered views."""
    matcher: Keyed[Matcher]
    densify: DensifyOptions
    keypoint_sigma_factor: float
    settled_px: float
    must_end: bool
    """Whether no further iteration is allowed."""

    @property
    def file_name(self) -> str:
        return f"{self.name}_{self.number}{_suffix(self.estimate)}"

    def make(self, tools: Tools) -> IntermediateMap:
        number, before, noise, report = self.number, self.before.value.scene, self.before.value.noise, tools.progress
        matcher, images = self.matcher.value, self.posed.registered_images
        matched = rematch(before, images, matcher, self.densify, report, f"relight {number}")
        moved = keypoints_moved(before, matched)
        say_found(f"matches moved {moved:.2f} px")
        if self.must_end or is_settled(number, moved, self.settled_px):
            return IntermediateMap(
                scene=matched, number=number, is_start_of_last=True, keypoints_moved_px=moved, noise=noise
            )
        settings = EstimateSettings(keypoint_sigma_factor=self.keypoint_sigma_factor, rough=True, noise=noise)
        found = self.estimate(matched, settings, report)
        figures = iteration_figures(number, found.scene, before, moved)
        say_found(_quality(figures))
        return IntermediateMap(
            scene=found.scene, number=number, keypoints_moved_px=moved, figures=figures, noise=found.noise
        )


@dataclass(frozen=True, kw_only=True)
class LastEstimate(Stage[FinishedMap]):
    """The estimate of the finished map, with uncertainties: by the images directly, or by matches."""

    name = "last_estimate"
    result = FinishedMap
    estimate: JointEstimate
    """Its reflectance may be another one than that of `start`."""
    start: Keyed[IntermediateMap]
    before: Keyed[IntermediateMap] | None
    """The map that `start` was matched with, without observations; None of the first."""
    posed: PosedImages
    """Of which the scene has the registered views."""
    direct: bool
    psf_sigma_px: float | None
    """Standard deviation of the images' point-spread function; None if it is to be determined from the images."""

    @property
    def file_name(self) -> str:
        return f"{self.name}{_suffix(self.estimate)}"

    def make(self, tools: Tools) -> FinishedMap:
        start, estimate = self.start.value, partial(self.estimate, progress=tools.progress)
        scene, psf, images = self.estimate.in_own_model(start.scene, tools.progress), None, self.posed.registered_images
        if self.direct:
            psf = reference_psf_sigma_px(scene, images) if self.psf_sigma_px is None else self.psf_sigma_px
            known = self.estimate.known_views is not None
            found = refine_directly(scene, images, estimate, start.noise, poses_are_known=known)
            found = replace(found, scene=with_fine_relief(found.scene, psf))
        else:
            found = estimate(scene, by_relit_matches(start.noise))
        found = replace(found, scene=_finished(found.scene, images))
        landmarks = f"{len(found.scene.landmarks):,} landmarks in {len(found.scene.views)} views"
        say_found(landmarks if found.converged else f"{landmarks}, not converged")
        if self.before is None:
            return FinishedMap(adjustment=found, figures=first_map_figures(found.scene), psf_sigma_px=psf)
        before, moved = self.before.value.scene, start.keypoints_moved_px
        assert moved is not None
        figures = iteration_figures(start.number, found.scene, before, moved)
        return FinishedMap(adjustment=found, figures=figures, psf_sigma_px=psf)


def _finished(scene: Scene, images: Sequence[Image]) -> Scene:
    """The map with single landmarks and its surroundings mended, once all else is estimated. images: of its views."""
    scene = with_strays_fitted_again(with_neighbours_albedos(scene))
    if scene.reflectance is None:
        return scene
    return replace(scene, surroundings=surroundings_by_shadows(scene, images))


def _suffix(estimate: JointEstimate) -> str:
    """Of files: results of both kinds of estimate stand side by side."""
    return "_held" if estimate.holds_photometry else ""


def _quality(figures: IterationFigures) -> str:
    """How good the map of an iteration is, in a few words."""
    error = figures.photometric_error_mean_percent
    return f"{figures.landmarks:,} landmarks" if error is None else f"brightness within {error:.2f} %"


@dataclass(frozen=True, kw_only=True)
class PlaceHeldOutViews(Stage[Resected]):
    """Poses of the views that were held out, from their matches with the finished map."""

    name = "held_out"
    result = Resected
    finished: Keyed[FinishedMap]
    posed: PosedImages
    """With the views that are held out."""
    held_out: np.ndarray
    """(H,) int: which of all views."""
    matcher: Keyed[Matcher]

    def make(self, tools: Tools) -> Resected:
        scene, images, views = self.finished.value.adjustment.scene, self.posed.inputs.value.images, self.posed.views
        if in_prior_frame(scene):
            views = views_in_frame_of(scene, views)
        return resect_views(scene, views, self.held_out, images, self.matcher.value)


@dataclass(frozen=True, kw_only=True)
class Relit:
    """Where relighting iterations end."""

    start: Keyed[IntermediateMap]
    """Of the last estimate."""
    before: Keyed[IntermediateMap] | None = None
    """The map that it was matched with, without observations; None where there were no iterations."""
    figures: tuple[IterationFigures, ...] = ()
    """Of all maps before the last estimate."""


@dataclass(frozen=True, kw_only=True)
class MapStages:
    """The stages from the initial scene to the finished map, in order: `first_map`, `relight`, `last_estimate`."""

    folder: RunFolder
    estimate: JointEstimate
    posed: PosedImages
    matcher: Keyed[Matcher]
    """Of the relighting iterations."""
    densify: DensifyOptions
    options: RelightOptions
    max_iterations: int

    def first_map(self, scene: Keyed[Scene]) -> Keyed[IntermediateMap]:
        """A rough estimate, to be relit; the scene as it is, where it is not."""
        if not self.max_iterations:
            return Keyed(IntermediateMap(scene=scene.value, is_start_of_last=True), scene.key)
        return self.folder.result_of(FirstEstimate(estimate=self.estimate, start=scene))

    def relight(self, first: Keyed[IntermediateMap]) -> Relit:
        """Relighting iterations, until the matches stay where they are."""
        before, latest, figures = None, first, []
        del first  # of all maps, the latest two are held in memory
        while not latest.value.is_start_of_last:
            figures.append(latest.value.figures)
            before = latest
            latest = self.folder.result_of(self._iteration_after(before))
        if before is not None:  # the last estimate compares with its normals alone
            before = Keyed(replace(before.value, scene=before.value.scene.without_observations()), before.key)
        return Relit(start=latest, before=before, figures=tuple(figures))

    def last_estimate(self, relit: Relit, reflectance: Reflectance | None) -> Keyed[FinishedMap]:
        """The estimate of the finished map, with a reflectance model of its own."""
        direct = self.options.direct and relit.before is not None
        stage = LastEstimate(
            estimate=replace(self.estimate, reflectance=reflectance),
            start=relit.start,
            before=relit.before,
            posed=self.posed,
            direct=direct,
            psf_sigma_px=self.options.psf_sigma_px,
        )
        return self.folder.result_of(stage)

    def _iteration_after(self, before: Keyed[IntermediateMap]) -> RelightingIteration:
        number = before.value.number + 1
        return RelightingIteration(
            number=number,
            before=before,
            estimate=self.estimate,
            posed=self.posed,
            matcher=self.matcher,
            densify=self.densify,
            keypoint_sigma_factor=self.options.keypoint_sigma_factor,
            settled_px=self.options.settled_px,
            must_end=number == self.max_iterations,
        )
