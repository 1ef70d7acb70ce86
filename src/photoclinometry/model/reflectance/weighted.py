"""Disk functions that are shaped by a weight g = w0 + w1 phase."""

from __future__ import annotations

from numba import njit

from photoclinometry.model.reflectance.angles import DEG
from photoclinometry.model.reflectance.entry import Compiled, Disk, Parameter

W0 = Parameter(name="w0", unit="-", about="weight g of the disk function at zero phase")
W1 = Parameter(name="w1", unit="1/rad", about="change of the weight g with phase")
# Fits to other ground than the ideal leave 0 to 1 (Vesta's Akimov weight is 1.57), so neither is bounded.


def weighted(
    function: Compiled, parameters: tuple[Parameter, Parameter] = (W0, W1), *, shader: str | None = None
) -> Disk:
    """A disk function of a weight g. function: (mu0, mu, phase, w0, w1) -> d, its derivatives by mu0, mu, phase, g.

    shader: name of the same as a function of GLSL, (mu0, mu, phase, g) -> d (`shader.py`).
    """

    @njit(forceinline=True)
    def disk(p, mu0, mu, phase):
        d, d_mu0, d_mu, d_phase, _ = function(mu0, mu, phase, p[1], p[2])
        return d, d_mu0, d_mu, d_phase

    @njit(forceinline=True)
    def by_parameters(p, mu0, mu, phase, factor, out):
        d, _, _, _, by_weight = function(mu0, mu, phase, p[1], p[2])
        out[0] = factor * by_weight
        out[1] = factor * by_weight * phase
        return d

    expression = None if shader is None else f"{shader}(mu0, mu, phase, p[1] + p[2] * phase)"
    return Disk(parameters, disk, by_parameters, expression)


def fixed(function: Compiled, w0: float = 0.0, w1: float = 0.0, *, shader: str | None = None) -> Disk:
    """As `weighted`, of a weight that is not estimated. shader: d as an expression of GLSL in mu0, mu and phase."""

    @njit(forceinline=True)
    def disk(p, mu0, mu, phase):
        d, d_mu0, d_mu, d_phase, _ = function(mu0, mu, phase, w0, w1)
        return d, d_mu0, d_mu, d_phase

    @njit(forceinline=True)
    def by_parameters(p, mu0, mu, phase, factor, out):
        return function(mu0, mu, phase, w0, w1)[0]

    return Disk((), disk, by_parameters, shader)


def per_degree(w0: float, w1: float, *powers: float) -> tuple[float, ...]:
    """Values published per degree^i, as w0, w1 [1/rad] and coefficients c_i [1/rad^i]."""
    return (w0, w1 * DEG, *(c * DEG**i for i, c in enumerate(powers, start=1)))
