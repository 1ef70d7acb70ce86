"""Parameters of a Gaussian's brightness: harmonics of the direction of view, or albedo, normal and the Sun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit

from photoclinometry.model.geometry import unit
from photoclinometry.model.reflectance import Reflectance, angles_at, photometric_function
from photoclinometry.rivals.gaussians import harmonics
from photoclinometry.rivals.gaussians.cloud import Cloud, rotations


@dataclass(frozen=True, kw_only=True)
class Light:
    """Properties of a view on which its brightness depends."""

    center: np.ndarray
    """(3,) of the camera, in B."""
    sun: np.ndarray
    """(3,) unit vector towards the Sun, in B."""
    scale: float
    """Brightness in units of the picture at albedo * rho = 1."""
    bias: float
    """Brightness of black ground, in units of the picture."""


class ColourBack(NamedTuple):
    """Derivatives of a loss."""

    by_colour: dict[str, np.ndarray]
    by_position: np.ndarray
    """(N, 3)."""
    by_normal: np.ndarray
    """(N, 3) by the third axis of each Gaussian."""


class Colour(Protocol):
    """The brightness of Gaussians."""

    def brightness(self, cloud: Cloud, light: Light) -> np.ndarray:
        """(N,) in units of the picture."""
        ...

    def back(self, cloud: Cloud, light: Light, by_brightness: np.ndarray) -> ColourBack:
        """Derivatives of a loss from those by `brightness` (N,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class HarmonicColour:
    """Spherical harmonics of the direction of view; `Cloud.colour` has "harmonics" (N, m)."""

    degree: int

    def brightness(self, cloud: Cloud, light: Light) -> np.ndarray:
        direction = unit(cloud.position - light.center)
        return harmonics.brightness(cloud.colour["harmonics"], direction, self.degree)

    def back(self, cloud: Cloud, light: Light, by_brightness: np.ndarray) -> ColourBack:
        offset = cloud.position - light.center
        distance = np.linalg.norm(offset, axis=-1, keepdims=True)
        direction = offset / distance
        by_coefficient, by_direction = harmonics.brightness_back(
            cloud.colour["harmonics"], direction, self.degree, by_brightness
        )
        along = np.sum(by_direction * direction, -1, keepdims=True)
        by_position = (by_direction - along * direction) / distance
        return ColourBack({"harmonics": by_coefficient}, by_position, np.zeros_like(by_position))


@dataclass(frozen=True, kw_only=True)
class ReflectanceColour:
    """scale albedo rho(n, s, e) + bias, n the Gaussian's third axis; `Cloud.colour` has "log_albedo" (N,)."""

    reflectance: Reflectance

    def brightness(self, cloud: Cloud, light: Light) -> np.ndarray:
        return light.scale * np.exp(cloud.colour["log_albedo"]) * self._shaded(cloud, light)[:, 0] + light.bias

    def back(self, cloud: Cloud, light: Light, by_brightness: np.ndarray) -> ColourBack:
        shaded = self._shaded(cloud, light)
        factor = (by_brightness * light.scale * np.exp(cloud.colour["log_albedo"]))[:, None]
        return ColourBack({"log_albedo": factor[:, 0] * shaded[:, 0]}, factor * shaded[:, 1:4], factor * shaded[:, 4:])

    def _shaded(self, cloud: Cloud, light: Light) -> np.ndarray:
        """(N, 7): rho, and its derivatives by position and by the third axis."""
        out = np.empty((len(cloud), 7))
        axis = np.ascontiguousarray(rotations(cloud.quaternion)[..., 2])
        _shade(cloud.position, axis, light.center, light.sun, self.reflectance.parameter_vector, out)
        return out


def outward(axis: np.ndarray, position: np.ndarray, center: np.ndarray) -> np.ndarray:
    """The third axes (N, 3) of Gaussians, turned towards a camera: a Gaussian has no inside."""
    away = np.sum(axis * (center - position), -1, keepdims=True) < 0
    return np.where(away, -axis, axis)


@njit(cache=True, error_model="numpy")
def _shade(position, axis, center, sun, parameter_vector, out):
    """rho and its derivatives into out (N, 7), with normals turned towards the camera."""
    for n in range(position.shape[0]):
        e, distance, facing = np.empty(3), 0.0, 0.0
        for k in range(3):
            e[k] = center[k] - position[n, k]
            distance += e[k] * e[k]
            facing += e[k] * axis[n, k]
        distance = np.sqrt(distance)
        sign = 1.0 if facing >= 0.0 else -1.0
        normal = sign * axis[n]
        mu0, mu, phase = angles_at(sun, center, position[n], normal)
        rho, by_mu0, by_mu, by_phase = photometric_function(parameter_vector, mu0, mu, phase)
        sine, cosine = max(np.sin(phase), 1e-9), np.cos(phase)
        out[n, 0] = rho
        for k in range(3):
            e[k] /= distance
            by_e_mu = -(normal[k] - mu * e[k]) / distance
            by_e_phase = (sun[k] - cosine * e[k]) / (distance * sine)
            out[n, 1 + k] = by_mu * by_e_mu + by_phase * by_e_phase
            out[n, 4 + k] = sign * (by_mu0 * sun[k] + by_mu * e[k])
