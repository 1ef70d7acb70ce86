"""Predictions of a scene for its observations: shading and brightness."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.reflectance import Reflectance, angles_at, photometric_function, photometric_value
from photoclinometry.model.scene import Scene, Views

BIAS_SIGMA = {"iof": 1e-3, "dn": 0.1}
"""Standard deviation of a view's bias as a share of the median brightness [-], by `Scene.brightness`: the offset of
calibrated images is subtracted to about a thousandth; that of uncalibrated ones is hardly known."""

ALL = slice(None)
"""Of the observations."""


def reflectance_of(scene: Scene) -> Reflectance:
    """The scene's reflectance model. Raises InputError where it has none."""
    if scene.reflectance is None:
        raise InputError(
            f"scene {scene.name!r} holds geometry alone (reflectance = none): it has no albedos to render; "
            "run again with a reflectance model"
        )
    return scene.reflectance


def exposure_is_free(brightness: str, reflectance: Reflectance) -> bool:
    """Whether only a view's own brightness determines its exposure. brightness: "iof" or "dn"."""
    return brightness == "dn" or not reflectance.predicts_absolute_brightness


def phase_of_views(scene: Scene) -> np.ndarray:
    """(K,) phase angle [rad] in the middle of the map."""
    middle = np.median(scene.landmarks.position, axis=0)
    return angle_between(scene.views.sun, scene.views.body_from_cam.translation - middle)


def observation_brightness(scene: Scene, which: np.ndarray | slice = ALL) -> np.ndarray:
    """Predicted brightness (n,) of observations `which`: scale * albedo * rho + bias (Eqs. 29, 30). Raises
    InputError."""
    views, landmark, view = scene.views, scene.tracks.landmark[which], scene.tracks.view[which]
    rho = shading(landmark, view, views, scene.landmarks.position, scene.landmarks.normal, reflectance_of(scene))[2]
    return views.scale[view] * scene.landmarks.albedo[landmark] * rho + views.bias[view]


def brightness_residuals(scene: Scene, which: np.ndarray | slice = ALL) -> np.ndarray:
    """Predicted minus measured brightness (n,) of observations `which`, lit or not. Raises InputError."""
    return observation_brightness(scene, which) - scene.tracks.brightness[which]


def shading(
    landmark: np.ndarray,
    view: np.ndarray,
    views: Views,
    position: np.ndarray,
    normal: np.ndarray,
    reflectance: Reflectance,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines of incidence and emission, and rho (Eq. 19), (N,) each, of landmarks as seen in views.

    landmark, view: (N,) indices; position, normal: (J, 3) in B. rho is brightness at albedo 1 and scale 1.
    """
    out = np.empty((3, len(view)))
    center = np.ascontiguousarray(views.body_from_cam.translation)
    _shade(landmark, view, center, views.sun, position, normal, reflectance.parameter_vector, out)
    return out[0], out[1], out[2]


@njit(cache=True, parallel=True, error_model="numpy")
def _shade(landmark, view, center, sun, position, normal, parameter_vector, out):
    """`shading` into out (3, N); as `reflectance.photometric_angles`, without its temporary arrays."""
    for n in prange(view.size):
        j, k = landmark[n], view[n]
        mu0, mu, phase = angles_at(sun[k], center[k], position[j], normal[j])
        out[0, n], out[1, n] = mu0, mu
        out[2, n] = photometric_value(parameter_vector, mu0, mu, phase)


def brightness_by_slope(scene: Scene) -> np.ndarray:
    """(N,) rate of change of each observation's predicted brightness as its landmark's normal turns, in the direction
    of the fastest change [per rad]. Zero where unlit or unseen. Raises InputError."""
    views, landmarks, tracks = scene.views, scene.landmarks, scene.tracks
    out = np.empty(len(tracks))
    center = np.ascontiguousarray(views.body_from_cam.translation)
    vector = reflectance_of(scene).parameter_vector
    _turn(tracks.landmark, tracks.view, center, views.sun, landmarks.position, landmarks.normal, vector, out)
    return out * landmarks.albedo[tracks.landmark] * views.scale[tracks.view]


@njit(cache=True, parallel=True, error_model="numpy")
def _turn(landmark, view, center, sun, position, normal, parameter_vector, out):
    """Length of the derivative of rho by the normal, in the tangent plane, into out (N,)."""
    for n in prange(view.size):
        j, k = landmark[n], view[n]
        mu0, mu, phase = angles_at(sun[k], center[k], position[j], normal[j])
        _, by_mu0, by_mu, _ = photometric_function(parameter_vector, mu0, mu, phase)
        to_x, to_y, to_z = center[k, 0] - position[j, 0], center[k, 1] - position[j, 1], center[k, 2] - position[j, 2]
        by_mu /= math.sqrt(to_x * to_x + to_y * to_y + to_z * to_z)
        x = by_mu0 * sun[k, 0] + by_mu * to_x
        y = by_mu0 * sun[k, 1] + by_mu * to_y
        z = by_mu0 * sun[k, 2] + by_mu * to_z
        along = x * normal[j, 0] + y * normal[j, 1] + z * normal[j, 2]
        out[n] = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
