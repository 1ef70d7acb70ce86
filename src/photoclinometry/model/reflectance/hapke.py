"""Hapke's bidirectional reflectance: isotropic multiple scattering, shadow hiding, macroscopic roughness.

    I/F = w/4  mu0e / (mu0e + mue)  [(1 + B(g)) P(g) + H(mu0e) H(mue) - 1]  S(mu0, mu, g)

Hapke, "Theory of Reflectance and Emittance Spectroscopy", 2nd ed. (2012), without porosity and coherent
backscatter: B is the shadow-hiding surge B0 / (1 + tan(g / 2) / h), P the two-lobed Henyey-Greenstein
function, H the rational approximation (1 + 2 x) / (1 + 2 gamma x) of Hapke (1981), and the effective cosines
mu0e, mue and the shadowing factor S those of `roughness`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from numba import njit

from photoclinometry.model.reflectance.entry import Model, Parameter
from photoclinometry.model.reflectance.roughness import roughness_correction


@njit(cache=True, nogil=True, inline="always")
def _h(x, gamma):
    return (1.0 + 2.0 * x) / (1.0 + 2.0 * gamma * x)


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
    mu0e, mue, shadowing = roughness_correction(mu0, mu, phase, theta)[:3]
    return _scattered(mu0e, mue, shadowing, phase, w, b, c, b0, h)[0]


@njit(cache=True, nogil=True)
def by_angles(mu0, mu, phase, w, theta, b, c, b0, h):
    """`radiance` and its partial derivatives by mu0, mu and phase."""
    mu0e, mue, shadowing, of_mu0e, of_mue, of_shadowing = roughness_correction(mu0, mu, phase, theta)
    value, partial = _scattered(mu0e, mue, shadowing, phase, w, b, c, b0, h)
    return (
        value,
        partial[0] * of_mu0e[0] + partial[1] * of_mue[0] + partial[2] * of_shadowing[0],
        partial[0] * of_mu0e[1] + partial[1] * of_mue[1] + partial[2] * of_shadowing[1],
        partial[0] * of_mu0e[2] + partial[1] * of_mue[2] + partial[2] * of_shadowing[2] + partial[3],
    )


@njit(cache=True, nogil=True)
def by_parameters(mu0, mu, phase, w, theta, b, c, b0, h):
    """`radiance` and its partial derivatives by w, theta, b, c, b0, h."""
    mu0e, mue, shadowing, of_mu0e, of_mue, of_shadowing = roughness_correction(mu0, mu, phase, theta)
    value, partial = _scattered(mu0e, mue, shadowing, phase, w, b, c, b0, h)
    by_theta = partial[0] * of_mu0e[3] + partial[1] * of_mue[3] + partial[2] * of_shadowing[3]
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


class TypicalGround(NamedTuple):
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
    "vesta": TypicalGround(w=0.50, roughness_deg=20.0, b=0.25, c=1.0, surge=1.6, surge_width=0.06),
    # Ciarniello et al. (2017), A&A 598, A130, doi:10.1051/0004-6361/201629490, 0.55 um: w = 0.14,
    # asymmetry -b c = -0.11, roughness 29 degrees, surge of Helfenstein & Veverka (1989). They give the
    # asymmetry alone; b is the one with which their w has their geometric albedo, 0.094.
    "ceres": TypicalGround(w=0.14, roughness_deg=29.0, b=0.316, c=0.348, surge=1.6, surge_width=0.06),
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
    """rho."""
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
