"""The joint estimates of a run: in the frame of the images alone, or in that of pose priors and control points."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.adjust import (
    Adjustment,
    AdjustOptions,
    GroundControl,
    ImageGradients,
    Iteration,
    Noise,
    PosePriors,
    ScenePriors,
    TiePoints,
    adjust,
)
from photoclinometry.matching.triangulation import triangulate_tracks
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.control import ControlPoint
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import BODY_FIXED, OWN, Scene, Views
from photoclinometry.photometry.albedo import with_model
from photoclinometry.pipeline.frame.altimetry import on_shots, tracks_over
from photoclinometry.pipeline.frame.control import agreeing_points, ground_control, place_by_control
from photoclinometry.pipeline.frame.pose_priors import estimate_with_priors, place_by_priors
from photoclinometry.pipeline.posed_site import KnownViews
from photoclinometry.registration.alignment import align_views

log = logging.getLogger(__name__)

HELD_SUN_RAD, HELD_BIAS = 1e-3, 1e-3
"""Where photometry is held, the largest standard deviations of each Sun, and of biases as a share of the median
brightness: Suns and biases then stay at their stated values."""

HELD_SIGMA = 1e-3
"""Standard deviation of positions and normals that are held [GSD, rad]: far below that of any estimate from images."""

ROUGH_REWEIGHTING = 2
"""Reweighting iterations of a rough estimate: with the noise known before it, and with what is measured then."""


@dataclass(frozen=True, kw_only=True)
class EstimateSettings:
    """How one of several estimates of the same views differs from the others."""

    keypoint_sigma_factor: float = 1.0
    """On the keypoints' standard deviations, besides `AdjustOptions.keypoint_sigma_factor`."""
    rough: bool = False
    """Whether it ends early and without uncertainties: its map is matched again, and only slow motions of the map as a
    whole have not converged by then."""
    all_steps: bool = False
    """Whether a rough estimate takes all steps that the options allow: `refine_directly` asks whether it has
    converged."""
    gradients: ImageGradients | None = None
    """Of the images where the start's brightness was taken; that then follows the landmarks."""
    noise: Noise | None = None
    """As an earlier estimate of nearly the same scene has found it."""
    least_keypoint_factor: float = 0.0
    """As of `adjust`: residuals of keypoints do not measure the errors of matches with the map's own relit
    reference."""
    reweighting: int | None = None
    """Reweighting iterations, if fewer than options allow; left out, ROUGH_REWEIGHTING of rough estimates."""
    photometry_alone: bool = False
    """Whether positions and normals stay what they are at the start, so that only the photometry follows brightness."""

    def applied_to(self, options: AdjustOptions) -> AdjustOptions:
        """The options of this estimate, from those of all."""
        found, reweighting = options, self.reweighting
        if self.rough:
            found = replace(found, uncertainty=False, solver=found.solver.roughly(all_steps=self.all_steps))
            reweighting = reweighting or ROUGH_REWEIGHTING
        if reweighting is not None:
            found = replace(found, max_reweightings=min(reweighting, found.max_reweightings))
        if self.photometry_alone:
            found = replace(found, position_sigma_gsd=HELD_SIGMA, normal_sigma_rad=HELD_SIGMA)
        return replace(found, keypoint_sigma_factor=self.keypoint_sigma_factor * found.keypoint_sigma_factor)


def by_relit_matches(noise: Noise | None) -> EstimateSettings:
    """The last estimate of a map by matches with its own relit reference.

    Such matches repeat the map's errors. The fewer views there are, the better they agree with the map: to 0.003 px
    where they are off by 0.08 px. noise: from the loose estimates of the iterations before; keypoints are stated to be
    no better.
    """
    return EstimateSettings() if noise is None else EstimateSettings(least_keypoint_factor=noise.keypoint_factor)


@dataclass(frozen=True, kw_only=True)
class JointEstimate:
    """The inputs that all joint estimates of a run share, besides their start."""

    options: AdjustOptions
    reflectance: Reflectance | None = None
    """As it is known beforehand; None of geometry alone."""
    tie_points: TiePoints | None = None
    """Sparse tie points, in the frame of `sparse_views`."""
    sparse_views: Views | None = None
    """All views of the site, as the sparse stage left them; needed with tie points and pose priors."""
    pose_priors: Mapping[str, PosePrior] = field(default_factory=dict)
    """By name of view; none, or enough to determine a frame."""
    known_views: KnownViews | None = None
    """In the frame of the sparse stage, which then is the map's frame."""
    control: tuple[ControlPoint, ...] = ()
    """Ground control points, in the frame of the pose priors where there are such."""
    altimetry: AltimeterTracks | None = None
    """Laser altimetry, in the frame of the pose priors or control points."""
    holds_photometry: bool = False
    """Whether Suns, biases and reflectance parameters stay at their known values. Parameters that the whole map shares
    follow any error of its brightness, even one that is a small share of the residuals; slopes then shrink or grow."""

    def __call__(self, start: Scene, settings: EstimateSettings, progress: Progress = no_progress) -> Adjustment:
        """The scene estimated from `start`: with pose priors and control points once it is in their frame, without
        them before.

        Without them it is estimated in its own frame. The result of a rough estimate is then placed in the known frame,
        and the result of the last one is estimated once more there. Where priors or points turn out not to determine a
        frame, the log names the reason, and the scene stays as it is.
        """
        if settings.photometry_alone:
            return self._adjusted(start, settings, progress)
        if not self.pose_priors:
            return self._with_control(start, settings, progress)

        def with_priors(scene: Scene, priors: PosePriors) -> Adjustment:
            return self._adjusted(scene, settings, progress, priors)

        if in_prior_frame(start):
            return estimate_with_priors(start, self.pose_priors, with_priors) or self._adjusted(
                start, settings, progress
            )
        alone = self._adjusted(start, settings, progress)
        if not settings.rough:
            return estimate_with_priors(alone.scene, self.pose_priors, with_priors) or alone
        placed = place_by_priors(alone.scene, self.pose_priors)
        return alone if placed is None else replace(alone, scene=placed.scene)

    def in_own_model(self, scene: Scene, progress: Progress = no_progress) -> Scene:
        """The scene with the reflectance model of this estimate.

        If that is another one than the scene's, the photometry is estimated while the geometry is held: parameters, and
        the albedos and scales that follow from them, may be far from the values known beforehand, and a last estimate
        that starts there does not reach its minimum.
        """
        model = self.reflectance
        if scene.reflectance is None or model is None or model.name == scene.reflectance.name:
            return scene
        return self(with_model(scene, model), EstimateSettings(rough=True, photometry_alone=True), progress).scene

    def _with_control(self, start: Scene, settings: EstimateSettings, progress: Progress) -> Adjustment:
        """The estimate without pose priors, placed by the control points if there are any."""
        found = self._adjusted(start, settings, progress)
        if not self.control or in_prior_frame(start):
            return found
        placed = place_by_control(found.scene, self.control)
        if placed is None:
            return found
        return replace(found, scene=placed) if settings.rough else self._adjusted(placed, settings, progress)

    def _adjusted(
        self, start: Scene, settings: EstimateSettings, progress: Progress, priors: PosePriors | None = None
    ) -> Adjustment:
        """The one call of `adjust`, with its iterations reported."""
        options, (start, altimetry) = settings.applied_to(self.options), self._on_altimetry(start)
        views = start.views
        if self.holds_photometry:
            start, options = _with_photometry_held(start, options)
        count = 0

        def report(_: Iteration) -> None:
            nonlocal count
            count += 1
            progress("adjust", count, 0)

        found = adjust(
            start,
            options,
            priors=ScenePriors(
                pose_priors=priors,
                known_poses=self.known_views.of(start.views.name) if self.known_views and priors is None else None,
                control=self._control_for(start),
                altimetry=altimetry,
                reflectance=self.reflectance,
            ),
            tie_points=self._tie_points_for(start),
            gradients=settings.gradients,
            noise=settings.noise,
            least_keypoint_factor=settings.least_keypoint_factor,
            on_step=report,
        )
        stated = replace(found.scene.views, sun_sigma=views.sun_sigma, sun_common_sigma=views.sun_common_sigma)
        return replace(found, scene=replace(found.scene, views=stated))

    def _control_for(self, scene: Scene) -> GroundControl | None:
        """The control points that agree with each other, where the scene is in their frame."""
        if not in_prior_frame(scene):
            return None
        return ground_control(agreeing_points(self.control, scene.views), scene.views)

    def _on_altimetry(self, scene: Scene) -> tuple[Scene, AltimeterTracks | None]:
        """The scene moved onto the altimeter's shots, and the tracks over it, where it is in their frame."""
        tracks = None
        if self.altimetry is not None and scene.frame == BODY_FIXED:
            tracks = tracks_over(scene, self.altimetry)
        return (scene, None) if tracks is None else (on_shots(scene, tracks), tracks)

    def _tie_points_for(self, scene: Scene) -> TiePoints | None:
        """The tie points in the scene's frame, where its own poses see them."""
        if self.tie_points is None or not in_prior_frame(scene):
            return self.tie_points
        assert self.sparse_views is not None
        found = triangulate_tracks(self.tie_points.tracks, scene.views)
        roughly = align_views(self.sparse_views, scene)(self.tie_points.position)
        return replace(self.tie_points, position=np.where(np.isfinite(found), found, roughly))


def _with_photometry_held(start: Scene, options: AdjustOptions) -> tuple[Scene, AdjustOptions]:
    """The start and the options under which Suns, biases and reflectance parameters hardly move."""
    views, lit = start.views, start.tracks.lit
    level = float(np.median(start.tracks.brightness[lit])) if lit.any() else 1.0
    sun_sigma = np.minimum(views.sun_sigma, HELD_SUN_RAD)
    held = replace(views, sun_sigma=sun_sigma, sun_common_sigma=np.zeros(len(views)))
    return (
        replace(start, views=held),
        replace(options, reflectance_sigma=0.0, bias_sigma=HELD_BIAS * abs(level)),
    )


def in_prior_frame(scene: Scene) -> bool:
    """Whether the scene is in the frame of the pose priors or control points: placed there by an earlier estimate, or
    from the start as a part of a larger model."""
    return scene.frame != OWN
