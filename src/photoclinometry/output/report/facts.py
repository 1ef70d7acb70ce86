"""What the first screens of reports of places and bodies are made of: facts with units, stated sigmas, a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from photoclinometry.evaluate.tables import number
from photoclinometry.io.dark_level import in_words
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.scene import Views

SOUND, CARE, WRONG = "Sound", "Usable with care", "Do not trust"
"""Verdicts."""

FEW_VIEWS = 5.0
"""Views per landmark in the mean below which normals and albedos rest on so few measurements that one bad view shows. A
normal and an albedo are three numbers, and each view gives one brightness."""
ROUGH_NORMAL_DEG, ROUGH_HEIGHT_GSD = 5.0, 0.5
"""Medians of stated sigmas beyond those of any sound simulated site: these have 1 to 2 degrees, and 0.1 GSD. Sound
simulated bodies have 3 to 4 degrees, and 0.1 to 0.2 GSD."""
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
    """What is wrong with it, with its value and that of the map."""
    where: str
    """In words."""


P = TypeVar("P", bound=WorstPlace, covariant=True)


@dataclass(frozen=True, kw_only=True)
class Overview(Generic[P]):
    """The first screen of a report, in words."""

    verdict: str
    """SOUND, CARE or WRONG."""
    reasons: tuple[str, ...]
    """Why the map is not to be trusted, or what to take care of. Empty for a sound map."""
    warnings: tuple[str, ...]
    what: tuple[Fact, ...]
    quality: tuple[Fact, ...]
    places: tuple[P, ...]
    """The worst places of the map."""


def verdict_of(distrust: Sequence[str], warnings: Sequence[str], care: Sequence[str]) -> str:
    """The verdict on a map with reasons for distrust, warnings, and reasons for care."""
    return WRONG if distrust else CARE if warnings or care else SOUND


def digits(value: float, count: int = 3) -> str:
    """So many significant digits, and all before the point; never in scientific notation."""
    if not np.isfinite(value) or value == 0.0:
        return number(value)
    return _grouped(value, count - 1 - int(np.floor(np.log10(abs(value)))))


def with_sigma(value: float, sigma: float) -> str:
    """ "3.0606 ± 0.0012": both to the second digit of the sigma; the value alone where there is none."""
    if not np.isfinite(sigma) or sigma <= 0.0:
        return digits(value)
    decimals = 1 - int(np.floor(np.log10(sigma)))
    return f"{_grouped(value, decimals)} ± {_grouped(sigma, decimals)}"


def _grouped(value: float, decimals: int) -> str:
    return f"{value:,.{max(0, decimals)}f}".replace(",", "\u202f")


def span(values: np.ndarray) -> str:
    """The range of angles [degrees]."""
    low, high = np.round([values.min(), values.max()])
    return f"{low:.0f}°" if low == high else f"{low:.0f} to {high:.0f}°"


def sun_span_deg(views: Views) -> float:
    """The greatest angle between the Suns of two views [degrees]."""
    return float(np.degrees(angle_between(views.sun[:, None], views.sun[None])).max())


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


def rough_normals(metrics: Mapping[str, Any]) -> list[str]:
    """A reason for care where normals are uncertain."""
    sigma = metrics.get("normal_sigma_median_deg", 0.0)
    return [f"normals are uncertain: {digits(sigma)}° in the median"] if sigma > ROUGH_NORMAL_DEG else []


def rough_heights(metrics: Mapping[str, Any]) -> list[str]:
    """A reason for care where heights are uncertain."""
    sigma = metrics.get("height_sigma_median_gsd", 0.0)
    return [f"heights are uncertain: {digits(sigma)} GSD in the median"] if sigma > ROUGH_HEIGHT_GSD else []


def few_views(per_landmark: float) -> list[str]:
    """A reason for care where few views measure a landmark, in the mean."""
    if per_landmark >= FEW_VIEWS:
        return []
    return [f"few views: {per_landmark:.1f} measure a landmark, {FEW_VIEWS:.0f} or more are good"]
