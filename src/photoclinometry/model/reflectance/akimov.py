"""Akimov's disk function, as it is and with a phase weight (Akimov+)."""

from __future__ import annotations

import math

from numba import njit

from photoclinometry.model.reflectance.angles import PHASE_FLOOR
from photoclinometry.model.reflectance.entry import of_factors
from photoclinometry.model.reflectance.phase_functions import NO_PHASE_FUNCTION, POLYNOMIAL
from photoclinometry.model.reflectance.weighted import fixed, per_degree, weighted


@njit(cache=True)
def akimov(mu0, mu, phase, w0, w1):
    """Akimov's disk function with a phase weight (Akimov+; plain Akimov is g = 1)      (Eqs. 22, 24)

        d = cos(phase/2) cos[k (gamma - phase/2)] / cos(gamma)  cos(beta)^(g phase / (pi - phase)),
        k = pi / (pi - phase),  g = w0 + w1 phase

    gamma and beta: photometric longitude and latitude, tan(gamma) = (mu0/mu - cos phase) / sin phase,
    cos(beta) = mu / cos(gamma)  (Eqs. 27, 28; Eq. 22 prints eta for beta). Here they come from the normal's
    components in the scattering plane, mu towards the camera and t across it, and with
    delta = pi/2 - gamma = atan2(mu, t) the quotient of cosines is sin(k delta) / sin(delta): finite at the
    limb (delta = 0, where it is k), and zero at the terminator (k delta = pi).
    """
    sine = max(math.sin(phase), PHASE_FLOOR)
    cosine = math.cos(phase)
    g = w0 + w1 * phase
    k = math.pi / (math.pi - phase)
    t = (mu0 - mu * cosine) / sine
    across = mu * mu + t * t  # cos(beta)^2
    delta = math.atan2(mu, t)
    sin_delta = mu / math.sqrt(across)
    sin_k, cos_k = math.sin(k * delta), math.cos(k * delta)
    quotient = sin_k / sin_delta
    half = math.cos(0.5 * phase)
    exponent = g * (k - 1.0)  # phase / (pi - phase) = k - 1
    log_beta = 0.5 * math.log(across)
    power = math.exp(exponent * log_beta)
    d = half * quotient * power
    # partial derivatives through delta, t and the explicit phase
    d_delta = half * power * (k * cos_k - quotient * t / math.sqrt(across)) / sin_delta
    d_log_beta = d * exponent
    along_t = -d_delta * mu / across + d_log_beta * t / across
    along_mu = d_delta * t / across + d_log_beta * mu / across
    t_phase = mu - t * cosine / sine
    k_phase = k * k / math.pi
    d_phase = (
        -0.5 * math.sin(0.5 * phase) * quotient * power
        + half * power * cos_k * delta / sin_delta * k_phase
        + d * log_beta * (w1 * (k - 1.0) + g * k_phase)
        + along_t * t_phase
    )
    return d, along_t / sine, along_mu - along_t * cosine / sine, d_phase, d * log_beta * (k - 1.0)


SOURCE = "Shkuratov et al. (2011), PSS 59, 1326, doi:10.1016/j.pss.2011.06.011"

AKIMOV = of_factors(
    fixed(akimov, 1.0, 0.0, shader="akimov(mu0, mu, phase, 1.0)"),
    NO_PHASE_FUNCTION,
    name="akimov",
    source=SOURCE,
    predicts_absolute_brightness=False,
)

AKIMOV_PLUS = of_factors(
    weighted(akimov, shader="akimov"),
    POLYNOMIAL,
    name="akimov+",
    source=f"{SOURCE}; values: Schroeder et al. (2013, 2017)",
    open_ended=True,
    published={
        "vesta": per_degree(1.57, -9.88e-3, -1.9219e-2, 2.2193e-4, -1.6245e-6, 4.6468e-9),
        "ceres": per_degree(1.109, -2.85e-3, -2.2435e-2, 2.1477e-4, -7.5103e-7),
    },
)
