"""The compiled entry points: one function for all models, which looks at the model's number.

parameter_vector (1 + n,) float64, `Reflectance.parameter_vector`: the model's number, its parameters, and the numbers
of `Model.constants`.
"""

from __future__ import annotations

from collections.abc import Sequence

from numba import njit

from photoclinometry.model.reflectance.angles import GRAZING
from photoclinometry.model.reflectance.entry import Compiled
from photoclinometry.model.reflectance.models import MODELS


def _one_of(functions: Sequence[Compiled], first: int = 0) -> Compiled:
    """A compiled function (p, ...), p the parameter vector, that calls functions[p[0] - first](p, ...)."""
    function = functions[0]
    if len(functions) == 1:
        return function
    others = _one_of(functions[1:], first + 1)

    @njit(forceinline=True)
    def chosen(parameter_vector, *arguments):
        if parameter_vector[0] == first:
            return function(parameter_vector, *arguments)
        return others(parameter_vector, *arguments)

    return chosen


_function = _one_of([model.function for model in MODELS.values()])
_value = _one_of([model.value for model in MODELS.values()])
_by_parameters = _one_of([model.by_parameters for model in MODELS.values()])


@njit(cache=True)
def photometric_function(parameter_vector, mu0, mu, phase):
    """rho and its partial derivatives by mu0, mu, phase (paper Eq. 19).

    parameter_vector: `Reflectance.parameter_vector`. mu0, mu: cosines of incidence and emission; phase [rad]. All zero
    where unlit or unseen (mu0 <= 0 or mu <= 0).
    """
    if mu0 <= 0.0 or mu <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    return _function(parameter_vector, mu0, mu, phase)


@njit(cache=True)
def continued_function(parameter_vector, mu0, mu, phase):
    """`photometric_function`, with emission beyond GRAZING_DEG as at that angle: the function that estimates minimise.

    rho is not zero at an emission of 90 degrees. Ground that is estimated to turn away from a camera that does see it
    would make the cost jump there, and no step could cross.
    """
    if mu >= GRAZING:
        return photometric_function(parameter_vector, mu0, mu, phase)
    rho, by_mu0, _, by_phase = photometric_function(parameter_vector, mu0, GRAZING, phase)
    return rho, by_mu0, 0.0, by_phase


@njit(cache=True)
def continued_parameters(parameter_vector, mu0, mu, phase, out):
    """`photometric_parameters` of `continued_function`."""
    photometric_parameters(parameter_vector, mu0, max(mu, GRAZING), phase, out)


@njit(cache=True)
def photometric_value(parameter_vector, mu0, mu, phase):
    """rho alone: the same number, computed faster for some models."""
    if mu0 <= 0.0 or mu <= 0.0:
        return 0.0
    return _value(parameter_vector, mu0, mu, phase)


@njit(cache=True)
def photometric_parameters(parameter_vector, mu0, mu, phase, out):
    """Partial derivatives of rho by `Reflectance.parameters` into out (T,). Zero where unlit or unseen."""
    out[:] = 0.0
    if mu0 > 0.0 and mu > 0.0:
        _by_parameters(parameter_vector, mu0, mu, phase, out)


@njit(cache=True)
def evaluate(parameter_vector, mu0, mu, phase, out):
    """`photometric_value` of arrays (n,) into out (n,)."""
    for i in range(out.size):
        out[i] = photometric_value(parameter_vector, mu0[i], mu[i], phase[i])
