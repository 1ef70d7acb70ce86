"""The uncertainties of an adjusted scene: covariances as `Scene.uncertainty` holds them.

They are those of the errors, not of the weights. The estimate weighs n measurements that share an error as one, which
is right for what all landmarks determine together. A landmark's own error is another matter: n shared errors are not
larger than each, so its measurements count there with their own sigmas, and errors that all neighbours share are
passed on whole, since smoothing over neighbours does not lessen them. Smoothness counts as it was found to hold.

Where no pose is known but the gauge's, errors are those that are left after the best similarity of the map: its own
origin, orientation and size mean nothing. Otherwise they are in the frame of the pose priors.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from photoclinometry.adjust.covariance import ErrorModel, Linearised, Marginals, marginals, with_parameters
from photoclinometry.adjust.information import Observed
from photoclinometry.adjust.kernels import CAMERA_SIZE, LANDMARK_SIZE
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.parameters import ParameterResponse
from photoclinometry.adjust.problem import Problem, states
from photoclinometry.adjust.smoothing import linearize_smoothness
from photoclinometry.adjust.variables import Estimate
from photoclinometry.adjust.weights import Weights
from photoclinometry.adjust.windows import links
from photoclinometry.model.geometry import skew
from photoclinometry.model.scene import Scene, Views

log = logging.getLogger(__name__)

OF_LANDMARKS = ("position", "normal", "albedo")
"""What there is one of for each landmark; the rest is of views."""

LOOSE = 1e-4
"""In the map's own frame the prior that holds one landmark counts this much: enough for the scale, too little to make
its surroundings look known."""

_NEARBY = 25
"""Landmarks over which smoothness averages errors that are not shared."""


def estimate_uncertainty(
    scene: Scene,
    pivot: np.ndarray,
    problem: Problem,
    weights: Weights,
    noise: Noise,
    mapped: np.ndarray,
    response: ParameterResponse | None = None,
    slope: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """`Scene.uncertainty` of an adjusted scene, of the landmarks in `mapped` (J,).

    slope: (N, 2) of `ImageSlopes`, where brightness follows the landmarks. response: of reflectance parameters that
    were estimated along; without it they count as known. Empty, with a warning, where the measurements do not determine
    the views.
    """
    at, smoothness = linearised(scene, pivot, problem, weights, slope)
    errors = error_model(noise, smoothness, photometric=problem.with_brightness)
    frame = None
    priors = problem.priors
    if np.isfinite(priors.pose_translation).sum() <= 1 and np.isfinite(priors.position).sum() <= 1:
        frame = mapped
        at = loosely_held(at)
    try:
        found = marginals(at, errors, frame=frame)
    except np.linalg.LinAlgError:
        log.warning("no uncertainties: the measurements do not determine all views")
        return {}
    if response is not None:
        found = with_parameters(found, at, response, frame)
    uncertainty = scene_uncertainty(found, scene.views, pivot, mapped)
    estimated = uncertainty if problem.with_brightness else ("position", "rotation", "center")
    return {name: uncertainty[name] for name in estimated}


def loosely_held(at: Linearised) -> Linearised:
    """With little of the priors on positions."""
    prior = at.prior.copy()
    prior[:, :3, :3] *= LOOSE
    return replace(at, prior=prior)


def linearised(
    scene: Scene, pivot: np.ndarray, problem: Problem, weights: Weights, slope: np.ndarray | None = None
) -> tuple[Linearised, np.ndarray]:
    """The estimate at its minimum, and the whitened residuals (P,) of smoothness there."""
    views, points, tracks = scene.views, scene.landmarks, scene.tracks
    cameras, landmarks = states(views, points)
    neighbours = problem.neighbours
    rows, residual = np.zeros((len(neighbours.target), 5)), np.zeros(len(neighbours.target))
    linearize_smoothness(
        neighbours, points.position, points.normal, landmarks.normal_basis, problem.smooth_sigma, rows, residual
    )
    estimate = Estimate(views, points, pivot)
    prior = np.zeros((len(points), LANDMARK_SIZE, LANDMARK_SIZE))
    problem.priors.add_landmarks(estimate, prior, np.zeros_like(prior), np.zeros(prior.shape[:2]))
    plain = np.ascontiguousarray
    at = Linearised(
        cameras=cameras,
        points=landmarks,
        observed=Observed(
            plain(tracks.start),
            plain(tracks.view),
            plain(tracks.keypoint),
            plain(tracks.brightness),
            np.zeros((len(tracks), 2)) if slope is None else plain(slope),
            weights.keypoint,
            weights.brightness,
            weights.keypoint_limit,
            float(weights.brightness_limit),
        ),
        links=links(neighbours, rows),
        camera_prior=problem.of_cameras(estimate)[0],
        prior=prior,
        pivot=pivot,
        packed=np.zeros(3) if scene.reflectance is None else scene.reflectance.packed,
    )
    return at, residual


def error_model(noise: Noise, smoothness: np.ndarray, *, photometric: bool = True) -> ErrorModel:
    """What the errors are, over what the estimate takes them for. smoothness: (P,) whitened residuals.

    An error that n landmarks share has 1/n of the variance that it is weighed with. Of those nearby, all
    share it if n is as large as their number.
    """
    keypoint, brightness = noise.keypoint_correlation_px**2, noise.brightness_correlation_px**2

    def common(shared: float) -> float:
        return (min(shared, _NEARBY) - 1.0) / (_NEARBY - 1.0)

    return ErrorModel(
        keypoint=1.0 / keypoint,
        keypoint_common=common(keypoint),
        brightness=1.0 / brightness if photometric else 1.0,
        brightness_common=common(brightness) if photometric else 0.0,
        smoothness=float(np.mean(smoothness**2)) if len(smoothness) else 1.0,
    )


def scene_uncertainty(found: Marginals, views: Views, pivot: np.ndarray, mapped: np.ndarray) -> dict[str, np.ndarray]:
    """From local coordinates to those of `calibrate`; what was not measured is left out.

    Covariances of position, normal, rotation, center and sun, standard deviations of albedo, scale and bias.
    """
    count = len(views)
    blocks = found.camera.reshape(count, CAMERA_SIZE, count, CAMERA_SIZE)[range(count), :, range(count), :]
    to_cam = np.swapaxes(views.body_from_cam.rotation, 1, 2)
    to_center = np.concatenate(
        [-skew(views.body_from_cam.translation - pivot), np.broadcast_to(np.eye(3), (count, 3, 3))], axis=2
    )
    landmark = found.landmark[mapped]
    values = {
        "position": landmark[:, :3, :3],
        "normal": landmark[:, 3:5, 3:5],
        "albedo": np.sqrt(landmark[:, 5, 5]),
        "rotation": _transformed(to_cam, blocks[:, :3, :3]),
        "center": _transformed(to_center, blocks[:, :6, :6]),
        "sun": blocks[:, 6:8, 6:8],
        "scale": np.sqrt(blocks[:, 8, 8]),
        "bias": np.sqrt(blocks[:, 9, 9]),
    }
    return {name: np.ascontiguousarray(value) for name, value in values.items() if np.isfinite(value).any(0).all()}


def _transformed(by: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return by @ covariance @ np.swapaxes(by, 1, 2)
