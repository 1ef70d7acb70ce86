"""The joint maximum a posteriori estimate of a scene: factor graphs, one after the other, reweighted in between.

The scene's own values are the start. The geometry decides which brightness counts, and the fit determines its noise.
The estimate is therefore iterated until neither changes: list the factors (`groups`), minimise, measure the noise of
the residuals.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.adjust.altimeter_tracks import AltimetryFit
from photoclinometry.adjust.brightness_weights import usable_brightness
from photoclinometry.adjust.covariance.uncertainty import OF_LANDMARKS, Stated
from photoclinometry.adjust.frame import in_its_frame
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import ImageGradients
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.groups import (
    Setup,
    altimetry_factors,
    altimetry_fit,
    factor_groups,
    frame_factors,
    setup_of,
    smoothness_group,
)
from photoclinometry.adjust.measured_noise import measured_noise, starting_noise
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.adjust.scene_priors import ScenePriors
from photoclinometry.adjust.solve.solver import Iteration, minimize
from photoclinometry.adjust.solver_order import in_solver_order
from photoclinometry.adjust.stated_uncertainty import Fit, stated_uncertainty
from photoclinometry.adjust.tie_points import TiePoints
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.projection import projected_keypoints
from photoclinometry.model.scene import Scene
from photoclinometry.surface.surroundings import carried_along

log = logging.getLogger(__name__)

LONGEST_STEP, LONGEST_TIE_POINT_STEP = 0.5, 20.0
"""Longest step of a landmark relative to the common move of all, in distances between landmarks. Tie points have no
neighbours that limit them: those seen from nearly one direction have far to go, and estimates waited for them."""

FEWEST_VIEWS, FEWEST_LANDMARKS = 3, 10
"""Two views leave the relief and the Suns' errors undetermined; fewer landmarks have no noise to measure."""

CHANGED_GATES = 0.01
"""Share of observations that may enter or leave between two iterations that count as equal."""


@dataclass(frozen=True)
class Adjustment:
    """The adjusted scene and how it was reached."""

    scene: Scene
    """With uncertainties, unless options leave these out."""
    converged: bool
    """Whether the last minimisation has; reweighting ends where noise no longer changes, or at its limit."""
    message: str
    """How that minimisation ended."""
    log: tuple[Iteration, ...]
    """All reweighting iterations, one after the other."""
    noise: Noise
    """The assumed errors of the measurements."""
    lit: np.ndarray
    """(N,) bool: observations whose brightness was used, in the order of the scene's tracks."""
    parameter_sigma: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(T,) standard deviations of the reflectance's `parameters`, NaN where uncertainties are left out; of none where
    they are held."""
    pose_priors_used: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    """(K,) views whose pose prior was used; of none where there were no priors but the gauge's."""
    frame_covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    """(7, 7) covariance of the map's similarity error in its frame: rotation [rad], translation [units of B] and scale,
    about its middle; empty for a map in a frame of its own, and where uncertainties are left out."""
    control: dict[str, np.ndarray] = field(default_factory=dict)
    """By name of ground control point, its (3,) estimated position in B."""
    altimetry: AltimetryFit | None = None
    """The altimeter's shots over the map, whose landmarks they number; None without an altimeter."""


def adjust(
    scene: Scene,
    options: AdjustOptions | None = None,
    *,
    priors: ScenePriors | None = None,
    tie_points: TiePoints | None = None,
    gradients: ImageGradients | None = None,
    noise: Noise | None = None,
    least_keypoint_factor: float = 0.0,
    on_step: Callable[[Iteration], None] | None = None,
) -> Adjustment:
    """The joint estimate of poses, Suns, scales, biases, positions, normals and albedos.

    With `scene.reflectance` None only keypoints count (dense structure from motion): positions and poses are
    estimated, the rest is returned as it came.

    priors: knowledge of the scene apart from its images.
    tie_points: sparse landmarks from structure from motion, whose keypoints help to hold the poses.
    gradients: of the images, where the scene's brightness was taken. Brightness then follows the landmarks
        (`factors.direct`), which stay on their rays of the reference view, while pose-only tie points hold the poses
        (`tie_points`). The adjusted scene has the brightness where its landmarks project, by these gradients.
        Brightness is multiplied by the gradients' `factor`, if they have one. Suns, scales, biases and reflectance
        parameters are then not estimated from brightness; uncertainties are those of an estimate without the factor.
    noise: of an earlier estimate of nearly this scene, from which reweighting starts.
    least_keypoint_factor: for uncertainties, the standard deviations of keypoints are at least this times those of
        `scene.tracks`, however small the residuals are.
    on_step: called after every step.

    Raises ReconstructionError where fewer than 3 views or 10 landmarks are left to estimate, and InputError where
    residuals of the start are no numbers.
    """
    options, priors = options or AdjustOptions(), priors or ScenePriors()
    if len(scene.views) < FEWEST_VIEWS or len(scene.landmarks) < FEWEST_LANDMARKS:
        raise ReconstructionError(
            f"{len(scene.landmarks)} landmarks in {len(scene.views)} views: a joint estimate needs {FEWEST_LANDMARKS} "
            f"landmarks and {FEWEST_VIEWS} views at least; map a larger region, or ground that more views see"
        )
    given = in_solver_order(scene, gradients, tie_points, priors.control)
    setup = setup_of(given.scene, given.members, options, gradients=given.gradients, priors=priors)
    pivot = np.median(scene.landmarks.position, axis=0)
    start = Estimate(scene.views, given.scene.landmarks, pivot, setup.parameters, setup.systematic)
    fit = _reweighted(setup, start, noise, on_step)
    found, parameter_sigma = Stated(), None
    if options.uncertainty:
        factor = max(fit.noise.keypoint_factor, least_keypoint_factor)
        stated = replace(fit, noise=replace(fit.noise, keypoint_factor=factor))
        found, parameter_sigma = stated_uncertainty(setup, stated)
    return _in_the_order_of(scene, given.order, given.picked, setup, fit, found, parameter_sigma)


def _reweighted(
    setup: Setup, estimate: Estimate, before: Noise | None, on_step: Callable[[Iteration], None] | None
) -> Fit:
    """Minimises, measures the noise, and minimises again, until neither noise nor gates change."""
    options, members, scene = setup.options, setup.members, setup.scene
    limit = scene.spacing * np.where(members.of_map, LONGEST_STEP, LONGEST_TIE_POINT_STEP)
    history: list[Iteration] = []
    lit = setup.lit
    noise = starting_noise(setup, lit, before)
    final, moves, graph, solution = options.max_reweightings == 1, None, None, None
    for number in range(1, options.max_reweightings + 1):
        graph = None  # its measurements are let go of before the next one's are made
        estimate = _framed(setup, estimate)
        between = smoothness_group(setup, estimate.landmarks, noise), altimetry_factors(setup, estimate)
        graph = FactorGraph(factor_groups(setup, lit, noise, *between))
        solver = options.solver if final else options.solver.roughly()
        solution = minimize(graph, estimate, solver, step_limit=limit, moves=moves, on_step=on_step)
        history.extend(solution.log)
        estimate, moves = solution.estimate, solution.parameter_moves
        log.info("reweighting iteration %d: %s; %s", number, solution.message, noise)
        if final:
            break
        scene = _scene_at(setup, graph, estimate)
        new_lit = usable_brightness(scene, options)
        new_noise = measured_noise(setup, scene, new_lit, noise)
        alike = np.mean(new_lit != lit) < CHANGED_GATES and new_noise.close_to(noise)
        final = bool(alike) or number == options.max_reweightings - 1
        lit, noise = new_lit, new_noise
    assert graph is not None
    assert solution is not None
    solution = replace(solution, estimate=_framed(setup, solution.estimate))
    estimate = solution.estimate
    return Fit(_scene_at(setup, graph, estimate), graph.smoothness, solution, lit, noise, tuple(history))


def _framed(setup: Setup, estimate: Estimate) -> Estimate:
    """The estimate moved as a whole to fit the altimeter's shots, priors and control points."""
    if setup.priors.altimetry is None:
        return estimate
    return in_its_frame(estimate, lambda now: frame_factors(setup, now), setup.scene.spacing)


def _scene_at(setup: Setup, graph: FactorGraph, estimate: Estimate) -> Scene:
    """The scene of an estimate, with the brightness where its landmarks project."""
    scene = setup.scene.with_estimate(estimate.views, estimate.landmarks)
    scene = replace(scene, uncertainty={}, reflectance=graph.reflectance_at(estimate) or setup.scene.reflectance)
    if setup.gradients is None:
        return scene
    moved = projected_keypoints(scene) - setup.gradients.at
    brightness = setup.table.tracks.brightness + np.sum(setup.gradients.gradient * moved, -1)
    return replace(scene, tracks=replace(scene.tracks, brightness=brightness))


def _in_the_order_of(
    scene: Scene,
    order: np.ndarray,
    picked: np.ndarray,
    setup: Setup,
    fit: Fit,
    stated: Stated,
    parameter_sigma: np.ndarray | None,
) -> Adjustment:
    """The adjusted scene with its landmarks and observations in the order of `scene`, without tie points."""
    estimate, back = fit.solution.estimate, np.argsort(order)
    found, observed = fit.scene, len(picked)
    lit, brightness = np.empty(observed, bool), np.empty(observed)
    lit[picked], brightness[picked] = fit.lit[:observed], found.tracks.brightness[:observed]
    uncertainty = {name: value[back] if name in OF_LANDMARKS else value for name, value in stated.uncertainty.items()}
    adjusted = replace(
        scene, reflectance=found.reflectance, uncertainty=uncertainty, error_correlation=stated.correlation
    )
    if setup.gradients is not None:
        if setup.gradients.factor is not None:
            brightness[picked] /= setup.gradients.factor[:observed]
        adjusted = replace(adjusted, tracks=replace(scene.tracks, brightness=brightness))
    known, control = setup.priors.pose_priors, setup.priors.control
    points, shots = estimate.landmarks.position[setup.members.control], altimetry_fit(setup, estimate)
    adjusted = adjusted.with_estimate(estimate.views, estimate.landmarks[back])
    return Adjustment(
        scene=replace(adjusted, surroundings=carried_along(scene, adjusted)),
        converged=fit.solution.converged,
        message=fit.solution.message,
        log=fit.history,
        noise=fit.noise,
        lit=lit,
        parameter_sigma=_unknown_sigma(setup) if parameter_sigma is None else parameter_sigma,
        pose_priors_used=np.zeros(0, bool) if known is None else np.isfinite(known.center_sigma),
        frame_covariance=stated.frame,
        control={} if control is None else dict(zip(control.name, points, strict=True)),
        altimetry=None if shots is None else replace(shots, landmark=order[shots.landmark]),
    )


def _unknown_sigma(setup: Setup) -> np.ndarray:
    """NaN for each of the reflectance parameters that are estimated here, or were before."""
    free = setup.reflectance is not None and setup.options.reflectance_sigma > 0
    return np.full(len(setup.reflectance.parameters) if setup.reflectance is not None and free else 0, np.nan)
