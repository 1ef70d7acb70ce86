"""A reflectance model with the values of its parameters."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance.compiled import evaluate
from photoclinometry.model.reflectance.entry import Model, Parameter
from photoclinometry.model.reflectance.models import MODELS, model_named

log = logging.getLogger(__name__)

RELATIVE_SIGMA = 0.05
"""Prior standard deviation of a parameter over its value, where the parameter states none of its own."""
TO_BOUND = 0.9
"""Share of the way to a parameter's bound that one step of the estimate may go."""


@dataclass(frozen=True)
class Reflectance:
    """A reflectance model with the values of its parameters."""

    name: str
    """One of `MODELS`."""
    values: tuple[float, ...] = ()
    """Of the parameters in `Model.parameters`, in their units."""

    def __post_init__(self):
        model_named(self.name).spelled_out(len(self.values))

    @property
    def model(self) -> Model:
        return MODELS[self.name]

    @property
    def predicts_absolute_brightness(self) -> bool:
        """Otherwise brightness is described up to a factor per image (paper Eq. 30)."""
        return self.model.predicts_absolute_brightness

    @property
    def parameter_vector(self) -> np.ndarray:
        """(1 + n,) float64 for compiled code: the model's number, `values`, and numbers that follow from these.

        NaN behind the number where a value is beyond its bounds: such a model explains no brightness.
        """
        number = list(MODELS).index(self.name)
        inside = all(p.lower <= v <= p.upper for p, v in zip(self._parameters, self.values, strict=True))
        constants = self.model.constants
        more = () if constants is None else constants(self._within_bounds())
        vector = np.array([number, *self.values, *more], float)
        if not inside:
            vector[1:] = np.nan
        return vector

    @property
    def parameters(self) -> np.ndarray:
        """(T,) `values` as an array."""
        return np.array(self.values, float)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """(T,) names of `parameters`."""
        return tuple(p.name for p in self._parameters)

    @property
    def described(self) -> tuple[str, str, str]:
        """Names, units and meanings of `parameters`, as three lines of text for a file's attributes."""
        fields = zip(*((p.name, p.unit, p.about) for p in self._parameters), strict=True)
        names, units, meanings = (", ".join(field) for field in fields) if self.values else ("none", "-", "none")
        return names, units, meanings

    @property
    def parameter_scale(self) -> np.ndarray:
        """(T,) unit in which the estimate changes each parameter, such that its prior is RELATIVE_SIGMA of these.

        It is the value itself, so that changes are relative, unless the parameter states its prior's sigma.
        """
        own = (p.prior_sigma for p in self._parameters)
        pairs = zip(own, self.values, strict=True)
        return np.array([value if sigma is None else sigma / RELATIVE_SIGMA for sigma, value in pairs], float)

    def moved(self, change: np.ndarray) -> Reflectance:
        """The model with its parameters changed by `change` (T,) in units of `parameter_scale`."""
        relative = np.array([p.prior_sigma is None for p in self._parameters], bool)
        values, scale = self.parameters, self.parameter_scale
        return self.with_parameters(np.where(relative, values * (1.0 + change), values + scale * change))

    def relative_change(self, other: Reflectance) -> np.ndarray:
        """(T,) differences of the parameters of another estimate of the same model, in units of `parameter_scale`; 0
        where this is 0."""
        scale = self.parameter_scale
        return np.divide(other.parameters - self.parameters, scale, out=np.zeros(len(scale)), where=scale != 0)

    def limit_step(self, change: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The step (T,) from `change` (T,), both in units of `parameter_scale`, cut where it nears a parameter's bound.

        A parameter goes at most TO_BOUND of the way to its bound. It therefore never reaches a bound, and comes as near
        in a few steps as the observations require.
        """
        if len(step) == 0:
            return step
        now, scale = self.moved(change).parameters, self.parameter_scale
        lower, upper = np.array([(p.lower, p.upper) for p in self._parameters], float).T
        least, most = TO_BOUND * (lower - now), TO_BOUND * (upper - now)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort([least / scale, most / scale], axis=0)
        return np.where(scale == 0, step, np.minimum(np.maximum(step, ends[0]), ends[1]))

    def with_parameters(self, values: np.ndarray | Sequence[float]) -> Reflectance:
        """The same model with other `parameters` (T,)."""
        return Reflectance(self.name, tuple(map(float, values)))

    def __call__(self, mu0: np.ndarray, mu: np.ndarray, phase: np.ndarray) -> np.ndarray:
        """The photometric function rho, so that I/F = albedo * rho; arrays of any common shape.

        mu0, mu: cosines of incidence and emission; phase [rad]. Zero where mu0 <= 0 or mu <= 0.
        """
        mu0, mu, phase = np.broadcast_arrays(*(np.asarray(x, float) for x in (mu0, mu, phase)))
        out = np.empty(mu0.size)
        evaluate(self.parameter_vector, mu0.ravel(), mu.ravel(), phase.ravel(), out)
        return out.reshape(mu0.shape)

    def phase_function(self, phase: np.ndarray) -> np.ndarray:
        """Lambda(phase), phase [rad]; of models without such a factor (Hapke's), rho at mu0 = mu = cos(phase / 2)."""
        factor, phase = self.model.phase, np.asarray(phase, float)
        if factor is None:
            half = np.cos(0.5 * phase)
            return self(half, half, phase)
        vector, at = self.parameter_vector, len(self.model.parameters) - len(factor.parameters) + 1
        return np.array([factor.function(vector, at, angle)[0] for angle in phase.ravel()]).reshape(phase.shape)

    @property
    def _parameters(self) -> tuple[Parameter, ...]:
        return self.model.spelled_out(len(self.values))

    def _within_bounds(self) -> list[float]:
        return [min(max(v, p.lower), p.upper) for p, v in zip(self._parameters, self.values, strict=True)]


def mean_model(models: Sequence[tuple[Reflectance | None, float, bool]]) -> Reflectance | None:
    """The weighted mean of models of one name, of the trusted ones if there are any; None without models.

    models: each with its weight, and whether it is to be trusted. Where names differ, the models of the name with most
    weight count, since parameters of different models have nothing in common.
    """
    known = [(model, weight, trusted) for model, weight, trusted in models if model is not None]
    used = [each for each in known if each[2]] or known
    if not used:
        return None
    by_name: dict[str, float] = {}
    for model, weight, _ in used:
        by_name[model.name] = by_name.get(model.name, 0.0) + weight
    name = max(by_name, key=lambda each: by_name[each])
    used = [each for each in used if each[0].name == name]
    weights = [weight for _, weight, _ in used]
    return used[0][0].with_parameters(np.average([model.parameters for model, *_ in used], axis=0, weights=weights))


def has_published(name: str, body: str | None) -> bool:
    """Whether values of this model's parameters are published for this body, or it has none."""
    model = model_named(name)
    return not model.parameters or (body or "").lower() in model.published


def has_values(name: str, body: str | None) -> bool:
    """Whether `starting_model` has values for this body: published or neutral ones."""
    return has_published(name, body) or all(p.default is not None for p in model_named(name).parameters)


def models_for(body: str | None, *, absolute: bool = False) -> tuple[str, ...]:
    """Names of the models with values for a body. absolute: only those that predict brightness absolutely."""
    return tuple(
        name
        for name, model in MODELS.items()
        if has_values(name, body) and (model.predicts_absolute_brightness or not absolute)
    )


def published(name: str, body: str | None = None) -> Reflectance:
    """The model with the values that are published for a body, such as "vesta" or "ceres".

    Raises InputError for other bodies: pass a `Reflectance` of your own, or use a model that needs no values.
    """
    model = model_named(name)
    if not has_published(name, body):
        known = ", ".join(sorted(model.published)) or "none"
        free = " or ".join(sorted(other for other, m in MODELS.items() if not m.parameters))
        whose, name_it = (f"for body {body!r}", "") if body else ("without a body", "name the body, or ")
        raise InputError(
            f"no published {model.name} coefficients {whose} (known: {known}); {name_it}use reflectance {free}, which "
            "need none"
        )
    return Reflectance(model.name, model.published.get((body or "").lower(), ()))


def starting_model(name: str, body: str | None = None) -> Reflectance:
    """`published`, or the model's neutral default values where it has such. Raises InputError."""
    model = model_named(name)
    if has_published(name, body) or not has_values(name, body):
        return published(name, body)
    defaults = tuple(p.default for p in model.parameters if p.default is not None)
    log.info("reflectance %s: no values published for body %r, it starts from neutral ones", model.name, body)
    return Reflectance(model.name, defaults)
