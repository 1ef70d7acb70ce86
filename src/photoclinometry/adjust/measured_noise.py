"""The noise of an estimate, measured from its residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photoclinometry.adjust.correlation import correlation_px
from photoclinometry.adjust.graph.sun_directions import sun_offsets
from photoclinometry.adjust.groups import Setup
from photoclinometry.adjust.noise import (
    MAX_VIEW_PRIOR_FACTOR,
    Noise,
    brightness_noise,
    keypoint_factor,
    noise_is_measurable,
    scale_scatter,
    view_prior_factor,
)
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.projection import keypoint_residuals
from photoclinometry.model.scene import Scene, Views
from photoclinometry.model.suns import SUN_CONVENTION
from photoclinometry.photometry.predict import brightness_residuals, phase_of_views

STARTING_KEYPOINT_CORRELATION_PX, STARTING_BRIGHTNESS_CORRELATION_PX = 12.0, 3.0
"""Correlations until they are measured."""

STARTING_BRIGHTNESS_SIGMA = 0.02
"""Noise of brightness until it is measured, as a share of its median."""


def starting_noise(setup: Setup, lit: np.ndarray, before: Noise | None = None) -> Noise:
    """The noise that is given, and guesses for that to be measured: the noise of an earlier estimate, if there was one.

    Where smooth errors are taken out of the brightness, its noise is measured anew at the start. The residuals of the
    earlier estimate contained these errors, so its noise is too large and correlated too far. With that noise,
    brightness would have too little weight: more of the remaining smooth errors would stay in the residuals, and would
    be measured as noise again.

    Raises ReconstructionError where no brightness counts.
    """
    scene, options = setup.scene, setup.options
    if scene.reflectance is not None and not np.any(lit):
        raise ReconstructionError(
            "no brightness is usable: every observation is in shadow or lit below the horizon; check the Suns; "
            f"{SUN_CONVENTION}"
        )
    level = float(np.median(scene.tracks.brightness[lit])) if np.any(lit) else 0.0
    of_views = {
        "view_prior_factor": MAX_VIEW_PRIOR_FACTOR if setup.without_smooth_errors else 1.0,
        "scale_scatter": _scale_scatter(setup, scene),
    }
    if before is not None:
        noise = replace(before, **of_views)
        return measured_noise(setup, scene, lit, noise) if setup.without_smooth_errors else noise
    return Noise(
        keypoint_factor=1.0,
        keypoint_correlation_px=options.keypoint_correlation_px or STARTING_KEYPOINT_CORRELATION_PX,
        pose_only_keypoint_factor=1.0,
        sparse_keypoint_factor=1.0,
        brightness_sigma=options.brightness_sigma or STARTING_BRIGHTNESS_SIGMA * level,
        brightness_correlation_px=options.brightness_correlation_px or STARTING_BRIGHTNESS_CORRELATION_PX,
        **of_views,
    )


def measured_noise(setup: Setup, scene: Scene, lit: np.ndarray, noise: Noise) -> Noise:
    """`noise` with the values that options do not give measured from the residuals of `scene`, the estimated scene.

    Values that the residuals do not determine stay (`noise_is_measurable`).
    """
    options, members, tracks, found = setup.options, setup.members, scene.tracks, {}
    residual = keypoint_residuals(scene)
    pixel, stride = scene.landmarks.pixel[tracks.landmark], scene.region.stride
    if options.keypoint_sigma_px is None:
        found["keypoint_factor"] = keypoint_factor(scene, residual, members.of_map)
        if members.pose_only.any():
            found["pose_only_keypoint_factor"] = keypoint_factor(scene, residual, members.pose_only)
    if members.sparse.any():
        found["sparse_keypoint_factor"] = keypoint_factor(scene, residual, members.sparse)
    if options.keypoint_correlation_px is None:
        mine = members.of_map[tracks.landmark]
        found["keypoint_correlation_px"] = correlation_px(residual[mine], tracks.view[mine], pixel[mine], stride)
    if lit.any():
        residual = brightness_residuals(scene) / setup.relative_sigma
        if options.brightness_sigma is None and noise_is_measurable(scene, lit):
            found["brightness_sigma"] = brightness_noise(scene, residual, lit)
        if options.brightness_correlation_px is None:
            found["brightness_correlation_px"] = correlation_px(
                residual[lit], tracks.view[lit], pixel[lit], stride, setup.smooth_over
            )
            if not setup.without_smooth_errors:
                excess = _view_excess(setup, scene.views)
                found["view_prior_factor"] = view_prior_factor(excess, noise.view_prior_factor)
    found["scale_scatter"] = _scale_scatter(setup, scene)
    return replace(noise, **found)


def _scale_scatter(setup: Setup, scene: Scene) -> float:
    """Scatter of calibrated scales where `options` do not state it; else infinite."""
    options = setup.options
    if options.scale_sigma is not None or not np.all(np.isfinite(setup.scale_sigma)):
        return np.inf
    return scale_scatter(scene.views.scale, phase_of_views(scene) if setup.estimates_reflectance else None)


def _view_excess(setup: Setup, views: Views) -> float:
    """Deviations of Suns, scales and biases that are not free from their priors, in stated standard deviations.

    The root mean square over views, or over arcs for the common part of each arc's Suns, if that is more.
    """
    scale, bias = (views.scale - 1.0) / setup.scale_sigma, views.bias / setup.bias_sigma
    known = [part[np.isfinite(sigma)] for part, sigma in ((scale, setup.scale_sigma), (bias, setup.bias_sigma))]
    own, common = sun_offsets(views)
    # A rotation about a Sun does not move it: Suns near each other determine only two axes of three.
    return max(
        float(np.sqrt(np.mean(np.concatenate([own.ravel(), *known]) ** 2))),
        float(np.linalg.norm(common)) / np.sqrt(2.0 * len(common)),
    )
