"""The representative map: what a run would state of a small map of the assumed ground, by the run's own stages.

Images of the ground are drawn in the planned views. The map starts at the truth: structure from motion and the first
matches are left out. From there on it is a run: views are matched with the relit reference, and the last estimate
measures its noise and states its uncertainties. So every source of noise that a run has is there, at its own size: the
detector, pixels and optics, relief between pixels, shadows, matches, and what the reflectance model misses of the
ground's.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from photoclinometry.adjust import Adjustment, ImageGradients, Noise, PosePriors, ScenePriors, TiePoints
from photoclinometry.adjust.stated_uncertainty import uncertainty_at
from photoclinometry.evaluate.sigmas import landmark_sigmas
from photoclinometry.matching.interface import Matcher
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.image import Image
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import BODY_FIXED, Scene, Views
from photoclinometry.photometry.predict import observation_brightness
from photoclinometry.photometry.shading import brightness_on_surface
from photoclinometry.pipeline.choices import candidate_models, choose_reflectance, keyed_matcher
from photoclinometry.pipeline.direct_refinement import MIN_SHARE, image_gradients, refine_directly
from photoclinometry.pipeline.frame.pose_priors import priors_of_views
from photoclinometry.pipeline.joint_estimate import JointEstimate
from photoclinometry.pipeline.model_choice import model_by_cross_validation
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.relighting import rematch
from photoclinometry.plan.assumed_ground import AssumedGround, assumed_ground, scene_at_truth
from photoclinometry.plan.exposures import cropped_views
from photoclinometry.plan.options import PlanOptions
from photoclinometry.plan.place import PlannedViews
from photoclinometry.plan.tie_points import expected_tie_points
from photoclinometry.registration.georeference import MIN_PRIORS
from photoclinometry.surface.fine_relief import with_fine_relief

log = logging.getLogger(__name__)

KINDS = {"height": "height_sigma_gsd", "normal": "normal_sigma_deg", "albedo": "albedo_sigma_percent"}
"""The sigmas of a plan, as `landmark_sigmas` names them."""

LEAST_LIT = 3.5
"""Mean number of lit views per landmark: three brightnesses are fitted exactly by a normal and an albedo, so that a run
measures no noise and states sigmas of nothing."""

TIE_POINT_RELIEF = 0.02
"""Standard deviation of the tie points' heights, as a share of the reference image's width on the ground: relief over
an image is some hundredths of its width."""


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """The representative map and what it was made with."""

    adjustment: Adjustment
    """As a run would have made it, with the uncertainties that it would state: in a frame of its own."""
    ground: AssumedGround
    images: tuple[Image, ...]
    run: RunOptions
    reflectance: Reflectance
    tie_points: TiePoints | None
    shown: np.ndarray
    """(K,) bool: planned views whose images show the map."""
    pose_priors: PosePriors | None
    """None where there are fewer than three."""

    @property
    def scene(self) -> Scene:
        return self.adjustment.scene

    @property
    def direct(self) -> bool:
        """Whether the last estimate was by the images, not by matches."""
        return _measured(self.scene, self.images)[1] is not None

    def sigmas(self) -> dict[str, np.ndarray]:
        """(J,) of heights [GSD], normals [deg] and albedos [%], by the names of KINDS."""
        found = landmark_sigmas(self.scene)
        return {kind: found[name] for kind, name in KINDS.items()}

    @cached_property
    def in_frame(self) -> dict[str, np.ndarray]:
        """As `sigmas`, in the frame of the pose priors, whose variances come on top; empty without priors."""
        if self.pose_priors is None:
            return {}
        own, noise = stated_at(self, self.scene, self.images, self.tie_points)
        known, _ = stated_at(self, self.scene, self.images, self.tie_points, noise=noise, pose_priors=self.pose_priors)
        return {kind: with_frame(sigma, known[kind], own[kind]) for kind, sigma in self.sigmas().items()}


def with_frame(sigma: np.ndarray, known: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Sigmas (J,) with what those of one information gain (`known` over `own`) by the errors of the frame.

    Infinite where one of them is: there nothing was measured.
    """
    measured = np.isfinite(sigma) & np.isfinite(known) & np.isfinite(own)
    found = np.full(len(sigma), np.inf)
    gained = np.maximum(known[measured] ** 2 - own[measured] ** 2, 0.0)
    found[measured] = np.sqrt(sigma[measured] ** 2 + gained)
    return found


def run_options(options: PlanOptions) -> RunOptions:
    """The run that is planned."""
    run = RunOptions(reflectance=options.reflectance)
    return replace(run, densify=replace(run.densify, min_views=options.min_views))


def forecast(
    planned: PlannedViews, body: str | None, brightness: str, options: PlanOptions, progress: Progress = no_progress
) -> Forecast:
    """The representative map of the planned views. Raises InputError where they do not show it, or make no map."""
    run = run_options(options)
    reflectance = choose_reflectance(run.reflectance, body)
    if reflectance is None:
        raise InputError("--reflectance none: a plan is of normals and albedos, too; choose a reflectance model")
    half_side = 0.5 * options.patch_px * planned.gsd_m
    views, shown = cropped_views(planned.views, half_side)
    if not shown[planned.reference]:
        raise InputError(f"{planned.views.name[planned.reference]}: does not show the place; choose another")
    reference = int(np.count_nonzero(shown[: planned.reference]))
    ground = assumed_ground(planned, views, half_side, reflectance, body, brightness, options)
    images = ground.images(progress)
    scene = scene_at_truth(ground, reference, reflectance)
    matcher: Matcher = keyed_matcher("flow", run).value
    tie_points = expected_tie_points(
        planned.views[np.flatnonzero(shown)],
        views,
        reference,
        options.tie_points,
        options.tie_point_sigma_px,
        TIE_POINT_RELIEF * planned.gsd_m * planned.views.cameras[planned.reference].width,
        options.seed,
    )
    try:
        matched = rematch(brightness_on_surface(scene, images), images, matcher, run.densify, progress, "match")
        if run.reflectance == "auto":
            reflectance = _better_model(matched, reflectance, progress)
        progress("estimate", 0, 0)
        estimate = JointEstimate(options=run.adjust, reflectance=reflectance, tie_points=tie_points, sparse_views=views)
        adjustment = refine_directly(estimate.in_own_model(matched), images, estimate)
        adjustment = replace(adjustment, scene=with_fine_relief(adjustment.scene, options.detector.psf_sigma_px))
    except ReconstructionError as error:
        raise InputError(
            f"these views make no map of the place: {error}. Ask for fewer views of a landmark (--min-views), or add "
            "views of like light"
        ) from error
    lit = np.count_nonzero(adjustment.lit) / len(adjustment.scene.landmarks)
    if lit < LEAST_LIT:
        raise InputError(
            f"landmarks are lit in {lit:.1f} views each: a normal and an albedo fit three brightnesses exactly, so "
            "that their noise does not show; plan with four views or more"
        )
    if not set(KINDS.values()) <= set(landmark_sigmas(adjustment.scene)):
        raise InputError("these views do not determine a map of the place: add views from other directions")
    return Forecast(
        adjustment=adjustment,
        ground=ground,
        images=images,
        run=run,
        reflectance=reflectance,
        tie_points=tie_points,
        shown=shown,
        pose_priors=_priors(planned, views) if options.pose_priors else None,
    )


def stated_at(
    planned: Forecast,
    scene: Scene,
    images: tuple[Image, ...],
    tie_points: TiePoints | None,
    *,
    noise: Noise | None = None,
    pose_priors: PosePriors | None = None,
    fitted: int | None = None,
) -> tuple[dict[str, np.ndarray], Noise]:
    """Sigmas (J,) as `Forecast.sigmas` by the information at a scene, without misfits from place to place; the noise.

    scene: with its keypoints; the brightness is taken from the images. noise: left out, it is measured. fitted: a view
    that the scene was not estimated with. An estimate would fit its brightness: it is taken to be as predicted.
    """
    measured, gradients = _measured(scene, images)
    if fitted is not None:
        tracks = measured.tracks
        brightness = np.where(tracks.view == fitted, observation_brightness(measured), tracks.brightness)
        measured = replace(measured, tracks=replace(tracks, brightness=brightness))
    if pose_priors is not None:
        measured = replace(measured, frame=BODY_FIXED)
    found, noise = uncertainty_at(
        measured,
        planned.run.adjust,
        noise=noise,
        priors=ScenePriors(pose_priors=pose_priors),
        tie_points=tie_points,
        gradients=gradients,
        bent=gradients is not None,
    )
    if "position" not in found:
        raise InputError("these views do not determine a map of the place: add views from other directions")
    sigma = landmark_sigmas(replace(measured, uncertainty=found))
    return {kind: sigma[name] for kind, name in KINDS.items()}, noise


def _measured(scene: Scene, images: tuple[Image, ...]) -> tuple[Scene, ImageGradients | None]:
    """The scene with the brightness where it projects, and the gradients of a last estimate by the images; none where
    too few views light the ground for that."""
    measured, gradients = image_gradients(scene, images)
    directly = np.mean(gradients.of_landmarks(measured.tracks)) >= MIN_SHARE
    return measured, gradients if directly else None


def _better_model(scene: Scene, known: Reflectance, progress: Progress) -> Reflectance:
    """The model that a run would finish the matched map with, as it is known beforehand."""
    candidates = candidate_models(known, scene.body, scene.brightness)
    found, why = model_by_cross_validation(scene, known, candidates, progress)
    log.info("reflectance: %s", why)
    return found


def _priors(planned: PlannedViews, views: Views) -> PosePriors | None:
    known = {name: prior for name, prior in planned.priors.items() if name in views.name}
    if len(known) < MIN_PRIORS:
        return None
    return priors_of_views(views.name, views.body_from_cam, known, views.arc)
