"""The joint maximum a posteriori estimate of a scene: what is measured, what is gated out, how noise is found.

The scene's own values are the start. A few rounds are made, since which brightness counts depends on the
geometry and its noise on the fit: gate, solve, measure the noise, until neither changes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.adjust.companions import Anchors, Roles, with_companions
from photoclinometry.adjust.known import PosePriors, priors_of
from photoclinometry.adjust.layout import ImageSlopes, build_layout, lay_out, morton_order
from photoclinometry.adjust.noise import (
    Noise,
    brightness_noise,
    correlation_px,
    keypoint_factor,
    scale_scatter,
    view_factor,
)
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.adjust.priors import Priors
from photoclinometry.adjust.problem import Problem, sun_rows
from photoclinometry.adjust.smoothing import Neighbours, build_neighbours
from photoclinometry.adjust.solver import Iteration, minimize, parameter_response
from photoclinometry.adjust.uncertainty import OF_LANDMARKS, estimate_uncertainty
from photoclinometry.adjust.variables import Estimate
from photoclinometry.adjust.weights import weighted, weights_of
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.projection import (
    keypoint_residuals,
    projected_keypoints,
)
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Scene, Views
from photoclinometry.photometry.initialize import neighbours
from photoclinometry.photometry.predict import (
    brightness_residuals,
    phase_of_views,
    shading,
)

log = logging.getLogger(__name__)

BALANCED_CORRELATION_PX = 3.0
"""Brightness correlation up to which smoothness is as given; of a map of larger stride, in landmarks."""

LONGEST_STEP, LONGEST_ANCHOR_STEP = 0.5, 20.0
"""How far a landmark may move in one step against what all do, in distances between landmarks. Anchors have no
neighbours to tear from: those seen from nearly one direction have far to go, and were what estimates waited for."""

DIRECT_SMOOTHNESS = 0.5
"""Where brightness follows landmarks (`ImageSlopes`), smoothness is as given times this, if errors of brightness are a
pixel's own: nothing else holds single landmarks against noise."""

STARTING_KEYPOINT_CORRELATION_PX, STARTING_BRIGHTNESS_CORRELATION_PX = 12.0, 3.0
"""Correlations until they are measured."""


@dataclass(frozen=True)
class Adjustment:
    """The adjusted scene and how it was reached."""

    scene: Scene
    converged: bool
    message: str
    log: tuple[Iteration, ...]
    """All rounds, one after the other."""
    noise: Noise
    """What the measurements' errors were taken to be."""
    lit: np.ndarray
    """(N,) bool: observations whose brightness was used, in the order of the scene's tracks."""
    parameter_sigma: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(T,) standard deviations of the reflectance's `parameters`, NaN where uncertainties are left out; of none where
    they are held."""
    pose_priors_used: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    """(K,) views whose pose prior had a say; of none where there were no priors but the gauge's."""


def adjust(
    scene: Scene,
    options: AdjustOptions | None = None,
    *,
    anchors: Anchors | None = None,
    pose_priors: PosePriors | None = None,
    reflectance: Reflectance | None = None,
    slopes: ImageSlopes | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> Adjustment:
    """The joint estimate of poses, Suns, scales, biases, positions, normals and albedos.

    anchors: sparse landmarks, from structure from motion, that help to hold the poses. pose_priors: of spacecraft
    navigation; without them only the gauge is fixed, by the reference view's pose and one landmark. reflectance: as it
    is known beforehand, of which the scene's is an estimate; left out, the scene's own. slopes: of the images where the
    scene's brightness was taken, so that it follows the landmarks (`factors.direct`), which then stay on their
    rays of the reference view, while copies with their matches hold the poses (`companions`); the adjusted scene has
    the brightness where its landmarks project, by these slopes.
    With `scene.reflectance` None only keypoints count (dense structure from motion): positions and poses are
    estimated, the rest is returned as it came. Raises ReconstructionError where fewer than 3 views or no landmarks are
    left to estimate.
    """
    options = options or AdjustOptions()
    if len(scene.views) < 3 or len(scene.landmarks) < 10:
        raise ReconstructionError(
            f"{len(scene.landmarks)} landmarks in {len(scene.views)} views: too few for a joint estimate"
        )
    order = morton_order(scene.landmarks.pixel)
    tracks, picked = scene.tracks.of_landmarks(order)
    if slopes is not None:
        slopes = ImageSlopes(slopes.at[picked], slopes.slope[picked])
    sorted_scene = replace(scene, landmarks=scene.landmarks[order], tracks=tracks)
    del tracks
    sorted_scene, slopes, roles = with_companions(sorted_scene, anchors, slopes)
    pivot = np.median(scene.landmarks.position, axis=0)
    start = Estimate(scene.views, sorted_scene.landmarks, pivot)
    given = scene.reflectance
    if scene.reflectance is not None and options.reflectance_sigma > 0:
        given = reflectance or scene.reflectance
        start = replace(start, parameters=given.relative_change(scene.reflectance))
    adjustment = _rounds(sorted_scene, start, given, options, roles, pose_priors, slopes, progress)
    back = np.argsort(order)
    estimate = adjustment.scene.landmarks
    lit = np.empty(len(picked), bool)
    lit[picked] = adjustment.lit[: len(picked)]
    uncertainty = {
        name: value[back] if name in OF_LANDMARKS else value for name, value in adjustment.scene.uncertainty.items()
    }
    adjusted = replace(scene, reflectance=adjustment.scene.reflectance, uncertainty=uncertainty)
    if slopes is not None:
        brightness = np.empty(len(picked))
        brightness[picked] = adjustment.scene.tracks.brightness[: len(picked)]
        adjusted = replace(adjusted, tracks=replace(scene.tracks, brightness=brightness))
    if pose_priors is not None:
        adjustment = replace(adjustment, pose_priors_used=np.isfinite(pose_priors.center_sigma))
    return replace(adjustment, scene=adjusted.with_estimate(adjustment.scene.views, estimate[back]), lit=lit)


def _rounds(
    scene: Scene,
    estimate: Estimate,
    given: Reflectance | None,
    options: AdjustOptions,
    roles: Roles,
    pose_priors: PosePriors | None,
    slopes: ImageSlopes | None,
    progress,
) -> Adjustment:
    """`adjust` in the solver's order of landmarks, with companions.

    given: the reflectance from which that of the estimate differs by its parameters.
    """
    tracks, photometric, stride = scene.tracks, scene.reflectance is not None, scene.region.stride
    layout, place = build_layout(tracks, len(scene.views))
    unweighted = lay_out(tracks, place, layout.places, slopes)
    smooth = photometric and options.smooth_sigma_rad > 0
    own, mapped = roles.mapped, int(np.count_nonzero(roles.mapped))
    if options.keypoint_sigma_px is not None:
        sigma = np.where(roles.anchor[tracks.landmark], tracks.keypoint_sigma, options.keypoint_sigma_px)
        scene = replace(scene, tracks=replace(tracks, keypoint_sigma=sigma))
    priors = priors_of(scene, options, mapped, pose_priors)
    limit = scene.spacing * np.where(own, LONGEST_STEP, LONGEST_ANCHOR_STEP)
    loose = options.solver.roughly()
    history: list[Iteration] = []
    lit = gate(scene, estimate, options) if photometric else np.zeros(len(tracks), bool)
    noise = _starting_noise(scene, options, lit, priors)
    final, solution, problem = False, None, None
    for round_ in range(options.max_rounds):
        final = final or round_ == options.max_rounds - 1
        shared = noise.between_landmarks(stride)
        weights = weights_of(scene, options, lit, roles, shared)
        measured = weighted(unweighted, weights, place)
        looser = shared.brightness_correlation_px / BALANCED_CORRELATION_PX
        smooth_sigma = options.smooth_sigma_rad * max(looser, DIRECT_SMOOTHNESS if roles.direct.any() else 1.0)
        pairs = _pairs(estimate.landmarks.position, mapped, options.smooth_neighbours if smooth else 0)
        held = replace(priors, view_factor=noise.view_factor, scale_scatter=noise.scale_scatter)
        problem = None  # its buffers are let go of before the next one's are made
        problem = Problem(layout, measured, pairs, held, given, smooth_sigma=smooth_sigma)
        solver = options.solver if final else loose
        moves = None if solution is None else solution.parameter_moves
        solution = minimize(problem, estimate, solver, step_limit=limit, moves=moves, progress=progress)
        history.extend(solution.log)
        estimate = solution.estimate
        scene = replace(scene, reflectance=problem.reflectance_at(estimate))
        if slopes is not None:
            now = scene.with_estimate(estimate.views, estimate.landmarks)
            scene = replace(scene, tracks=replace(scene.tracks, brightness=_following(tracks.brightness, slopes, now)))
        log.info("round %d: %s; %s", round_ + 1, solution.message, noise)
        if final:
            break
        new_lit = gate(scene, estimate, options) if photometric else lit
        new_noise = _measured_noise(scene, estimate, options, new_lit, roles, noise, priors)
        final = bool(np.mean(new_lit != lit) < 1e-2 and new_noise.close_to(noise))
        lit, noise = new_lit, new_noise
    assert solution is not None
    assert problem is not None
    scene = replace(scene.with_estimate(estimate.views, estimate.landmarks), uncertainty={})
    problem.priors = replace(priors, scale_scatter=noise.scale_scatter)
    response, parameter_sigma = None, np.full(len(estimate.parameters), np.nan)
    if options.uncertainty:
        if len(estimate.parameters):
            response = parameter_response(problem, solution, options.solver)
            assert given is not None
            parameter_sigma = np.abs(given.parameters) * np.sqrt(np.diag(response.covariance))
        # As if what brightness errs by all over a view were noise, and all else known as well as stated.
        seen = replace(noise, brightness_correlation_px=noise.brightness_correlation_px * noise.view_factor)
        seen = seen.between_landmarks(stride)
        weights = weights_of(scene, options, lit, roles, seen)
        problem.release()
        del layout, place, unweighted, measured
        slope = None if slopes is None else slopes.slope
        found = estimate_uncertainty(scene, estimate.pivot, problem, weights, seen, own, response, slope)
        scene = replace(scene, uncertainty=found)
    return Adjustment(
        scene,
        solution.converged,
        solution.message,
        tuple(history),
        noise,
        lit,
        parameter_sigma,
    )


def _following(brightness: np.ndarray, slopes: ImageSlopes, scene: Scene) -> np.ndarray:
    """Brightness (N,) where the scene's landmarks project, from that (N,) where it was taken."""
    return brightness + np.sum(slopes.slope * (projected_keypoints(scene) - slopes.at), -1)


def gate(scene: Scene, estimate: Estimate, options: AdjustOptions) -> np.ndarray:
    """Observations (N,) whose brightness counts: lit in the image, and neither Sun nor camera too low."""
    tracks, points = scene.tracks, estimate.landmarks
    assert scene.reflectance is not None
    mu0, mu, _ = shading(
        tracks.landmark, tracks.view, estimate.views, points.position, points.normal, scene.reflectance
    )
    high = mu0 > np.cos(np.radians(options.max_incidence_deg))
    return tracks.lit & high & (mu > np.cos(np.radians(options.max_emission_deg)))


def _starting_noise(scene: Scene, options: AdjustOptions, lit: np.ndarray, priors: Priors) -> Noise:
    """What is given, and guesses for what is to be measured: two percent of the median brightness."""
    if scene.reflectance is not None and not np.any(lit):
        raise ReconstructionError(
            "no brightness is usable: every observation is in shadow or lit below the horizon; "
            "check the Sun directions (towards the Sun, in the camera frame: x right, y down, z forward)"
        )
    brightness = 0.02 * float(np.median(scene.tracks.brightness[lit])) if np.any(lit) else 0.0
    return Noise(
        keypoint_factor=1.0,
        keypoint_correlation_px=options.keypoint_correlation_px or STARTING_KEYPOINT_CORRELATION_PX,
        anchor_factor=1.0,
        brightness_sigma=options.brightness_sigma or brightness,
        brightness_correlation_px=options.brightness_correlation_px or STARTING_BRIGHTNESS_CORRELATION_PX,
        scale_scatter=_scale_scatter(scene, options, priors),
    )


def _scale_scatter(scene: Scene, options: AdjustOptions, priors: Priors) -> float:
    """What scales scatter by where calibration tells them and `options` do not say how well; else infinite."""
    if options.scale_sigma is not None or not np.all(np.isfinite(priors.scale)):
        return np.inf
    return scale_scatter(scene.views.scale, phase_of_views(scene) if options.reflectance_sigma > 0 else None)


def _measured_noise(
    scene: Scene, estimate: Estimate, options: AdjustOptions, lit, roles: Roles, noise: Noise, priors: Priors
) -> Noise:
    """`noise` with everything that is not given measured from the residuals of the estimate."""
    scene = scene.with_estimate(estimate.views, estimate.landmarks)
    tracks, found = scene.tracks, {}
    residual = keypoint_residuals(scene)
    pixel, stride = scene.landmarks.pixel[tracks.landmark], scene.region.stride
    if options.keypoint_sigma_px is None:
        found["keypoint_factor"] = keypoint_factor(scene, residual, roles.mapped)
    if roles.anchor.any():
        found["anchor_factor"] = keypoint_factor(scene, residual, roles.anchor)
    if options.keypoint_correlation_px is None:
        mine = roles.mapped[tracks.landmark]
        found["keypoint_correlation_px"] = max(
            correlation_px(residual[mine, axis], tracks.view[mine], pixel[mine], stride) for axis in (0, 1)
        )
    if lit.any():
        residual = brightness_residuals(scene)
        if options.brightness_sigma is None:
            found["brightness_sigma"] = brightness_noise(scene, residual, lit)
        if options.brightness_correlation_px is None:
            found["brightness_correlation_px"] = correlation_px(residual[lit], tracks.view[lit], pixel[lit], stride)
            found["view_factor"] = view_factor(_view_offsets(scene.views, priors), noise.view_factor)
    found["scale_scatter"] = _scale_scatter(scene, options, priors)
    return replace(noise, **found)


def _view_offsets(views: Views, priors: Priors) -> np.ndarray:
    """Suns, scales and biases less what is known of them, in stated standard deviations; of those that are not free."""
    scale, bias = (views.scale - 1.0) / priors.scale, views.bias / priors.bias
    known = [part[np.isfinite(sigma)] for part, sigma in ((scale, priors.scale), (bias, priors.bias))]
    return np.concatenate([sun_rows(views)[0].ravel(), *known])


def _pairs(position: np.ndarray, mapped: int, count: int) -> Neighbours:
    """`count` neighbours of each of the mapped landmarks; the anchors have none."""
    if count == 0:
        none = np.zeros((len(position), 0))
        return build_neighbours(none.astype(int), none.astype(bool))
    index, near = neighbours(position[:mapped], count)
    alone = ((0, len(position) - mapped), (0, 0))
    return build_neighbours(np.pad(index, alone), np.pad(near, alone))
