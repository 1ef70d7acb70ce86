"""The parts of a reflectance model: a name, a source, parameters, and plain compiled functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from numba import njit

from photoclinometry.model.errors import InputError

Compiled = Callable[..., Any]
"""A function compiled by Numba."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number that shapes a model, the same all over a map."""

    name: str
    unit: str
    about: str
    default: float | None = None
    """Neutral value for bodies without published ones [unit]; None: a value has to be published or given."""
    lower: float = -math.inf
    upper: float = math.inf
    """Bounds that the value may lie on and not beyond [unit]."""
    prior_sigma: float | None = None
    """Standard deviation of the estimate's prior [unit]; None: 5 % of the value that the estimate starts from."""


class Disk(NamedTuple):
    """A disk function d(mu0, mu, phase), which is 1 at mu0 = mu = 1, phase = 0. Its parameters are p[1], p[2], ..."""

    parameters: tuple[Parameter, ...]
    function: Compiled
    """(p, mu0, mu, phase) -> d and its derivatives by mu0, mu, phase."""
    by_parameters: Compiled
    """(p, mu0, mu, phase, factor, out) -> d; out[0], out[1], ...: factor times its derivatives by p[1], p[2], ..."""
    shader: str | None = None
    """d as an expression of GLSL in mu0, mu, phase and p, for the viewer (`shader.py`); None: it cannot relight."""


class Phase(NamedTuple):
    """A phase function Lambda(phase), which is 1 at phase 0. Its parameters are p[at], p[at + 1], ..."""

    parameters: tuple[Parameter, ...]
    function: Compiled
    """(p, at, phase) -> Lambda and its derivative by phase."""
    by_parameters: Compiled
    """(p, at, phase, out) -> Lambda; out[at - 1], out[at], ...: its derivatives by p[at], p[at + 1], ..."""
    shader: str | None = None
    """Lambda as an expression of GLSL in phase and p, with {at} for the number `at`; or None."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """A reflectance model: rho(mu0, mu, phase) with I/F = normal albedo * rho, so that rho(1, 1, 0) = 1.

    `of_factors` makes one of a disk function and a phase function. The compiled functions are called where mu0 > 0 and
    mu > 0 only. Their p is `Reflectance.parameter_vector`: p[0] is the model's number, p[1], p[2], ... are its
    parameters, followed by the numbers of `constants`.
    """

    name: str
    source: str
    """Papers with the equations, or the published values."""
    parameters: tuple[Parameter, ...]
    function: Compiled
    """(p, mu0, mu, phase) -> rho and its derivatives by mu0, mu, phase."""
    by_parameters: Compiled
    """(p, mu0, mu, phase, out) -> None; out: the derivatives of rho by the parameters."""
    value: Compiled
    """(p, mu0, mu, phase) -> rho alone."""
    phase: Phase | None = None
    """The factor of rho that depends on the phase alone; None of models that are no such product."""
    constants: Callable[[Sequence[float]], Sequence[float]] | None = None
    """Numbers that follow from the parameters' values, computed once for many calls of the compiled functions."""
    open_ended: bool = False
    """The last parameter may be repeated: c1, c2, c3 ..."""
    published: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Values of the parameters by body, in lower case."""
    shader: str | None = None
    """rho as an expression of GLSL in mu0, mu, phase and p, for the viewer (`shader.py`); None: it cannot relight."""
    predicts_absolute_brightness: bool = True
    """Otherwise the model describes brightness up to a factor per image (paper Eq. 30)."""

    def spelled_out(self, count: int) -> tuple[Parameter, ...]:
        """The parameters of `count` values. Raises InputError where the model has another number of them."""
        fixed = self.parameters
        if self.open_ended and count >= len(fixed) - 1:
            *fixed, last = fixed
            more = range(1, count - len(fixed) + 1)
            powers = [Parameter(name=f"{last.name}{i}", unit=f"{last.unit}^{i}", about=last.about) for i in more]
            return (*fixed, *powers)
        if count != len(fixed):
            names = ", ".join(p.name for p in fixed) + (", ..." if self.open_ended else "")
            raise InputError(f"reflectance {self.name} needs {len(fixed)} parameters ({names}), got {count}")
        return fixed


def of_factors(disk: Disk, phase: Phase, **others: Any) -> Model:
    """The model rho = Lambda(phase) d(mu0, mu, phase). others: further fields of `Model`."""
    count, at = len(disk.parameters), len(disk.parameters) + 1
    d_function, d_by_parameters = disk.function, disk.by_parameters
    lambda_function, lambda_by_parameters = phase.function, phase.by_parameters

    @njit(forceinline=True)
    def function(p, mu0, mu, phase):
        d, d_mu0, d_mu, d_phase = d_function(p, mu0, mu, phase)
        value, slope = lambda_function(p, at, phase)
        return value * d, value * d_mu0, value * d_mu, value * d_phase + slope * d

    @njit(forceinline=True)
    def value(p, mu0, mu, phase):
        return lambda_function(p, at, phase)[0] * d_function(p, mu0, mu, phase)[0]

    @njit(forceinline=True)
    def by_parameters(p, mu0, mu, phase, out):
        value = lambda_by_parameters(p, at, phase, out)
        d = d_by_parameters(p, mu0, mu, phase, value, out)
        for i in range(count, out.size):
            out[i] *= d

    shader = None
    if disk.shader is not None and phase.shader is not None:
        shader = f"{phase.shader.format(at=at)} * {disk.shader}"
    return Model(
        parameters=disk.parameters + phase.parameters,
        function=function,
        by_parameters=by_parameters,
        value=value,
        phase=phase,
        shader=shader,
        **others,
    )
