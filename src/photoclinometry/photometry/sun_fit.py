"""The Sun direction of an image from its own brightness, on ground whose normals and albedos are known.

Shading depends on the Sun's direction: if the Sun turns by an angle, ground that faces it brightens and ground that
faces away darkens, by about that angle times the slope times the tangent of the incidence. The exposure is free.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from photoclinometry.model.gauss_newton import gauss_newton
from photoclinometry.model.geometry import angle_between, sphere_step, tangent_basis, unit
from photoclinometry.model.reflectance import GRAZING, Reflectance, angles_at, photometric_value
from photoclinometry.model.robust import huber_weight, robust_sigma
from photoclinometry.model.tiny import TINY

STARTS = 200
"""Sun directions that are tried first: one for each 10 x 10 degrees of the sky, within the reach of the steps.
They reach down to GRAZING; a lower Sun lights too little ground to be fitted."""

STARTS_POINTS = 400
"""Points, about, at which these directions are compared: enough to rank them, and a fraction of the time of all."""

LONGEST_STEP = 0.3
"""Bound on a step of the Sun [rad] and of the gain's logarithm: the brightness is nearly linear within it."""

DIFFERENCE_RAD = 1e-4
"""Turn of the Sun for central differences: their errors by curvature (1e-8) and by rounding (1e-12) are both small."""

MIN_LIT_SHARE = 0.1
"""A Sun that lights less than this share of the ground that an image shows bright is impossible; the share allows for
errors of coarse normals."""

PATCHES = 5
"""The ground is divided into PATCHES x PATCHES patches. Residuals are correlated over relief and albedo features; sums
over patches are assumed independent, and 25 of them give the covariance to about 30 %."""

_LEAST_SIGMA = 1e-6
"""Least standard deviation of the residuals, relative to the median brightness: exact brightness has none."""

_WEAK = 1e-9
"""Information added to the Sun's and the gain's, to keep the equations regular on ground without slopes: a standard
deviation of 3e4 rad, so that it has no effect elsewhere."""


@dataclass(frozen=True, kw_only=True)
class SeenGround:
    """n points as one camera sees them."""

    position: np.ndarray
    """(n, 3) in B."""
    normal: np.ndarray
    """(n, 3) in B."""
    albedo: np.ndarray
    """(n,) up to a factor."""
    camera_center: np.ndarray
    """(3,) in B."""

    def __getitem__(self, index: slice) -> SeenGround:
        return SeenGround(
            position=self.position[index],
            normal=self.normal[index],
            albedo=self.albedo[index],
            camera_center=self.camera_center,
        )

    def radiance(self, suns: np.ndarray, reflectance: Reflectance) -> np.ndarray:
        """(S, n) albedo * rho (Eq. 19) under Sun directions (S, 3) in B; zero where unlit."""
        out = np.empty((len(suns), len(self.albedo)))
        _radiance(reflectance.parameter_vector, suns, self.camera_center, self.position, self.normal, self.albedo, out)
        return out


@njit(cache=True, error_model="numpy")
def _radiance(parameter_vector, suns, center, position, normal, albedo, out):
    for i in range(suns.shape[0]):
        for j in range(albedo.size):
            mu0, mu, phase = angles_at(suns[i], center, position[j], normal[j])
            out[i, j] = albedo[j] * photometric_value(parameter_vector, mu0, mu, phase)


@dataclass(frozen=True, kw_only=True)
class SunFit:
    """The Sun that explains an image best."""

    sun: np.ndarray
    """(3,) unit vector in B."""
    sigma: float
    """Standard deviation about each tangent axis [rad], from the residuals' scatter over the ground's patches."""
    off: float
    """Angle [rad] from the Sun as stated."""
    explained: float
    """Correlation of the image's brightness with that of the ground under the fitted Sun."""


class _Light(NamedTuple):
    """The fitted parameters."""

    sun: np.ndarray
    """(3,) unit vector in B."""
    gain: float
    bias: float
    """Of the median brightness."""

    def moved(self, step: np.ndarray) -> _Light:
        """After a step (4,): the Sun along the sphere [rad], the gain's logarithm, the bias."""
        return _Light(sphere_step(self.sun, step[:2]), self.gain * float(np.exp(step[2])), self.bias + float(step[3]))


def fit_sun(
    ground: SeenGround, brightness: np.ndarray, stated: np.ndarray, reflectance: Reflectance, bias_sigma: float
) -> SunFit:
    """The Sun direction, gain and bias that minimise

        sum huber((gain * albedo * rho(sun) + bias - brightness) / sigma) + (bias / bias_sigma)^2

    brightness: (n,), divided by its median here; stated: (3,) the Sun as given, in B; bias_sigma: relative to the
    median brightness. The start is the best of `stated` and STARTS directions; sigma is the robust standard deviation
    of the residuals, updated in each iteration.
    """
    brightness = brightness / np.median(brightness)
    start = _best_start(ground, brightness, stated, reflectance)
    sun, covariance = _refine(ground, brightness, start, reflectance, bias_sigma)
    predicted = ground.radiance(sun[None], reflectance)[0]
    varies = np.std(predicted) > 0 and np.std(brightness) > 0
    return SunFit(
        sun=sun,
        sigma=float(np.sqrt(np.trace(covariance[:2, :2]) / 2)),
        off=float(angle_between(sun, stated)),
        explained=float(np.corrcoef(predicted, brightness)[0, 1]) if varies else 0.0,
    )


def _best_start(ground: SeenGround, brightness: np.ndarray, stated: np.ndarray, reflectance: Reflectance) -> np.ndarray:
    """The Sun (3,) of least cost among the stated one and those all over the sky, at some of the points."""
    candidates = np.concatenate([stated[None], _sky(unit(ground.normal.mean(0)))])
    thin = slice(None, None, max(1, len(brightness) // STARTS_POINTS))
    cost = [
        _median_residual(brightness[thin], predicted) for predicted in ground[thin].radiance(candidates, reflectance)
    ]
    return candidates[int(np.argmin(cost))]


def _refine(
    ground: SeenGround, brightness: np.ndarray, sun: np.ndarray, reflectance: Reflectance, bias_sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    """The Sun (3,) by Gauss-Newton steps from a start, and the covariance (4, 4) of Sun, log gain and bias.

    The covariance is that of clustered errors, a patch of ground a cluster (Liang and Zeger 1986, Biometrika 73,
    doi:10.1093/biomet/73.1.13).
    """
    prior = np.diag([_WEAK, _WEAK, _WEAK, 1.0 / bias_sigma**2])

    def linearize(light: _Light) -> tuple[np.ndarray, np.ndarray]:
        gradient, information = _linearized(ground, brightness, reflectance, light)
        return gradient.sum(0) + prior @ [0.0, 0.0, 0.0, light.bias], information + prior

    start = _Light(sun, _median_gain(brightness, ground.radiance(sun[None], reflectance)[0]), 0.0)
    longest = np.array([LONGEST_STEP, LONGEST_STEP, LONGEST_STEP, np.inf])
    light = gauss_newton(start, linearize, _Light.moved, longest=longest).state
    gradient, information = _linearized(ground, brightness, reflectance, light)
    patches, spread = _by_patch(ground.position, gradient), np.linalg.inv(information + prior)
    return light.sun, spread @ (patches.T @ patches * len(patches) / max(len(patches) - 1, 1)) @ spread


def _linearized(
    ground: SeenGround, brightness: np.ndarray, reflectance: Reflectance, light: _Light
) -> tuple[np.ndarray, np.ndarray]:
    """Each point's gradient (n, 4) and the information (4, 4) of half the cost, without the prior.

    By a step as in `_Light.moved`; central differences for the Sun.
    """
    across = tangent_basis(light.sun).T * DIFFERENCE_RAD
    suns = np.stack([light.sun, *unit(light.sun + across), *unit(light.sun - across)])
    here, *around = light.gain * ground.radiance(suns, reflectance)
    by_sun = ((around[0] - around[2]) / (2 * DIFFERENCE_RAD), (around[1] - around[3]) / (2 * DIFFERENCE_RAD))
    jacobian = np.stack([*by_sun, here, np.ones_like(here)], -1)
    residual = here + light.bias - brightness
    sigma = max(robust_sigma(residual), _LEAST_SIGMA)
    weight = huber_weight(np.abs(residual) / sigma) / sigma**2
    return jacobian * (weight * residual)[:, None], (jacobian.T * weight) @ jacobian


def _sky(zenith: np.ndarray) -> np.ndarray:
    """(STARTS, 3) directions spread evenly about the zenith (a Fibonacci spiral)."""
    number = np.arange(STARTS)
    height = 1.0 - (number + 0.5) / STARTS * (1.0 - GRAZING)
    golden_angle = np.pi * (3.0 - np.sqrt(5.0))
    azimuth = number * golden_angle
    across = np.sqrt(1.0 - height**2)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    return across @ tangent_basis(zenith).T + height[:, None] * zenith


def _median_gain(brightness: np.ndarray, predicted: np.ndarray) -> float:
    lit = predicted > 0
    return float(np.median(brightness[lit] / predicted[lit])) if lit.any() else 1.0


def _median_residual(brightness: np.ndarray, predicted: np.ndarray) -> float:
    """Median size of the residuals under the median gain; infinite where less than MIN_LIT_SHARE is lit."""
    if np.mean(predicted > 0) < MIN_LIT_SHARE:
        return np.inf
    return float(np.median(np.abs(brightness - _median_gain(brightness, predicted) * predicted)))


def _by_patch(position: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(patches, m) sums of values (n, m) over patches of ground, those that hold any.

    Patches divide the range of the first two coordinates, without the outermost per cent of points, which may be
    outliers; these count to the patches at the edge.
    """
    plane = position[:, :2]
    low, high = np.percentile(plane, [1, 99], axis=0)
    cell = np.clip((plane - low) / np.maximum(high - low, TINY) * PATCHES, 0, PATCHES - 1).astype(int)
    _, patch = np.unique(cell[:, 0] * PATCHES + cell[:, 1], return_inverse=True)
    return np.stack([np.bincount(patch, column) for column in values.T], -1)
