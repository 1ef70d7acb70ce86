"""Macroscopic roughness after Hapke (1984), Icarus 59, 41-59: effective cosines, shadowing, and their derivatives.

Ground of mean slope theta-bar has the effective cosines mu0e and mue in place of those of incidence and emission, and
its radiance is S times that of smooth ground. With psi the azimuth between the planes of incidence and emission,
f = exp(-2 tan(psi / 2)), chi = 1 / sqrt(1 + pi tan^2 theta), and of each direction (x its cosine)

    E1  = exp(-2/pi cot theta cot i)    E2 = exp(-1/pi cot^2 theta cot^2 i)
    eta = chi (x + sin i tan theta E2 / (2 - E1))

the direction nearer to the normal (h) and the one farther from it (l) get

    mu_h = chi [h + sin h tan theta (cos psi E2_l + sin^2(psi/2) E2_h) / (2 - E1_l - psi/pi E1_h)]
    mu_l = chi [l + sin l tan theta (E2_l - sin^2(psi/2) E2_h) / (2 - E1_l - psi/pi E1_h)]
    S    = mue / eta_e  mu0 / eta_i  chi / (1 - f + f chi h / eta_h)

Derivatives follow formula by formula. A quantity q has q_x by the cosine of its own direction and q_t by theta;
gradients of several directions are by (h, l, cos psi, theta).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

_LEAST_SINE = 1e-9
"""Least sine of incidence and emission, by which azimuths and cotangents are divided."""
_IN_PLANE = 1e-12
"""Distance of cos psi from one within which both planes count as one, since derivatives by psi are infinite there."""


class _Direction(NamedTuple):
    """Terms of one direction alone, each followed by its derivatives."""

    sine: float
    sine_x: float
    e1: float
    e1_x: float
    e1_t: float
    e2: float
    e2_x: float
    e2_t: float
    eta: float
    eta_x: float
    eta_t: float


@njit(cache=True, nogil=True, inline="always")
def _direction(x, tan, chi, chi_t):
    """Terms of a direction of cosine x. tan: of theta."""
    squared = 1.0 - x * x
    if squared > _LEAST_SINE**2:
        sine = math.sqrt(squared)
        sine_x = -x / sine
    else:
        sine, sine_x = _LEAST_SINE, 0.0
    cot, cot_t = 1.0 / tan, -(1.0 + 1.0 / (tan * tan))
    own = x / sine
    own_x = (1.0 - own * sine_x) / sine
    product = cot * own
    e1 = math.exp(-2.0 / math.pi * product)
    by_product = -2.0 / math.pi * e1
    e1_x, e1_t = by_product * cot * own_x, by_product * cot_t * own
    e2 = math.exp(-product * product / math.pi)
    by_product = -2.0 / math.pi * product * e2
    e2_x, e2_t = by_product * cot * own_x, by_product * cot_t * own
    share = e2 / (2.0 - e1)
    share_x, share_t = (e2_x + share * e1_x) / (2.0 - e1), (e2_t + share * e1_t) / (2.0 - e1)
    bracket = x + sine * tan * share
    eta_x = chi * (1.0 + tan * (sine_x * share + sine * share_x))
    eta_t = chi_t * bracket + chi * sine * ((1.0 + tan * tan) * share + tan * share_t)
    return _Direction(sine, sine_x, e1, e1_x, e1_t, e2, e2_x, e2_t, chi * bracket, eta_x, eta_t)


@njit(cache=True, nogil=True, inline="always")
def _effective_cosines(h, l, cos_psi, psi, psi_c, tan, chi, chi_t, near, far):
    """mu_h, mu_l, and their gradients by (h, l, cos psi, theta). near, far: `_Direction` of h, of l; psi_c: by cos."""
    half2, share = 0.5 * (1.0 - cos_psi), psi / math.pi
    below = 2.0 - far.e1 - share * near.e1
    below_h, below_l = -share * near.e1_x, -far.e1_x
    below_c, below_t = -psi_c / math.pi * near.e1, -far.e1_t - share * near.e1_t

    a = (cos_psi * far.e2 + half2 * near.e2) / below
    a_h = (half2 * near.e2_x - a * below_h) / below
    a_l = (cos_psi * far.e2_x - a * below_l) / below
    a_c = (far.e2 - 0.5 * near.e2 - a * below_c) / below
    a_t = (cos_psi * far.e2_t + half2 * near.e2_t - a * below_t) / below
    b = (far.e2 - half2 * near.e2) / below
    b_h = (-half2 * near.e2_x - b * below_h) / below
    b_l = (far.e2_x - b * below_l) / below
    b_c = (0.5 * near.e2 - b * below_c) / below
    b_t = (far.e2_t - half2 * near.e2_t - b * below_t) / below

    tan_t = 1.0 + tan * tan
    of_h, of_l = chi * near.sine * tan, chi * far.sine * tan
    mu_h, mu_l = chi * h + of_h * a, chi * l + of_l * b
    mu_h_t = chi_t / chi * mu_h + chi * near.sine * (tan_t * a + tan * a_t)
    mu_l_t = chi_t / chi * mu_l + chi * far.sine * (tan_t * b + tan * b_t)
    by_h = (chi * (1.0 + near.sine_x * tan * a) + of_h * a_h, of_h * a_l, of_h * a_c, mu_h_t)
    by_l = (of_l * b_h, chi * (1.0 + far.sine_x * tan * b) + of_l * b_l, of_l * b_c, mu_l_t)
    return mu_h, mu_l, by_h, by_l


@njit(cache=True, nogil=True, inline="always")
def roughness_correction(mu0, mu, phase, theta):
    """Effective cosines and shadowing of ground of mean slope theta [rad], each with its gradient.

    mu0, mu: cosines of incidence and emission; phase [rad]. Returns mu0e, mue, S, and for each of the three its
    derivatives by mu0, mu, phase, theta.
    """
    if theta <= 0.0:
        return mu0, mu, 1.0, (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    tan = math.tan(theta)
    chi = 1.0 / math.sqrt(1.0 + math.pi * tan * tan)
    chi_t = -math.pi * tan * (1.0 + tan * tan) * chi * chi * chi
    i, e = _direction(mu0, tan, chi, chi_t), _direction(mu, tan, chi, chi_t)

    cos_psi = (math.cos(phase) - mu0 * mu) / (i.sine * e.sine)
    if abs(cos_psi) < 1.0 - _IN_PLANE:
        psi, sin_psi = math.acos(cos_psi), math.sqrt(1.0 - cos_psi * cos_psi)
        psi_c = -1.0 / sin_psi
        cos_psi_i = -mu / (i.sine * e.sine) - cos_psi * i.sine_x / i.sine
        cos_psi_e = -mu0 / (i.sine * e.sine) - cos_psi * e.sine_x / e.sine
        cos_psi_g = -math.sin(phase) / (i.sine * e.sine)
        f = math.exp(-2.0 * sin_psi / (1.0 + cos_psi))
        f_c = 2.0 * f / ((1.0 + cos_psi) * sin_psi)
    else:
        cos_psi = min(max(cos_psi, -1.0), 1.0)
        psi = math.acos(cos_psi)
        psi_c = cos_psi_i = cos_psi_e = cos_psi_g = f_c = 0.0
        f = math.exp(-2.0 * math.sqrt((1.0 - cos_psi) / (1.0 + cos_psi))) if cos_psi > 0.0 else 0.0

    if mu0 >= mu:
        mu0e, mue, of_i, of_e = _effective_cosines(mu0, mu, cos_psi, psi, psi_c, tan, chi, chi_t, i, e)
        mu0e_i, mu0e_e, mue_i, mue_e = of_i[0], of_i[1], of_e[0], of_e[1]
        last = mu0 / i.eta
        last_i, last_e, last_t = (1.0 - last * i.eta_x) / i.eta, 0.0, -last * i.eta_t / i.eta
    else:
        mue, mu0e, of_e, of_i = _effective_cosines(mu, mu0, cos_psi, psi, psi_c, tan, chi, chi_t, e, i)
        mu0e_i, mu0e_e, mue_i, mue_e = of_i[1], of_i[0], of_e[1], of_e[0]
        last = mu / e.eta
        last_i, last_e, last_t = 0.0, (1.0 - last * e.eta_x) / e.eta, -last * e.eta_t / e.eta
    mu0e_c, mu0e_t, mue_c, mue_t = of_i[2], of_i[3], of_e[2], of_e[3]

    below = 1.0 - f + f * chi * last
    seen, lit = mue / e.eta, mu0 / i.eta
    both = seen * lit
    shadowing = both * chi / below
    of_both, of_below = chi / below, -shadowing / below
    shadowing_i = of_both * (mue_i / e.eta * lit + seen * (1.0 - lit * i.eta_x) / i.eta) + of_below * f * chi * last_i
    shadowing_e = of_both * (mue_e - seen * e.eta_x) / e.eta * lit + of_below * f * chi * last_e
    shadowing_c = of_both * mue_c / e.eta * lit + of_below * f_c * (chi * last - 1.0)
    both_t = (mue_t - seen * e.eta_t) / e.eta * lit - both * i.eta_t / i.eta
    shadowing_t = of_both * both_t + both * chi_t / below + of_below * f * (chi_t * last + chi * last_t)

    by_mu0e = (mu0e_i + mu0e_c * cos_psi_i, mu0e_e + mu0e_c * cos_psi_e, mu0e_c * cos_psi_g, mu0e_t)
    by_mue = (mue_i + mue_c * cos_psi_i, mue_e + mue_c * cos_psi_e, mue_c * cos_psi_g, mue_t)
    s_i, s_e = shadowing_i + shadowing_c * cos_psi_i, shadowing_e + shadowing_c * cos_psi_e
    by_shadowing = (s_i, s_e, shadowing_c * cos_psi_g, shadowing_t)
    return mu0e, mue, shadowing, by_mu0e, by_mue, by_shadowing
