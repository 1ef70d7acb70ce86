"""Parts of the first screens of reports of places and bodies: facts with units, stated sigmas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from photoclinometry.evaluate.tables import digits, grouped
from photoclinometry.io.dark_level import in_words
from photoclinometry.model.scene import Views

_SIGMAS = (
    ("height", "gsd", "Heights"),
    ("normal", "deg", "Normals"),
    ("albedo", "percent", "Albedos"),
)
_SHOWN_UNITS = {"deg": "°", "percent": " %"}


@dataclass(frozen=True, kw_only=True)
class Fact:
    """One line of the overview."""

    name: str
    value: str
    meaning: str = ""
    """Half a sentence."""


@dataclass(frozen=True, kw_only=True)
class WorstPlace:
    """A part of a map that is worse than the rest in one respect."""

    words: str
    """Its fault, with its value and that of the map."""
    where: str
    """In words."""


P = TypeVar("P", bound=WorstPlace, covariant=True)


@dataclass(frozen=True, kw_only=True)
class Overview(Generic[P]):
    """The first screen of a report, in words."""

    verdict: str
    """As of `evaluate.verdict.Judgement`."""
    reasons: tuple[str, ...]
    """Reasons why the map is not to be trusted, or cautions. Empty for a sound map."""
    warnings: tuple[str, ...]
    what: tuple[Fact, ...]
    quality: tuple[Fact, ...]
    places: tuple[P, ...]
    """The worst places of the map."""


def with_sigma(value: float, sigma: float) -> str:
    """ "3.0606 ± 0.0012": both to the second digit of the sigma; the value alone where there is none."""
    if not np.isfinite(sigma) or sigma <= 0.0:
        return digits(value)
    decimals = 1 - int(np.floor(np.log10(sigma)))
    return f"{grouped(value, decimals)} ± {grouped(sigma, decimals)}"


def span(values: np.ndarray) -> str:
    """The range of angles [degrees]."""
    low, high = np.round([values.min(), values.max()])
    return f"{low:.0f}°" if low == high else f"{low:.0f} to {high:.0f}°"


def with_unit(value: float, unit: str, gsd_m: float | None) -> str:
    """A figure with its unit ("gsd", "deg" or "percent"); lengths in GSD in metres, too, where gsd_m is known."""
    if unit != "gsd":
        return f"{digits(value, 2)}{_SHOWN_UNITS[unit]}"
    metres = "" if gsd_m is None else f" = {digits(value * gsd_m, 2)} m"
    return f"{digits(value, 2)} GSD{metres}"


def dark_level(brightness: str, views: Views) -> list[Fact]:
    """Of uncalibrated images."""
    if brightness == "iof":
        return []
    level, meaning = in_words(views.dark_level)
    return [Fact(name="Dark level", value=level, meaning=meaning)]


def stated_sigmas(metrics: Mapping[str, Any], gsd_m: float | None, meanings: Mapping[str, str]) -> list[Fact]:
    """Medians of sigmas of heights, normals and albedos. meanings: by "height", "normal" and "albedo"."""
    known = [(name, unit, title, metrics.get(f"{name}_sigma_median_{unit}")) for name, unit, title in _SIGMAS]
    found = [
        Fact(name=title, value=f"± {with_unit(value, unit, gsd_m)}", meaning=meanings[name])
        for name, unit, title, value in known
        if value is not None and np.isfinite(value)
    ]
    return found or [Fact(name="Uncertainties", value="unknown", meaning="the run did not compute any")]
