"""Views and reflectance models for the page: what regions and whole bodies have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from photoclinometry.model.geometry import Rigid
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Views
from photoclinometry.surface.relief import angles_from_sun


def views_content(
    views: Views,
    frame: Rigid,
    length: float,
    averaging: Sequence[float],
    pose_priors: Mapping[str, PosePrior] | None = None,
) -> list[dict[str, Any]]:
    """Camera, pose, Sun and exposure of each view, in the frame B from `frame` and lengths of `length` of B's unit.

    averaging: (K,) standard deviation of the Gaussian by which each view averages brightness over the map [landmarks].
    pose_priors: by name of view, in B; "prior" is None of views without one.
    """
    priors = pose_priors or {}
    found = []
    for k, name in enumerate(views.name):
        camera, pose = views.cameras[k], frame.inverse() @ views.body_from_cam[k]
        azimuth, elevation = np.degrees(angles_from_sun(frame, views.sun[k]))
        found.append(
            {
                "name": name,
                "width": camera.width,
                "height": camera.height,
                "focal": list(camera.focal_px),
                "principal": list(camera.principal_px),
                "local_from_cam": pose.rotation.tolist(),
                "center": (pose.translation * length).tolist(),
                "sun_azimuth_deg": azimuth,
                "sun_elevation_deg": elevation,
                "scale": float(views.scale[k]),
                "bias": float(views.bias[k]),
                "averaging": float(averaging[k]),
                "prior": _prior(priors[name], frame, length) if name in priors else None,
            }
        )
    return found


def _prior(prior: PosePrior, frame: Rigid, length: float) -> dict[str, Any]:
    """Pose and standard deviations, in the units of the page."""
    pose = frame.inverse() @ prior.cam_from_body.inverse()
    sigmas = {"center_sigma": prior.translation_sigma * length, "rotation_sigma": prior.rotation_sigma_rad}
    return {
        "local_from_cam": pose.rotation.tolist(),
        "center": (pose.translation * length).tolist(),
        # None for quantities that are not known at all: JSON has no infinite numbers.
        **{name: float(sigma) if np.isfinite(sigma) else None for name, sigma in sigmas.items()},
    }


def reflectance_content(reflectance: Reflectance | None) -> dict[str, Any] | None:
    """The model's statement for the graphics processor, and its numbers; None where the page cannot render."""
    if reflectance is None or reflectance.model.shader is None or not np.isfinite(reflectance.parameter_vector).all():
        return None
    names, units, _ = reflectance.described
    return {
        "name": reflectance.name,
        "shader": reflectance.model.shader,
        "parameter_vector": reflectance.parameter_vector.tolist(),
        "parameters": names,
        "units": units,
        "absolute": reflectance.predicts_absolute_brightness,
    }
