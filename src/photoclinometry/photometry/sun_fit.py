"""The Sun direction of an image from its own brightness, on ground whose normals and albedos are known.

Slopes are the gnomon: under a Sun turned by an angle, ground that faces it brightens and ground that faces away
darkens, by about that angle times the slope times the tangent of the incidence. The exposure is free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from photoclinometry.model.geometry import angle_between, sphere_step, tangent_basis, unit
from photoclinometry.model.reflectance import Reflectance, angles_at, photometric_value

STARTS, LOWEST_RAD = 200, np.radians(85.0)
"""Sun directions that are tried first, all over the sky down to this far from the zenith."""

STARTS_POINTS = 400
"""Points, about, that these are compared at."""

HUBER = 3.0
"""Residuals beyond this many standard deviations count less."""

LONGEST_STEP = 0.3
"""[rad], and of the gain's logarithm."""

DIFFERENCE = 1e-4
"""[rad] by which the Sun is moved for derivatives."""

PATCHES = 5
"""The ground is cut into PATCHES x PATCHES patches, whose residuals are taken for independent of each other."""


@dataclass(frozen=True, kw_only=True)
class Ground:
    """n points as one camera sees them."""

    position: np.ndarray
    """(n, 3) in B."""
    normal: np.ndarray
    """(n, 3) in B."""
    albedo: np.ndarray
    """(n,) up to a factor."""
    camera_center: np.ndarray
    """(3,) in B."""

    def __getitem__(self, index: slice) -> Ground:
        return Ground(
            position=self.position[index],
            normal=self.normal[index],
            albedo=self.albedo[index],
            camera_center=self.camera_center,
        )

    def radiance(self, suns: np.ndarray, reflectance: Reflectance) -> np.ndarray:
        """(S, n) albedo * rho (Eq. 19) under Sun directions (S, 3) in B; zero where unlit."""
        out = np.empty((len(suns), len(self.albedo)))
        _radiance(reflectance.packed, suns, self.camera_center, self.position, self.normal, self.albedo, out)
        return out


@njit(cache=True, error_model="numpy")
def _radiance(packed, suns, center, position, normal, albedo, out):
    for i in range(suns.shape[0]):
        for j in range(albedo.size):
            mu0, mu, phase = angles_at(suns[i], center, position[j], normal[j])
            out[i, j] = albedo[j] * photometric_value(packed, mu0, mu, phase)


@dataclass(frozen=True, kw_only=True)
class SunFit:
    """The Sun that explains an image best."""

    sun: np.ndarray
    """(3,) unit vector in B."""
    sigma: float
    """Standard deviation about each tangent axis [rad], of what differs from place to place in the image."""
    off: float
    """Angle [rad] from the Sun as stated."""
    explained: float
    """Correlation of the image's brightness with that of the ground under the fitted Sun."""


def fit_sun(
    ground: Ground, brightness: np.ndarray, stated: np.ndarray, reflectance: Reflectance, bias_sigma: float
) -> SunFit:
    """The Sun direction, gain and bias that minimise

        sum huber((gain * albedo * rho(sun) + bias - brightness) / sigma) + (bias / bias_sigma)^2

    brightness: (n,), divided by its median here; stated: (3,) the Sun as given, in B. The start is the best of `stated`
    and STARTS directions; sigma is 1.4826 times the median size of the residuals.
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


def _best_start(ground: Ground, brightness: np.ndarray, stated: np.ndarray, reflectance: Reflectance) -> np.ndarray:
    """The Sun (3,) of least misfit among the stated one and those all over the sky, at some of the points."""
    candidates = np.concatenate([stated[None], _sky(unit(ground.normal.mean(0)))])
    thin = slice(None, None, max(1, len(brightness) // STARTS_POINTS))
    misfits = [_misfit(brightness[thin], predicted) for predicted in ground[thin].radiance(candidates, reflectance)]
    return candidates[int(np.argmin(misfits))]


def _refine(
    ground: Ground, brightness: np.ndarray, sun: np.ndarray, reflectance: Reflectance, bias_sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    """The Sun (3,) by Gauss-Newton steps from a start, and the covariance (4, 4) of Sun, log gain and bias.

    The covariance is that of clustered errors, a patch of ground a cluster (Liang and Zeger 1986, Biometrika 73,
    doi:10.1093/biomet/73.1.13).
    """
    gain, bias = _median_gain(brightness, ground.radiance(sun[None], reflectance)[0]), 0.0
    prior = np.diag([1e-9, 1e-9, 1e-9, 1.0 / bias_sigma**2])
    for _ in range(30):
        score, information = _linearised(ground, brightness, reflectance, sun, gain, bias)
        step = np.linalg.solve(information + prior, score.sum(0) - prior @ [0.0, 0.0, 0.0, bias])
        step *= min(1.0, LONGEST_STEP / max(float(np.abs(step[:3]).max()), 1e-12))
        sun, gain, bias = sphere_step(sun, step[:2]), gain * float(np.exp(step[2])), bias + float(step[3])
        if np.linalg.norm(step) < 1e-5:
            break
    score, information = _linearised(ground, brightness, reflectance, sun, gain, bias)
    patches, spread = _by_patch(ground.position, score), np.linalg.inv(information + prior)
    return sun, spread @ (patches.T @ patches * len(patches) / max(len(patches) - 1, 1)) @ spread


def _linearised(
    ground: Ground, brightness: np.ndarray, reflectance: Reflectance, sun: np.ndarray, gain: float, bias: float
) -> tuple[np.ndarray, np.ndarray]:
    """Each point's negative gradient (n, 4) and the information (4, 4) of half the cost.

    By two steps of the Sun along the sphere [rad], the gain's logarithm and the bias; central differences for the Sun.
    """
    across = tangent_basis(sun).T * DIFFERENCE
    here, *around = gain * ground.radiance(np.stack([sun, *unit(sun + across), *unit(sun - across)]), reflectance)
    slopes = (around[0] - around[2], around[1] - around[3])
    jacobian = np.stack([slopes[0] / (2 * DIFFERENCE), slopes[1] / (2 * DIFFERENCE), here, np.ones_like(here)], -1)
    residual = brightness - here - bias
    sigma = max(1.4826 * float(np.median(np.abs(residual))), 1e-6)
    weight = np.minimum(1.0, HUBER * sigma / np.maximum(np.abs(residual), 1e-12)) / sigma**2
    return jacobian * (weight * residual)[:, None], (jacobian.T * weight) @ jacobian


def _sky(zenith: np.ndarray) -> np.ndarray:
    """(STARTS, 3) directions spread evenly about the zenith (a Fibonacci spiral)."""
    number = np.arange(STARTS)
    height = 1.0 - (number + 0.5) / STARTS * (1.0 - np.cos(LOWEST_RAD))
    azimuth = number * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    return across @ tangent_basis(zenith).T + height[:, None] * zenith


def _median_gain(brightness: np.ndarray, predicted: np.ndarray) -> float:
    lit = predicted > 0
    return float(np.median(brightness[lit] / predicted[lit])) if lit.any() else 1.0


def _misfit(brightness: np.ndarray, predicted: np.ndarray) -> float:
    """Median size of the residuals under the median gain; infinite where less than a tenth is lit."""
    if np.mean(predicted > 0) < 0.1:
        return np.inf
    return float(np.median(np.abs(brightness - _median_gain(brightness, predicted) * predicted)))


def _by_patch(position: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(patches, m) sums of values (n, m) over patches of ground, those that hold any."""
    plane = position[:, :2]
    low, high = np.percentile(plane, [1, 99], axis=0)
    cell = np.clip((plane - low) / np.maximum(high - low, 1e-12) * PATCHES, 0, PATCHES - 1).astype(int)
    _, patch = np.unique(cell[:, 0] * PATCHES + cell[:, 1], return_inverse=True)
    return np.stack([np.bincount(patch, column) for column in values.T], -1)
