"""The uncertainties of an adjusted scene: covariances as `Scene.uncertainty` holds them.

They are those of the errors, not of the weights. The estimate weighs n measurements that share an error as one, which
is right for parameters that all landmarks determine together. A landmark's own error is another matter: n shared errors
are not larger than each, so that its measurements count there with their own sigmas. Errors that all neighbours share
count in full, since smoothing over neighbours does not reduce them. Smoothness has the variance found in its residuals.

Where no pose is known but the gauge's, errors are those that remain after removal of the map's best similarity: its own
origin, orientation and size mean nothing. Otherwise they are in the frame of the pose priors.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.adjust.covariance.between_landmarks import LENGTHS, correlation_by_distance
from photoclinometry.adjust.covariance.linearized_graph import (
    LinearizedGraph,
    linearized_graph,
    loosely_held,
)
from photoclinometry.adjust.covariance.marginals import EXACT, ErrorModel, Marginals, PositionSmoothness, marginals
from photoclinometry.adjust.covariance.windows import links
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.similarity import SIMILARITY
from photoclinometry.adjust.graph.smoothness import Smoothness
from photoclinometry.adjust.graph.variables import VIEW_SIZE, Estimate
from photoclinometry.adjust.tie_points import Members
from photoclinometry.model.error_correlation import ErrorCorrelation
from photoclinometry.model.geometry import point_moves
from photoclinometry.model.scene import Views
from photoclinometry.model.sigma import UNTOLD_NORMAL_RAD
from photoclinometry.model.warning import warn

log = logging.getLogger(__name__)

OF_LANDMARKS = ("position", "normal", "albedo", "albedo_relative")
"""Quantities of landmarks; the others belong to views."""

ENDLESS_RAD2 = 1e9
"""In place of an infinite variance of a normal [rad^2]: far above UNTOLD_NORMAL_RAD's, so that it counts as none."""

_NEARBY = 25
"""Landmarks over which smoothness averages errors that are not shared."""


@dataclass(frozen=True, kw_only=True)
class Stated:
    """The uncertainties of an estimate, of the map's landmarks; all empty where they are not known."""

    uncertainty: dict[str, np.ndarray] = field(default_factory=dict)
    """`Scene.uncertainty`."""
    in_common: dict[str, np.ndarray] = field(default_factory=dict)
    """The parts of its variances that landmarks share, so that the brightness of one landmark does not measure them.
    For positions and normals it is the part due to errors of the frame, missing where uncertainties are relative to the
    map's own frame; for albedos the part due to errors of views and reflectance parameters."""
    parameter_variance: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(T,) of the reflectance parameters that are estimated, in their local coordinates."""
    frame: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    """(7, 7) covariance of the map's similarity error: rotation [rad], translation [units of B] and scale, about its
    middle; empty where the map has a frame of its own."""
    correlation: ErrorCorrelation | None = None
    """Of the errors of positions."""


def estimate_uncertainty(
    graph: FactorGraph,
    estimate: Estimate,
    *,
    keypoint_correlation: float,
    brightness_correlation: float,
    members: Members,
    own_frame: bool,
    stride: int,
    position_smoothness: Smoothness | None = None,
) -> Stated:
    """The uncertainties of an estimate.

    keypoint_correlation, brightness_correlation: sides of the squares of landmarks that share an error; own_frame: only
    the gauge is known of the frame; stride: between neighbouring landmarks [reference px]. position_smoothness: the
    smoothness that holds positions, where it is not the graph's. Empty, with a warning, where the measurements do not
    determine the views.
    """
    at = linearized_graph(graph, estimate)
    photometric, mapped = graph.with_brightness, members.of_map
    errors = error_model(
        keypoint_correlation, brightness_correlation, at.smooth_residual, members.direct, photometric=photometric
    )
    at = loosely_held(at) if own_frame else at
    errors = replace(errors, position_smoothness=_of_positions(at, errors, position_smoothness, estimate))
    try:
        found = marginals(at, errors, frame=mapped, keeps_frame=not own_frame)
    except np.linalg.LinAlgError:
        warn(log, "no-uncertainty", "no uncertainties: the measurements do not determine all views")
        return Stated()
    uncertainty = scene_uncertainty(found, estimate.views, estimate.pivot, mapped)
    estimated = uncertainty if photometric else ("position", "rotation", "center")
    albedo, relative = found.albedo_by_common[mapped].T
    in_common = {"albedo": albedo, "albedo_relative": relative}
    if found.of_frame is not None:
        in_common |= {"position": found.of_frame[mapped, :3, :3], "normal": found.of_frame[mapped, 3:5, 3:5]}
    parameter = np.diag(found.parameter).copy()
    frame = np.zeros((0, 0)) if found.frame is None else found.frame
    cell = estimate.landmarks.pixel[: members.count] / stride
    exact, shared_side = len(at) <= EXACT, keypoint_correlation
    share = correlation_by_distance(at, errors, found.common, cell, exact=exact, shared_side=shared_side)
    return Stated(
        uncertainty={name: uncertainty[name] for name in estimated},
        in_common=in_common,
        parameter_variance=parameter,
        frame=frame,
        correlation=ErrorCorrelation(
            length_px=stride * np.array(LENGTHS), share=share, frame=frame, pivot=estimate.pivot
        ),
    )


def _of_positions(
    at: LinearizedGraph, errors: ErrorModel, smoothness: Smoothness | None, estimate: Estimate
) -> PositionSmoothness | None:
    """The smoothness of positions, by `smoothness`, or by the graph's where that is None; None where it is that of
    normals.

    For positions, errors of brightness are independent: a common one moves neighbours by amounts of either sign, as
    their image gradients.
    """
    independent = replace(errors, brightness_common=0.0)
    if smoothness is None:
        return PositionSmoothness(at=at, errors=independent) if errors.brightness_common > 0.0 else None
    rows = smoothness.linearize(estimate, float)
    held = replace(at, links=links(rows.neighbours, rows.rows), smooth_residual=rows.residual)
    return PositionSmoothness(at=held, errors=replace(independent, smoothness=_as_found(rows.residual)))


def _as_found(residual: np.ndarray) -> float:
    """Variance of the errors of smoothness over the assumed one; residual: (P,) whitened."""
    return float(np.mean(residual**2)) if len(residual) else 1.0


def error_model(
    keypoint_correlation: float,
    brightness_correlation: float,
    smoothness: np.ndarray,
    direct: np.ndarray,
    *,
    photometric: bool = True,
) -> ErrorModel:
    """Variances of the errors, relative to those that weight the estimate. smoothness: (P,) whitened residuals.

    Correlations are sides of the squares of landmarks that share an error. An error that n landmarks share has 1/n of
    the variance that it is weighed with. Of those nearby, all share it if n is as large as their number. direct: (J,)
    bool, landmarks that brightness holds: keypoints have weights there as if good to many pixels, and are good to a
    tenth, so that their errors have no effect.
    """
    keypoint, brightness = keypoint_correlation**2, brightness_correlation**2

    def common(shared: float) -> float:
        return (min(shared, _NEARBY) - 1.0) / (_NEARBY - 1.0)

    return ErrorModel(
        keypoint=np.where(direct, 0.0, 1.0 / keypoint),
        keypoint_common=common(keypoint),
        brightness=1.0 / brightness if photometric else 1.0,
        brightness_common=common(brightness) if photometric else 0.0,
        smoothness=_as_found(smoothness),
    )


def with_local_errors(
    uncertainty: Mapping[str, np.ndarray], noise: np.ndarray, in_common: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """`Scene.uncertainty` with noise that varies from place to place.

    noise: (J,) factors on the variances of landmarks (`local_noise`), but for what is in common (`Stated`), by name.
    """
    found = dict(uncertainty)
    for name in ("position", "normal"):
        if name in found:
            common = in_common.get(name, np.zeros(found[name].shape[1:]))
            found[name] = common + noise[:, None, None] * _beyond(found[name], common)
    for name in ("albedo", "albedo_relative"):
        if name in found:
            common = in_common.get(name, np.zeros(len(noise)))
            found[name] = np.sqrt(common + noise * np.maximum(found[name] ** 2 - common, 0.0))
    return found


def bounded_normals(covariance: np.ndarray) -> np.ndarray:
    """Covariances (n, 2, 2) of normals [rad^2], with UNTOLD_NORMAL_RAD as a prior, since a normal points away from the
    ground. Some landmarks, such as those in a row along a hole that no Sun lights, have no or hardly any other
    information in some direction."""
    value, vector = np.linalg.eigh(np.where(np.isinf(covariance), ENDLESS_RAD2, covariance))
    value = np.maximum(value, 0.0)
    value /= 1.0 + value / UNTOLD_NORMAL_RAD**2
    return (vector * value[:, None, :]) @ np.swapaxes(vector, 1, 2)


def with_frame_error(
    uncertainty: Mapping[str, np.ndarray], position: np.ndarray, views: Views
) -> dict[str, np.ndarray]:
    """`Scene.uncertainty` with the effect of errors of single landmarks on the map's own frame: they turn and move all
    poses.

    position: (J, 3) of the landmarks that define the frame, by least squares. The effect is small (1e-4 degrees), but
    the reference view, on whose rays the landmarks lie, has no other error about one axis.
    """
    known = np.isfinite(uncertainty["position"]).all((1, 2))
    middle = position[known].mean(0)
    by_frame = point_moves(position[known], middle)
    flat = by_frame.reshape(-1, SIMILARITY)
    weighted = (uncertainty["position"][known] @ by_frame).reshape(flat.shape)
    inverse = np.linalg.inv(flat.T @ flat)
    frame = inverse @ (flat.T @ weighted) @ inverse
    pose = views.body_from_cam
    center = point_moves(pose.translation, middle)
    turned = np.swapaxes(pose.rotation, 1, 2) @ frame[:3, :3] @ pose.rotation
    moved = center @ frame @ np.swapaxes(center, 1, 2)
    return {**uncertainty, "rotation": uncertainty["rotation"] + turned, "center": uncertainty["center"] + moved}


def _beyond(whole: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Covariances (n, d, d) less a part of them; not negative in any direction, and infinite where the whole is."""
    known = np.isfinite(whole).all((1, 2))
    left = whole.copy()
    left[known] = (whole - part)[known]
    value, vector = np.linalg.eigh(left[known])
    left[known] = (vector * np.maximum(value, 0.0)[:, None, :]) @ np.swapaxes(vector, 1, 2)
    return left


def scene_uncertainty(found: Marginals, views: Views, pivot: np.ndarray, mapped: np.ndarray) -> dict[str, np.ndarray]:
    """From local coordinates to those of `Scene.uncertainty`; quantities that were not measured are left out.

    Covariances of position, normal, rotation, center and sun, standard deviations of albedo, scale and bias, and of
    albedos after the factor that all have in common (`albedo_relative`).
    """
    count = len(views)
    of_views = found.views[: VIEW_SIZE * count, : VIEW_SIZE * count]
    blocks = of_views.reshape(count, VIEW_SIZE, count, VIEW_SIZE)[range(count), :, range(count), :]
    to_cam = np.swapaxes(views.body_from_cam.rotation, 1, 2)
    to_center = point_moves(views.body_from_cam.translation, pivot)[:, :, :6]
    landmark = found.landmark[mapped]
    albedo = landmark[:, 5, 5]
    values = {
        "position": _known(landmark[:, :3, :3]),
        "normal": _known(landmark[:, 3:5, 3:5]),
        "albedo": np.sqrt(np.where(albedo < 0.0, np.inf, albedo)),  # rounding can make a few of them negative
        "albedo_relative": np.sqrt(found.albedo_relative[mapped]),
        "rotation": _transformed(to_cam, blocks[:, :3, :3]),
        "center": _transformed(to_center, blocks[:, :6, :6]),
        "sun": blocks[:, 6:8, 6:8],
        "scale": np.sqrt(blocks[:, 8, 8]),
        "bias": np.sqrt(blocks[:, 9, 9]),
    }
    return {name: np.ascontiguousarray(value) for name, value in values.items() if np.isfinite(value).any(0).all()}


def _transformed(by: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return by @ covariance @ np.swapaxes(by, 1, 2)


def _known(covariance: np.ndarray) -> np.ndarray:
    """Covariances (n, d, d); those that rounding made negative on an axis are not known: infinite there."""
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    unknown = np.any(variance < 0.0, axis=1)
    if not unknown.any():
        return covariance
    return np.where(unknown[:, None, None], np.diag(np.full(covariance.shape[-1], np.inf)), covariance)
