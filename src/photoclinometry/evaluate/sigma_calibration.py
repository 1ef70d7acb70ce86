"""Comparison of the standard deviations that a scene states with its errors against the truth.

The quantities of `Scene.uncertainty`, each as (n,) equal in all directions, (n, d) along each axis, or (n, d, d)
covariances:

    position     d = 3 along B's axes          rotation                d = 3 about C's axes [rad]
    normal, sun  d = 2 in `tangent_basis` of   translation or center   d = 3 along B's axes (camera centres)
                 the estimate [rad]            albedo, scale, bias     d = 1
    albedo_relative  d = 1, of albedos after the factor that all have in common
"""

from __future__ import annotations

import numpy as np

from photoclinometry.evaluate.metrics import albedo_factor as common_factor
from photoclinometry.evaluate.metrics import calibration
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import (
    Rigid,
    Similarity,
    align_similarity,
    angle_between,
    so3_log,
    tangent_basis,
    unit,
)
from photoclinometry.model.scene import BODY_FIXED, Landmarks, Scene, Views
from photoclinometry.model.sigma import sigma_along
from photoclinometry.surface.relief import local_frame


def sigma_metrics(scene: Scene, true_views: Views, true: Landmarks, albedo_factor: float) -> dict[str, float]:
    """`metrics.calibration` of the quantities in `scene.uncertainty` with known truth, and of heights (`height`).

    Heights are over the mean plane, since most of the error of positions is along the line of sight.

    true_views: the scene's views, in order; true: the truth behind each landmark, NaN where there is none; both in
    one frame. A scene made from images alone is aligned with it by least squares over the landmarks. A body-fixed scene
    is not aligned: the error of its frame belongs to its stated uncertainties. albedo_factor: true albedo over that of
    the scene. Raises InputError for uncertainties of an invalid shape.
    """
    metrics: dict[str, float] = {}
    if not scene.uncertainty:
        return metrics
    errors = scene_errors(scene, true_views, true, albedo_factor)
    for name, stated in scene.uncertainty.items():
        if name not in errors:
            continue
        try:
            metrics |= calibration(errors[name], stated, f"{name}_sigma")
        except ValueError as error:
            raise InputError(f"scene {scene.name!r}: uncertainty of {name}: {error}") from error
    if "position" in scene.uncertainty:
        up = local_frame(scene).rotation[:, 2]
        metrics |= calibration(errors["position"] @ up, sigma_along(scene.uncertainty["position"], up), "height_sigma")
    return metrics


def scene_errors(scene: Scene, true_views: Views, true: Landmarks, albedo_factor: float) -> dict[str, np.ndarray]:
    """Estimate minus truth in the coordinates of the module's table, in the frame and unit of the scene.

    Scales of uncalibrated images are in units of the reference view's, which no measurement determines and the estimate
    holds.
    """
    known = np.isfinite(true.position).all(-1)
    scene_from_true = Similarity(1.0, np.eye(3), np.zeros(3))
    if scene.frame != BODY_FIXED:
        scene_from_true = align_similarity(true.position[known], scene.landmarks.position[known])
    poses = true_views.body_from_cam
    true_poses = Rigid(scene_from_true.rotation @ poses.rotation, scene_from_true(poses.translation))
    turn = np.swapaxes(true_poses.rotation, -1, -2) @ scene.views.body_from_cam.rotation
    center = scene.views.body_from_cam.translation - true_poses.translation
    albedo, scale, reference = scene.landmarks.albedo, scene.views.scale, scene.reference
    scale_factor = albedo_factor if scene.brightness == "iof" else scale[reference] / true_views.scale[reference]
    return {
        "position": scene.landmarks.position - scene_from_true(true.position),
        "normal": tangent_error(scene.landmarks.normal, true.normal @ scene_from_true.rotation.T),
        "albedo": albedo - true.albedo / albedo_factor,
        "albedo_relative": albedo - true.albedo / common_factor(albedo, true.albedo),
        "rotation": so3_log(turn),
        "translation": center,
        "center": center,
        "sun": tangent_error(scene.views.sun, true_views.sun @ scene_from_true.rotation.T),
        "scale": scale - true_views.scale * scale_factor,
        "bias": scene.views.offset - true_views.offset,
    }


def tangent_error(direction: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Steps (n, 2) [rad] in `tangent_basis(direction)` from unit vectors (n, 3) to the true ones; NaN stays NaN.

    Their length is the angle between the two (the inverse of `sphere_step`).
    """
    across = np.einsum("nij,ni->nj", tangent_basis(direction), true)
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = angle_between(direction, true)[:, None]
    return np.where(length > 0, unit(np.where(length > 0, across, 1.0)) * angle, across)
