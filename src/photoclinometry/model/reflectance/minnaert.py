"""Minnaert's disk function, with a polynomial phase function or one in magnitudes."""

from __future__ import annotations

import math

from numba import njit

from photoclinometry.model.reflectance.entry import Parameter, of_factors
from photoclinometry.model.reflectance.phase_functions import MAGNITUDES, POLYNOMIAL
from photoclinometry.model.reflectance.weighted import per_degree, weighted


@njit(cache=True)
def minnaert(mu0, mu, phase, w0, w1):
    """d = mu0^g mu^(g - 1),  g = w0 + w1 phase                                (paper Eq. 26)"""
    g = w0 + w1 * phase
    log0, log1 = math.log(mu0), math.log(mu)
    d = math.exp(g * log0 + (g - 1.0) * log1)
    return d, d * g / mu0, d * (g - 1.0) / mu, d * w1 * (log0 + log1), d * (log0 + log1)


MINNAERT = of_factors(
    weighted(minnaert, shader="minnaert"),
    POLYNOMIAL,
    name="minnaert",
    source="Minnaert (1941), ApJ 93, 403, doi:10.1086/144279; values: Schroeder et al. (2013, 2017)",
    open_ended=True,
    published={
        "vesta": per_degree(0.554, 4.35e-3, -1.6910e-2, 1.7807e-4, -9.7674e-7, 2.1063e-9),
        "ceres": per_degree(0.514, 5.09e-3, -2.2568e-2, 2.2297e-4, -7.3108e-7),
    },
)

K0 = Parameter(
    name="k0", unit="-", about="limb darkening at zero phase", default=0.5, lower=0.0, upper=1.0, prior_sigma=0.05
)
B = Parameter(name="b", unit="1/rad", about="change of limb darkening with phase", default=0.0, prior_sigma=0.2)

# Neutral defaults: at opposition the disk of a dark body is as bright at its limb as in its middle (k0 = 1/2).
MINNAERT_MAGNITUDES = of_factors(
    weighted(minnaert, (K0, B), shader="minnaert"),
    MAGNITUDES,
    name="minnaert-magnitudes",
    source="Takir et al. (2015), Icarus 252, 393; Golish et al. (2021), Icarus 357, 113724; defaults are neutral",
)
