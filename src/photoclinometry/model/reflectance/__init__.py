"""Brightness as a function of incidence, emission and phase: each model stated once.

    radiance factor  I/F = normal albedo * rho(mu0, mu, phase)                              (paper Eq. 20)

mu0 = cos(incidence), mu = cos(emission), phase [rad]; rho = 1 at mu0 = mu = 1, phase = 0. Most models are a product,
rho = Lambda(phase) d(mu0, mu, phase), of a phase function and a disk function. `models.py` lists them; the
renderer, the simulator and the joint estimate call the compiled functions of the same entry.
"""

import photoclinometry.model.kernel_cache  # noqa: F401 - before anything below is compiled
from photoclinometry.model.reflectance.angles import (
    DEG,
    GRAZING,
    GRAZING_DEG,
    PHASE_FLOOR,
    angles_at,
    phase_angle,
    photometric_angles,
)
from photoclinometry.model.reflectance.compiled import (
    continued_function,
    continued_parameters,
    photometric_function,
    photometric_parameters,
    photometric_value,
)
from photoclinometry.model.reflectance.entry import Disk, Model, Parameter, Phase, of_factors
from photoclinometry.model.reflectance.models import MODELS, ModelChoice, ModelName, ModelOrAuto, model_named
from photoclinometry.model.reflectance.reflectance import (
    Reflectance,
    has_published,
    mean_model,
    models_for,
    published,
    starting_model,
)

__all__ = [
    "DEG",
    "GRAZING",
    "GRAZING_DEG",
    "MODELS",
    "PHASE_FLOOR",
    "Disk",
    "Model",
    "ModelChoice",
    "ModelName",
    "ModelOrAuto",
    "Parameter",
    "Phase",
    "Reflectance",
    "angles_at",
    "continued_function",
    "continued_parameters",
    "has_published",
    "mean_model",
    "model_named",
    "models_for",
    "of_factors",
    "phase_angle",
    "photometric_angles",
    "photometric_function",
    "photometric_parameters",
    "photometric_value",
    "published",
    "starting_model",
]
