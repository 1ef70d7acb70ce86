"""Hapke's bidirectional reflectance: isotropic multiple scattering, shadow hiding, macroscopic roughness.

    I/F = w/4  mu0e / (mu0e + mue)  [(1 + B(g)) P(g) + H(mu0e) H(mue) - 1]  S(mu0, mu, g)

Hapke, "Theory of Reflectance and Emittance Spectroscopy", 2nd ed. (2012), without porosity and coherent
backscatter: B is the shadow-hiding surge B0 / (1 + tan(g / 2) / h), P the two-lobed Henyey-Greenstein
function, H the rational approximation (1 + 2 x) / (1 + 2 gamma x) of Hapke (1981), and the roughness
(effective cosines mu0e, mue and the shadowing factor S) that of Hapke (1984), Icarus 59, 41-59.

The state of a surface is its normal albedo: I/F at zero incidence, emission and phase, surge included. The
single-scattering albedo that has this normal albedo follows from `single_scattering_albedo`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from photoclinometry.errors import InputError

_MAX_SINGLE_SCATTERING = 0.9999


@njit(cache=True, nogil=True, inline="always")
def _h(x, gamma):
    return (1.0 + 2.0 * x) / (1.0 + 2.0 * gamma * x)


@njit(cache=True, nogil=True, inline="always")
def _e1(cot_theta, cot_x):
    return math.exp(-2.0 / math.pi * cot_theta * cot_x)


@njit(cache=True, nogil=True, inline="always")
def _e2(cot_theta, cot_x):
    return math.exp(-((cot_theta * cot_x) ** 2) / math.pi)


@njit(cache=True, nogil=True)
def _roughness(mu0, mu, phase, theta):
    """Effective cosines mu0e, mue and the shadowing factor S for mean slope theta [rad] (Hapke 1984)."""
    if theta <= 0.0:
        return mu0, mu, 1.0
    sin_i, sin_e = math.sqrt(max(1.0 - mu0 * mu0, 0.0)), math.sqrt(max(1.0 - mu * mu, 0.0))
    tan_theta = math.tan(theta)
    cot = 1.0 / tan_theta
    chi = 1.0 / math.sqrt(1.0 + math.pi * tan_theta * tan_theta)
    floor = 1e-9
    product = sin_i * sin_e
    cos_psi = (math.cos(phase) - mu0 * mu) / product if product > floor else 1.0
    cos_psi = min(max(cos_psi, -1.0), 1.0)
    psi = math.acos(cos_psi)
    half2 = 0.5 * (1.0 - cos_psi)  # sin^2(psi / 2)
    cot_i, cot_e = mu0 / max(sin_i, floor), mu / max(sin_e, floor)
    e1_i, e1_e = _e1(cot, cot_i), _e1(cot, cot_e)
    e2_i, e2_e = _e2(cot, cot_i), _e2(cot, cot_e)
    eta_i = chi * (mu0 + sin_i * tan_theta * e2_i / (2.0 - e1_i))
    eta_e = chi * (mu + sin_e * tan_theta * e2_e / (2.0 - e1_e))
    f = math.exp(-2.0 * math.sqrt(half2 / max(1.0 - half2, 1e-30)))
    if mu0 >= mu:  # incidence <= emission
        below = 2.0 - e1_e - psi / math.pi * e1_i
        mu0e = chi * (mu0 + sin_i * tan_theta * (cos_psi * e2_e + half2 * e2_i) / below)
        mue = chi * (mu + sin_e * tan_theta * (e2_e - half2 * e2_i) / below)
        last = mu0 / eta_i
    else:
        below = 2.0 - e1_i - psi / math.pi * e1_e
        mu0e = chi * (mu0 + sin_i * tan_theta * (e2_i - half2 * e2_e) / below)
        mue = chi * (mu + sin_e * tan_theta * (cos_psi * e2_i + half2 * e2_e) / below)
        last = mu / eta_e
    shadowing = mue / eta_e * mu0 / eta_i * chi / (1.0 - f + f * chi * last)
    return max(mu0e, 1e-9), max(mue, 1e-9), shadowing


@njit(cache=True, nogil=True)
def hapke(w, mu0, mu, phase, b, c, b0, h, theta):
    """I/F of a surface of single-scattering albedo w; zero where unlit or unseen.

    mu0, mu: cosines of incidence and emission; phase [rad]; b, c: Henyey-Greenstein lobes, asymmetry
    -b c (c = 1: only the backward lobe); b0, h: surge; theta: mean slope [rad].
    """
    if mu0 <= 0.0 or mu <= 0.0:
        return 0.0
    mu0e, mue, shadowing = _roughness(mu0, mu, phase, theta)
    cos_g, bb = math.cos(phase), b * b
    backward = (1.0 - bb) / (1.0 - 2.0 * b * cos_g + bb) ** 1.5
    forward = (1.0 - bb) / (1.0 + 2.0 * b * cos_g + bb) ** 1.5
    particle = 0.5 * (1.0 + c) * backward + 0.5 * (1.0 - c) * forward
    surge = b0 / (1.0 + math.tan(0.5 * phase) / h)
    gamma = math.sqrt(1.0 - w)
    multiple = _h(mu0e, gamma) * _h(mue, gamma) - 1.0
    return 0.25 * w * mu0e / (mu0e + mue) * ((1.0 + surge) * particle + multiple) * shadowing


@njit(cache=True, nogil=True)
def _evaluate(w, mu0, mu, phase, b, c, b0, h, theta, out):
    for n in range(out.size):
        out[n] = hapke(w[n], mu0[n], mu[n], phase[n], b, c, b0, h, theta)


@dataclass(frozen=True, kw_only=True)
class Hapke:
    """Parameters that the whole surface shares; its albedo varies from place to place."""

    b: float
    """Width of the Henyey-Greenstein lobes, 0 <= b < 1."""
    c: float = 1.0
    """Backward against forward lobe, -1 to 1."""
    surge: float
    """Amplitude B0 of the opposition surge."""
    surge_width: float
    """Angular width parameter h of the surge [-]."""
    roughness_deg: float
    """Mean slope angle theta-bar."""

    def __post_init__(self):
        if not (
            0 <= self.b < 1
            and -1 <= self.c <= 1
            and self.surge >= 0
            and self.surge_width > 0
            and 0 <= self.roughness_deg <= 60
        ):
            raise InputError(f"Hapke parameters out of range: {self}")

    @property
    def _shared(self) -> tuple[float, float, float, float, float]:
        return self.b, self.c, self.surge, self.surge_width, math.radians(self.roughness_deg)

    def from_single_scattering(self, w: ArrayLike, mu0: ArrayLike, mu: ArrayLike, phase: ArrayLike):
        """I/F for single-scattering albedo w, cosines mu0 and mu, phase [rad]; arrays of a common shape."""
        w, mu0, mu, phase = np.broadcast_arrays(*(np.asarray(x, float) for x in (w, mu0, mu, phase)))
        out = np.empty(w.size)
        _evaluate(w.ravel(), mu0.ravel(), mu.ravel(), phase.ravel(), *self._shared, out)
        return out.reshape(w.shape)

    def normal_albedo(self, w: np.ndarray) -> np.ndarray:
        """I/F at zero incidence, emission and phase of single-scattering albedo w."""
        return self.from_single_scattering(w, 1.0, 1.0, 0.0)

    def single_scattering_albedo(self, normal_albedo: np.ndarray) -> np.ndarray:
        """The inverse of `normal_albedo`, to 1e-6. Raises InputError for albedos that no w reaches."""
        w = 1.0 - np.linspace(1.0, math.sqrt(1.0 - _MAX_SINGLE_SCATTERING), 4001) ** 2
        table = self.normal_albedo(w)
        found = np.asarray(normal_albedo, float)
        if found.size and (np.nanmin(found) < 0 or np.nanmax(found) > table[-1]):
            raise InputError(
                f"normal albedo from {np.nanmin(found):.3g} to {np.nanmax(found):.3g}: this Hapke model "
                f"reaches 0 to {table[-1]:.3g}; lower the albedo"
            )
        return np.interp(found, table, w)

    def radiance_factor(self, albedo: np.ndarray, mu0, mu, phase) -> np.ndarray:
        """I/F for normal albedo, cosines mu0 and mu, phase [rad]; arrays of a common shape."""
        return self.from_single_scattering(self.single_scattering_albedo(albedo), mu0, mu, phase)


BODIES = {
    # Li et al. (2012), Proc. IAU 10 (H16), 700 nm: w = 0.50, asymmetry -0.25, roughness 20 degrees; the
    # surge, which Dawn's phase angles hardly constrain, is the one below.
    "vesta": Hapke(b=0.25, surge=1.6, surge_width=0.06, roughness_deg=20.0),
    # Ciarniello et al. (2017), A&A 598, A130, doi:10.1051/0004-6361/201629490, 0.55 um: w = 0.14,
    # asymmetry -b c = -0.11, roughness 29 degrees, surge of Helfenstein & Veverka (1989). They give the
    # asymmetry alone; b is the one with which their w has their geometric albedo, 0.094.
    "ceres": Hapke(b=0.316, c=0.348, surge=1.6, surge_width=0.06, roughness_deg=29.0),
}


def published_hapke(body: str | None) -> Hapke:
    """Parameters of "vesta" or "ceres"; sources beside `BODIES`. Raises InputError."""
    key = (body or "").lower()
    if key not in BODIES:
        raise InputError(f"no Hapke parameters for body {body!r}; known: {', '.join(BODIES)}")
    return BODIES[key]
