"""What is known of a scene's variables before an estimate, as options, calibration and navigation say it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust.options import AdjustOptions
from photoclinometry.adjust.priors import Priors
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import HAS_PHASE_FUNCTION
from photoclinometry.model.scene import Scene


@dataclass(frozen=True, kw_only=True)
class PosePriors:
    """What is known of poses beforehand, in the scene's frame B. It takes the place of the gauge's own priors."""

    body_from_cam: Rigid
    """(K,)."""
    rotation_sigma: np.ndarray
    """(K,) [rad], about each axis; infinite where nothing is known."""
    center_sigma: np.ndarray
    """(K,) in units of B, along each axis; infinite where nothing is known."""


def priors_of(scene: Scene, options: AdjustOptions, mapped: int, pose_priors: PosePriors | None) -> Priors:
    """What is known beforehand of a scene's variables; the first `mapped` landmarks are the map's own.

    Without pose priors the gauge is fixed, by the reference view's pose and one landmark.
    """
    views, landmarks, gsd = scene.views, scene.landmarks, scene.gsd
    count, free = len(views), np.full(len(landmarks), np.inf)
    rotation, translation, position = np.full(count, np.inf), np.full(count, np.inf), free.copy()
    if options.position_sigma_gsd is not None:
        position[:mapped] = options.position_sigma_gsd * gsd
    if pose_priors is None:
        rotation[scene.reference] = options.pose_rotation_sigma_rad
        translation[scene.reference] = options.pose_translation_sigma_gsd * gsd
        central = _central_landmark(scene, mapped)
        position[central] = min(position[central], options.landmark_sigma_gsd * gsd)
        poses = views.body_from_cam
    else:
        rotation, translation = pose_priors.rotation_sigma, pose_priors.center_sigma
        poses = pose_priors.body_from_cam
    scale, bias = _brightness_priors(scene, options)
    return Priors(
        views=replace(views, body_from_cam=poses, scale=np.ones(count), bias=np.zeros(count)),
        pose_rotation=rotation,
        pose_translation=translation,
        scale=scale,
        bias=bias,
        landmarks=landmarks,
        position=position,
        normal=np.full(len(landmarks), options.normal_sigma_rad or np.inf),
        albedo=free if options.albedo_sigma is None else options.albedo_sigma * landmarks.albedo,
        reflectance=options.reflectance_sigma or np.inf,
    )


def _brightness_priors(scene: Scene, options: AdjustOptions) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (K,) of scales and biases."""
    count, model = len(scene.views), scene.reflectance
    level = float(np.median(scene.tracks.brightness[scene.tracks.lit])) if np.any(scene.tracks.lit) else 1.0
    calibrated = scene.brightness == "iof" and model is not None and model.disk in HAS_PHASE_FUNCTION
    scale = np.full(count, options.scale_sigma or (0.01 if calibrated else np.inf))
    if not calibrated:
        scale[scene.reference] = min(scale[scene.reference], 1e-6)
    bias = options.bias_sigma or (1e-3 if scene.brightness == "iof" else 0.1) * level
    return scale, np.full(count, bias)


def _central_landmark(scene: Scene, mapped: int) -> int:
    """The landmark of most observations among those nearest to the middle of the map."""
    pixel = scene.landmarks.pixel[:mapped]
    offset = np.linalg.norm(pixel - np.median(pixel, axis=0), axis=1)
    nearest = np.argsort(offset, kind="stable")[: max(1, len(offset) // 100)]
    return int(nearest[np.argmax(np.diff(scene.tracks.start)[nearest])])
