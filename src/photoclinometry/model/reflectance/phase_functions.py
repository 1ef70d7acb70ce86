"""Phase functions: how brightness falls with the phase angle alone. All are 1 at phase 0."""

from __future__ import annotations

import math

from numba import njit

from photoclinometry.model.reflectance.angles import DEG
from photoclinometry.model.reflectance.entry import Parameter, Phase

LN_PER_MAGNITUDE = 0.4 * math.log(10.0)
"""A magnitude is a factor of 10^0.4 in brightness."""


@njit(cache=True, forceinline=True)
def constant(p, at, phase):
    """Lambda = 1."""
    return 1.0, 0.0


@njit(cache=True, forceinline=True)
def constant_by_parameters(p, at, phase, out):
    """Lambda; there are no parameters."""
    return 1.0


NO_PHASE_FUNCTION = Phase((), constant, constant_by_parameters, "1.0")


@njit(cache=True, forceinline=True)
def polynomial(p, at, phase):
    """Lambda = 1 + c_1 phase + c_2 phase^2 + ...                              (paper Eq. 20)"""
    value, slope = 0.0, 0.0
    for i in range(p.size - 1, at - 1, -1):  # Horner's scheme, c_0 = 1
        slope = slope * phase + value
        value = value * phase + p[i]
    slope = slope * phase + value
    value = value * phase + 1.0
    return value, slope


@njit(cache=True, forceinline=True)
def polynomial_by_parameters(p, at, phase, out):
    """Lambda; out: its derivatives phase, phase^2, ..."""
    value, power = 1.0, 1.0
    for i in range(at, p.size):
        power *= phase
        value += p[i] * power
        out[i - 1] = power
    return value


POLYNOMIAL = Phase(
    (Parameter(name="c", unit="1/rad", about="coefficients of the powers of phase in the phase function"),),
    polynomial,
    polynomial_by_parameters,
    "polynomial({at}, phase)",
)


@njit(cache=True, forceinline=True)
def magnitudes(p, at, phase):
    """Lambda = 10^(-0.4 (beta phase + gamma phase^2 + delta phase^3)); positive at every phase."""
    beta, gamma, delta = p[at], p[at + 1], p[at + 2]
    value = math.exp(-LN_PER_MAGNITUDE * phase * (beta + phase * (gamma + phase * delta)))
    return value, -LN_PER_MAGNITUDE * value * (beta + phase * (2.0 * gamma + phase * 3.0 * delta))


@njit(cache=True, forceinline=True)
def magnitudes_by_parameters(p, at, phase, out):
    """Lambda; out: its derivatives by beta, gamma, delta."""
    value = magnitudes(p, at, phase)[0]
    power = -LN_PER_MAGNITUDE * value
    for i in range(at - 1, at + 2):
        power *= phase
        out[i] = power
    return value


MAGNITUDES = Phase(
    (
        # 0.04 mag/deg at zero: slopes of asteroids are 0.02 (bright) to 0.05 mag/deg (dark).
        Parameter(
            name="beta",
            unit="mag/rad",
            about="linear slope of the phase function",
            default=0.04 * DEG,
            lower=0.0,
            upper=0.2 * DEG,
            prior_sigma=0.01 * DEG,
        ),
        # The sigmas bend the phase function by 0.2 magnitudes at 60 degrees.
        Parameter(name="gamma", unit="mag/rad^2", about="its bend", default=0.0, prior_sigma=0.2),
        Parameter(name="delta", unit="mag/rad^3", about="its third power", default=0.0, prior_sigma=0.2),
    ),
    magnitudes,
    magnitudes_by_parameters,
    "magnitudes({at}, phase)",
)
