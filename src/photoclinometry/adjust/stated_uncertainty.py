"""The uncertainties that an estimate states: after its last reweighting iteration, or at a scene that is given.

Both are one statement. A map that is planned has the uncertainties that a run of its views would state.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust.covariance.uncertainty import (
    OF_LANDMARKS,
    Stated,
    bounded_normals,
    estimate_uncertainty,
    with_frame_error,
    with_local_errors,
)
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import ImageGradients
from photoclinometry.adjust.graph.smoothness import Smoothness
from photoclinometry.adjust.graph.sun_directions import unexplained_variance
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.groups import Setup, altimetry_factors, factor_groups, setup_of, smoothness_group
from photoclinometry.adjust.measured_noise import measured_noise, starting_noise
from photoclinometry.adjust.noise import Noise, local_noise, noise_is_measurable
from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.adjust.scene_priors import ScenePriors
from photoclinometry.adjust.solve.solver import Iteration, Solution
from photoclinometry.adjust.solver_order import in_solver_order
from photoclinometry.adjust.tie_points import TiePoints
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn

log = logging.getLogger(__name__)

ALIKE_IN_SPARSE = 4.0
"""Factor on the noise of sparse tie points where there are pose-only ones. A feature made by shading moves with the
shading, by the same amount in all views of similar light, which then agree on a wrong position. Residuals do not show
this."""


@dataclass(frozen=True)
class Fit:
    """The result of the last reweighting iteration, in the solver's order."""

    scene: Scene
    """As estimated, with tie points."""
    smoothness: Smoothness
    solution: Solution
    lit: np.ndarray
    noise: Noise
    history: tuple[Iteration, ...]
    position_smoothness: Smoothness | None = None
    """Smoothness that holds positions, where `smoothness` holds normals alone."""


def stated_uncertainty(setup: Setup, fit: Fit) -> tuple[Stated, np.ndarray | None]:
    """The uncertainties in the solver's order, and the standard deviations of the reflectance parameters.

    Errors of brightness common to a view count as noise, and everything else is as certain as stated. Where brightness
    fits worse or better than its noise, landmarks are less or more certain by the same factor (`local_noise`). Normals
    point away from the ground (`bounded_normals`). Suns that brightness has moved further than their measurements allow
    have sigmas as large as that move (`unexplained_variance`).
    """
    if setup.reflectance is not None and setup.options.brightness_sigma is None:
        _warn_of_unknown_noise(fit)
    if setup.without_smooth_errors:
        setup, fit = _with_smooth_errors(setup, fit)
    stated, sigma = _covariances(setup, fit)
    found = stated.uncertainty
    estimate = fit.solution.estimate
    on_map = replace(fit.scene, views=estimate.views, landmarks=estimate.landmarks[: setup.members.count])
    if found and setup.reflectance is not None:
        sigma_of_each = fit.noise.brightness_sigma * setup.relative_sigma
        local = local_noise(fit.scene, fit.lit, sigma_of_each, setup.members.of_map)
        found = with_local_errors(found, local, stated.in_common)
    if {"position", "rotation", "center"} <= set(found) and not setup.fixes_frame:
        found = with_frame_error(found, on_map.landmarks.position, on_map.views)
    if "normal" in found:
        found["normal"] = bounded_normals(found["normal"])
    if "sun" in found:
        more = unexplained_variance(estimate.views, np.trace(found["sun"], axis1=1, axis2=2) / 2.0)
        found["sun"] = found["sun"] + more[:, None, None] * np.eye(2)
    return replace(stated, uncertainty=found), sigma


def _warn_of_unknown_noise(fit: Fit) -> None:
    """Warns where the residuals of brightness are no measure of its noise."""
    if not noise_is_measurable(fit.scene, fit.lit):
        level = float(np.median(fit.scene.tracks.brightness[fit.lit]))
        warn(
            log, "noise-unknown",
            "most landmarks are lit in three views or fewer, whose brightness a normal and an albedo fit exactly: "
            "standard deviations assume brightness good to %.1f %%; --adjust.brightness-sigma states another noise",
            100.0 * fit.noise.brightness_sigma / level,
        )  # fmt: skip


def uncertainty_at(
    scene: Scene,
    options: AdjustOptions,
    *,
    noise: Noise | None = None,
    priors: ScenePriors | None = None,
    tie_points: TiePoints | None = None,
    gradients: ImageGradients | None = None,
    bent: bool = False,
) -> tuple[dict[str, np.ndarray], Noise]:
    """The uncertainties (`Scene.uncertainty`) that an estimate with its minimum at a scene would state, and the noise.

    Nothing is minimised. noise: of the measurements; left out, it is measured from the scene's residuals. Errors from
    place to place are not in it: they are of a fit. priors, tie_points, gradients: as of `adjust`; gradients without
    a factor. bent: positions are held by the smoothness of an estimate from whose brightness smooth errors were
    taken out. Raises ReconstructionError where no brightness counts.
    """
    priors = priors or ScenePriors()
    given = in_solver_order(scene, gradients, tie_points, priors.control)
    setup = setup_of(given.scene, given.members, options, gradients=given.gradients, priors=priors)
    pivot = np.median(scene.landmarks.position, axis=0)
    estimate = Estimate(scene.views, given.scene.landmarks, pivot, setup.parameters, setup.systematic)
    lit = setup.lit
    noise = noise or measured_noise(setup, given.scene, lit, starting_noise(setup, lit))
    smoothness = smoothness_group(setup, estimate.landmarks, noise)
    of_positions = smoothness_group(_bent(setup), estimate.landmarks, noise) if bent else None
    solution = Solution(estimate, True, "given", (), None)
    assert smoothness is not None
    fit = Fit(given.scene, smoothness, solution, lit, noise, (), of_positions)
    found, _ = _covariances(setup, fit)
    back, uncertainty = np.argsort(given.order), found.uncertainty
    return {name: value[back] if name in OF_LANDMARKS else value for name, value in uncertainty.items()}, noise


def _bent(setup: Setup) -> Setup:
    """The setup in which smooth errors were taken out of the brightness."""
    assert setup.gradients is not None
    return replace(setup, gradients=setup.gradients._replace(factor=np.ones(len(setup.table.tracks))))


def _covariances(setup: Setup, fit: Fit) -> tuple[Stated, np.ndarray | None]:
    """As `stated_uncertainty`, with the same noise at every landmark."""
    estimate, noise, sigma = fit.solution.estimate, fit.noise, None
    alike = ALIKE_IN_SPARSE if setup.members.direct.any() else 1.0
    stated = replace(
        noise,
        view_prior_factor=1.0,
        sparse_keypoint_factor=alike * noise.sparse_keypoint_factor,
        pose_only_keypoint_factor=noise.keypoint_factor,
        brightness_correlation_px=noise.brightness_correlation_px * noise.view_prior_factor,
    )
    found = estimate_uncertainty(
        FactorGraph(factor_groups(setup, fit.lit, stated, fit.smoothness, altimetry_factors(setup, estimate))),
        estimate,
        keypoint_correlation=setup.correlation(stated.keypoint_correlation_px),
        brightness_correlation=setup.correlation(stated.brightness_correlation_px),
        members=setup.members,
        own_frame=not setup.fixes_frame,
        stride=setup.scene.region.stride,
        position_smoothness=fit.position_smoothness,
    )
    if len(found.parameter_variance):
        assert setup.reflectance is not None
        sigma = np.abs(setup.reflectance.parameter_scale) * np.sqrt(found.parameter_variance)
    return found, sigma


def _with_smooth_errors(setup: Setup, fit: Fit) -> tuple[Setup, Fit]:
    """The same solution with smooth errors as errors of brightness.

    Smooth errors are known from the surface, and no better than the surface. No parameter is held because of them.
    Normals are held by smoothness without the bend, which comes from the same brightness; positions by the smoothness
    of the fit.
    """
    assert setup.gradients is not None
    plain = replace(setup, gradients=setup.gradients._replace(factor=None, smooth_over=np.inf))
    tracks = fit.scene.tracks
    scene = replace(fit.scene, tracks=replace(tracks, brightness=tracks.brightness / setup.gradients.factor))
    noise = measured_noise(plain, scene, fit.lit, replace(fit.noise, view_prior_factor=1.0))
    estimate = fit.solution.estimate
    if scene.reflectance is not None and plain.estimates_reflectance:
        estimate = replace(estimate, parameters=np.zeros(len(scene.reflectance.parameters)))
    smoothness = smoothness_group(plain, estimate.landmarks, noise)
    solution = replace(fit.solution, estimate=estimate)
    plain_fit = replace(fit, scene=scene, noise=noise, smoothness=smoothness, solution=solution)
    return plain, replace(plain_fit, position_smoothness=fit.smoothness)
