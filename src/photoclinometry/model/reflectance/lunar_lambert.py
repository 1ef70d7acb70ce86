"""Lambert's and Lommel and Seeliger's laws mixed: Lunar-Lambert, and McEwen's weight for it."""

from __future__ import annotations

import math

from numba import njit

from photoclinometry.model.reflectance.angles import DEG
from photoclinometry.model.reflectance.entry import of_factors
from photoclinometry.model.reflectance.phase_functions import NO_PHASE_FUNCTION, POLYNOMIAL
from photoclinometry.model.reflectance.weighted import fixed, per_degree, weighted


@njit(cache=True, inline="always")
def _mixed(mu0, mu, weight, weight_slope):
    """d = (1 - g) mu0 + g 2 mu0 / (mu0 + mu), its derivatives by mu0, mu, phase, and by g."""
    q = 1.0 / (mu0 + mu)
    seeliger = 2.0 * mu0 * q
    return (
        (1.0 - weight) * mu0 + weight * seeliger,
        (1.0 - weight) + weight * 2.0 * mu * q * q,
        -weight * 2.0 * mu0 * q * q,
        weight_slope * (seeliger - mu0),
        seeliger - mu0,
    )


@njit(cache=True)
def lunar_lambert(mu0, mu, phase, w0, w1):
    """d = (1 - g) mu0 + g 2 mu0 / (mu0 + mu),  g = w0 + w1 phase              (paper Eq. 25)"""
    return _mixed(mu0, mu, w0 + w1 * phase, w1)


@njit(cache=True)
def mcewen(mu0, mu, phase, w0, w1):
    """As Lunar-Lambert with g = exp(-phase / 60 deg); w0, w1 unused           (paper Eq. 23)"""
    weight = math.exp(-phase * DEG / 60.0)
    return _mixed(mu0, mu, weight, -weight * DEG / 60.0)


LUNAR_LAMBERT = of_factors(
    weighted(lunar_lambert, shader="lunar_lambert"),
    POLYNOMIAL,
    name="lunar-lambert",
    source="McEwen (1991), Icarus 92, 298, doi:10.1016/0019-1035(91)90053-V; values: Schroeder et al. (2013, 2017)",
    open_ended=True,
    published={
        "vesta": per_degree(0.830, -7.22e-3, -1.7160e-2, 1.8306e-4, -1.0399e-6, 2.3223e-9),
        "ceres": per_degree(0.896, -8.87e-3, -2.2118e-2, 2.0912e-4, -6.4209e-7),
    },
)

MCEWEN = of_factors(
    fixed(mcewen, shader="mcewen(mu0, mu, phase)"),
    NO_PHASE_FUNCTION,
    name="mcewen",
    source="McEwen (1991); exponential weight: Gaskell et al. (2008), doi:10.1111/j.1945-5100.2008.tb00692.x",
    predicts_absolute_brightness=False,
)
