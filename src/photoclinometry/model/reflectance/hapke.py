"""Hapke's bidirectional reflectance: isotropic multiple scattering, shadow hiding, macroscopic roughness.

    I/F = w/4  mu0e / (mu0e + mue)  [(1 + B(g)) P(g) + H(mu0e) H(mue) - 1]  S(mu0, mu, g)

Hapke, "Theory of Reflectance and Emittance Spectroscopy", 2nd ed. (2012), without porosity and coherent
backscatter: B is the shadow-hiding surge B0 / (1 + tan(g / 2) / h), P the two-lobed Henyey-Greenstein
function, H the rational approximation (1 + 2 x) / (1 + 2 gamma x) of Hapke (1981), and the roughness
(effective cosines mu0e, mue and the shadowing factor S) that of Hapke (1984), Icarus 59, 41-59.

Derivatives of the roughness, which are long, are imaginary parts of values a tiny imaginary step away (Squire and Trapp
1998, SIAM Review 40, doi:10.1137/S003614459631241X), exact to rounding: its functions take real or complex numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from photoclinometry.model.reflectance.entry import Model, Parameter

_STEP = 1e-30
"""The imaginary step of an argument."""
_FLOOR = 1e-9
"""Of cosines and sines that something is divided by."""


@njit(cache=True, nogil=True, inline="always")
def _h(x, gamma):
    return (1.0 + 2.0 * x) / (1.0 + 2.0 * gamma * x)


@njit(cache=True, nogil=True, inline="always")
def _e1(cot_theta, cot_x):
    return np.exp(-2.0 / math.pi * cot_theta * cot_x)


@njit(cache=True, nogil=True, inline="always")
def _e2(cot_theta, cot_x):
    return np.exp(-((cot_theta * cot_x) ** 2) / math.pi)


@njit(cache=True, nogil=True, inline="always")
def _sine(cosine):
    squared = 1.0 - cosine * cosine
    return np.sqrt(squared) if squared.real > _FLOOR**2 else _FLOOR + 0.0 * cosine


@njit(cache=True, nogil=True)
def _roughness(mu0, mu, phase, theta):
    """Effective cosines mu0e, mue and the shadowing factor S for mean slope theta [rad] (Hapke 1984)."""
    sin_i, sin_e = _sine(mu0), _sine(mu)
    tan_theta = np.tan(theta)
    cot = 1.0 / tan_theta
    chi = 1.0 / np.sqrt(1.0 + math.pi * tan_theta * tan_theta)
    cos_psi = (np.cos(phase) - mu0 * mu) / (sin_i * sin_e)
    if abs(cos_psi.real) >= 1.0 - 1e-12:
        cos_psi = 0.0 * cos_psi + min(max(cos_psi.real, -1.0), 1.0)
        psi = 0.0 * cos_psi + math.acos(cos_psi.real)
    else:
        psi = np.arccos(cos_psi)
    half2 = 0.5 * (1.0 - cos_psi)  # sin^2(psi / 2)
    cot_i, cot_e = mu0 / sin_i, mu / sin_e
    e1_i, e1_e = _e1(cot, cot_i), _e1(cot, cot_e)
    e2_i, e2_e = _e2(cot, cot_i), _e2(cot, cot_e)
    eta_i = chi * (mu0 + sin_i * tan_theta * e2_i / (2.0 - e1_i))
    eta_e = chi * (mu + sin_e * tan_theta * e2_e / (2.0 - e1_e))
    if half2.real < 1e-24:
        f = 1.0 + 0.0 * half2
    elif half2.real > 1.0 - 1e-12:
        f = 0.0 * half2
    else:
        f = np.exp(-2.0 * np.sqrt(half2 / (1.0 - half2)))
    if mu0.real >= mu.real:  # incidence <= emission
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
    return mu0e, mue, shadowing


@njit(cache=True, nogil=True)
def _effective(mu0, mu, phase, theta):
    """`_roughness`, of smooth ground too, with effective cosines above zero."""
    if theta.real <= 0.0:
        return mu0, mu, 1.0 + 0.0 * mu0
    mu0e, mue, shadowing = _roughness(mu0, mu, phase, theta)
    if mu0e.real < _FLOOR:
        mu0e = _FLOOR + 0.0 * mu0e
    if mue.real < _FLOOR:
        mue = _FLOOR + 0.0 * mue
    return mu0e, mue, shadowing


@njit(cache=True, nogil=True)
def _scattered(mu0e, mue, shadowing, phase, w, b, c, b0, h):
    """I/F, and its partial derivatives by all nine."""
    cos_g, sin_g, bb = math.cos(phase), math.sin(phase), b * b
    near, far = 1.0 - 2.0 * b * cos_g + bb, 1.0 + 2.0 * b * cos_g + bb
    backward, forward = (1.0 - bb) / near**1.5, (1.0 - bb) / far**1.5
    particle = 0.5 * (1.0 + c) * backward + 0.5 * (1.0 - c) * forward
    tangent = math.tan(0.5 * phase)
    surge = b0 / (1.0 + tangent / h)
    gamma = math.sqrt(1.0 - w)
    h0, h1 = _h(mu0e, gamma), _h(mue, gamma)
    inner = (1.0 + surge) * particle + (h0 * h1 - 1.0)
    total = mu0e + mue
    value = 0.25 * w * mu0e / total * inner * shadowing

    each = 0.25 / total * inner * shadowing
    outer = 0.25 * w * mu0e / total * shadowing
    d0, d1 = 1.0 + 2.0 * gamma * mu0e, 1.0 + 2.0 * gamma * mue
    by_mu0e = each * w * mue / total + outer * h1 * 2.0 * (1.0 - gamma) / (d0 * d0)
    by_mue = -each * w * mu0e / total + outer * h0 * 2.0 * (1.0 - gamma) / (d1 * d1)
    by_gamma = -2.0 * (mu0e * h0 * h1 / d0 + mue * h0 * h1 / d1)
    backward_b = -backward * (2.0 * b / (1.0 - bb) + 3.0 * (b - cos_g) / near)
    forward_b = -forward * (2.0 * b / (1.0 - bb) + 3.0 * (b + cos_g) / far)
    particle_b = 0.5 * (1.0 + c) * backward_b + 0.5 * (1.0 - c) * forward_b
    particle_g = 1.5 * b * sin_g * ((1.0 - c) * forward / far - (1.0 + c) * backward / near)
    by_b0 = 1.0 / (1.0 + tangent / h)
    by_h = b0 * tangent * (by_b0 / h) ** 2
    surge_g = -0.5 * b0 / h * (1.0 + tangent * tangent) * by_b0 * by_b0
    return value, (
        by_mu0e,
        by_mue,
        0.25 * w * mu0e / total * inner,
        outer * (surge_g * particle + (1.0 + surge) * particle_g),
        each * mu0e - outer * by_gamma * 0.5 / gamma,
        outer * (1.0 + surge) * particle_b,
        outer * (1.0 + surge) * 0.5 * (backward - forward),
        outer * by_b0 * particle,
        outer * by_h * particle,
    )


@njit(cache=True, nogil=True)
def radiance(mu0, mu, phase, w, theta, b, c, b0, h):
    """I/F of a lit and seen surface of single-scattering albedo w.

    mu0, mu: cosines of incidence and emission; phase [rad]; theta: mean slope [rad]; b, c: Henyey-Greenstein lobes,
    asymmetry -b c (c = 1: only the backward lobe); b0, h: surge.
    """
    mu0e, mue, shadowing = _effective(mu0, mu, phase, theta)
    return _scattered(mu0e, mue, shadowing, phase, w, b, c, b0, h)[0]


@njit(cache=True, nogil=True, inline="always")
def _along(which, mu0, mu, phase, theta, partial):
    """Derivative, by one argument of `_effective`, of `radiance` as far as the effective cosines and shadowing tell."""
    step = _STEP * 1j
    mu0e, mue, shadowing = _effective(
        mu0 + step * (which == 0), mu + step * (which == 1), phase + step * (which == 2), theta + step * (which == 3)
    )
    return (partial[0] * mu0e.imag + partial[1] * mue.imag + partial[2] * shadowing.imag) / _STEP


@njit(cache=True, nogil=True)
def by_angles(mu0, mu, phase, w, theta, b, c, b0, h):
    """`radiance` and its partial derivatives by mu0, mu and phase."""
    mu0e, mue, shadowing = _effective(mu0, mu, phase, theta)
    value, partial = _scattered(mu0e, mue, shadowing, phase, w, b, c, b0, h)
    return (
        value,
        _along(0, mu0, mu, phase, theta, partial),
        _along(1, mu0, mu, phase, theta, partial),
        _along(2, mu0, mu, phase, theta, partial) + partial[3],
    )


@njit(cache=True, nogil=True)
def by_parameters(mu0, mu, phase, w, theta, b, c, b0, h):
    """`radiance` and its partial derivatives by w, theta, b, c, b0, h."""
    mu0e, mue, shadowing = _effective(mu0, mu, phase, theta)
    value, partial = _scattered(mu0e, mue, shadowing, phase, w, b, c, b0, h)
    by_theta = _along(3, mu0, mu, phase, theta, partial)
    return value, (partial[4], by_theta, partial[5], partial[6], partial[7], partial[8])


_INSIDE = 1e-6
"""Distance from w = 0, where nothing is scattered, w = 1, where derivatives are infinite, b = 1 and h = 0."""

PARAMETERS = (
    Parameter(
        name="w",
        unit="-",
        about="single-scattering albedo",
        default=0.23,
        lower=_INSIDE,
        upper=1.0 - _INSIDE,
        prior_sigma=0.05,
    ),
    Parameter(
        name="theta",
        unit="rad",
        about="mean slope theta-bar",
        default=math.radians(20.0),
        lower=0.0,
        upper=math.radians(89.0),
        prior_sigma=math.radians(5.0),
    ),
    Parameter(
        name="b",
        unit="-",
        about="width of the Henyey-Greenstein lobes",
        default=0.35,
        lower=0.0,
        upper=1.0 - _INSIDE,
        prior_sigma=0.05,
    ),
    # The asymmetry -b c is often all that is known; c alone is then not bounded.
    Parameter(name="c", unit="-", about="backward against forward lobe, usually -1 to 1", default=1.0, prior_sigma=0.1),
    Parameter(name="B0", unit="-", about="amplitude of the opposition surge", default=1.32, lower=0.0, prior_sigma=0.2),
    Parameter(
        name="h",
        unit="-",
        about="angular width parameter of the surge",
        default=0.08,
        lower=_INSIDE,
        prior_sigma=0.02,
    ),
)
"""Defaults are those of average S-type asteroids (Helfenstein and Veverka 1989, in Asteroids II, 557-593), with one
lobe. Priors are as wide as published analyses of one body differ: roughness of Ceres from 18 to 44 degrees at the
extremes, of Vesta from 18 to 25."""


class Ground(NamedTuple):
    """A body's typical ground."""

    w: float
    """Single-scattering albedo."""
    roughness_deg: float
    """Mean slope angle theta-bar."""
    b: float
    """Width of the Henyey-Greenstein lobes."""
    c: float
    """Backward against forward lobe, -1 to 1."""
    surge: float
    """Amplitude B0 of the opposition surge."""
    surge_width: float
    """Angular width parameter h of the surge [-]."""

    @property
    def values(self) -> tuple[float, ...]:
        """Of PARAMETERS."""
        return self.w, math.radians(self.roughness_deg), self.b, self.c, self.surge, self.surge_width


PUBLISHED = {
    # Li et al. (2012), Proc. IAU 10 (H16), 700 nm: w = 0.50, asymmetry -0.25, roughness 20 degrees; the
    # surge, which Dawn's phase angles hardly constrain, is the one below.
    "vesta": Ground(w=0.50, roughness_deg=20.0, b=0.25, c=1.0, surge=1.6, surge_width=0.06),
    # Ciarniello et al. (2017), A&A 598, A130, doi:10.1051/0004-6361/201629490, 0.55 um: w = 0.14,
    # asymmetry -b c = -0.11, roughness 29 degrees, surge of Helfenstein & Veverka (1989). They give the
    # asymmetry alone; b is the one with which their w has their geometric albedo, 0.094.
    "ceres": Ground(w=0.14, roughness_deg=29.0, b=0.316, c=0.348, surge=1.6, surge_width=0.06),
}


def _overhead(values: Sequence[float]) -> tuple[float, ...]:
    """I/F at mu0 = mu = 1, phase = 0, over which rho is taken, and its derivatives by the parameters."""
    value, by_parameter = by_parameters(1.0, 1.0, 0.0, *values)
    return value, *by_parameter


@njit(cache=True)
def _rho(p, mu0, mu, phase):
    """rho and its derivatives by mu0, mu, phase. p: `Model`'s, with `_overhead` from p[7] on."""
    overhead = p[7]
    value, by_mu0, by_mu, by_phase = by_angles(mu0, mu, phase, p[1], p[2], p[3], p[4], p[5], p[6])
    return value / overhead, by_mu0 / overhead, by_mu / overhead, by_phase / overhead


@njit(cache=True)
def _rho_alone(p, mu0, mu, phase):
    """rho, in a quarter of the time."""
    return radiance(mu0, mu, phase, p[1], p[2], p[3], p[4], p[5], p[6]) / p[7]


@njit(cache=True)
def _rho_by_parameters(p, mu0, mu, phase, out):
    """out (6,): derivatives of rho by the parameters."""
    overhead = p[7]
    value, by_parameter = by_parameters(mu0, mu, phase, p[1], p[2], p[3], p[4], p[5], p[6])
    for i in range(6):
        out[i] = (by_parameter[i] - value / overhead * p[8 + i]) / overhead


HAPKE = Model(
    name="hapke",
    source="Hapke (2012), Theory of Reflectance and Emittance Spectroscopy, 2nd ed.; values: see PUBLISHED",
    parameters=PARAMETERS,
    function=_rho,
    by_parameters=_rho_by_parameters,
    value=_rho_alone,
    shader="hapke(mu0, mu, phase)",
    constants=_overhead,
    published={body: ground.values for body, ground in PUBLISHED.items()},
)
