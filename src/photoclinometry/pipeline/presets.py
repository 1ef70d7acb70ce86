"""Options for common cases, by name. Options that are given beside a preset take precedence over it.

phomo run site --preset quick --hold-out images/003.fits
pcm.run("site/site.toml", "run", options=pcm.preset("quick"), hold_out=("images/003.fits",))
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar

from photoclinometry.matching.densify import FEW_VIEWS
from photoclinometry.model.errors import InputError
from photoclinometry.pipeline.options import RunOptions

T = TypeVar("T")


@dataclass(frozen=True)
class RunPreset:
    """Options of a run that go together."""

    about: str
    """When to take it."""
    values: Mapping[str, Any]
    """By the options' names, those of parts with a dot."""


PRESETS = {
    "few-views": RunPreset(
        about="nine images or fewer",
        values={"densify.min_views": FEW_VIEWS, "sfm.max_features": 10_000},
    ),
    "uncalibrated": RunPreset(
        about="brightness is not I/F, or not certainly",
        # This model has no phase function that would hold the images' scales near 1, and no coefficients of a body.
        values={"reflectance": "mcewen"},
    ),
    "quick": RunPreset(
        about="a first look, at every second pixel",
        values={"region.stride": 2, "relight.iterations": 1, "adjust.uncertainty": False},
    ),
    "best": RunPreset(
        about="the most accurate map, in more time",
        values={"sfm.max_features": 10_000, "relight.iterations": 6, "relight.settled_px": 0.01},
    ),
}
"""By name."""


def preset(name: str) -> RunOptions:
    """The options of a run for a common case.

    Args:
        name: "few-views", "uncalibrated", "quick" or "best".

    Returns:
        Options for `run`, which takes single ones beside them.

    Raises:
        InputError: There is no such preset; the message names them, and the nearest.
    """
    if name not in PRESETS:
        near = difflib.get_close_matches(name, PRESETS, n=1, cutoff=0.0)[0]
        raise InputError(f"no preset {name!r}; known: {', '.join(PRESETS)}; nearest: {near}")
    return _with(RunOptions(), PRESETS[name].values)


def _with(options: T, values: Mapping[str, Any]) -> T:
    """Options with the values of dotted names."""
    own = {name: value for name, value in values.items() if "." not in name}
    for field in fields(options):  # pyright: ignore[reportArgumentType]
        part = getattr(options, field.name)
        below = {n.partition(".")[2]: v for n, v in values.items() if n.startswith(f"{field.name}.")}
        if below and is_dataclass(part):
            own[field.name] = _with(part, below)
    return replace(options, **own)  # pyright: ignore[reportArgumentType]
