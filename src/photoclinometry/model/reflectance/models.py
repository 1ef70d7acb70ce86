"""The reflectance models, by name. A model is its own file and one line here; all else follows from this table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance.akimov import AKIMOV, AKIMOV_PLUS
from photoclinometry.model.reflectance.entry import Model
from photoclinometry.model.reflectance.hapke import HAPKE
from photoclinometry.model.reflectance.lunar_lambert import LUNAR_LAMBERT, MCEWEN
from photoclinometry.model.reflectance.minnaert import MINNAERT, MINNAERT_MAGNITUDES

_ALL = (AKIMOV, MCEWEN, AKIMOV_PLUS, LUNAR_LAMBERT, MINNAERT, HAPKE, MINNAERT_MAGNITUDES)

MODELS: dict[str, Model] = {model.name: model for model in _ALL}
"""In a fixed order: a model's place is its number in compiled code."""

if TYPE_CHECKING:
    ModelName = str
    ModelOrAuto = str
    ModelChoice = str
else:
    ModelName = Literal[*MODELS]
    ModelOrAuto = Literal["auto", *MODELS]
    ModelChoice = Literal["auto", *MODELS, "none"]
"""The types of options: a model's name, or that, "auto" (chosen by views kept out) or "none" (geometry alone)."""


def model_named(name: str) -> Model:
    """The model of that name, in any case of letters. Raises InputError."""
    if name.lower() not in MODELS:
        raise InputError(f"no reflectance model {name!r}; known: {', '.join(MODELS)}")
    return MODELS[name.lower()]
