"""The options of a run or a study in files: TOML, and JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from photoclinometry import __version__
from photoclinometry.io.atomic import write_text


def write_options(path: Path, options: Mapping[str, Any]) -> None:
    """The file of `options_text`."""
    write_text(path, options_text(options))


def options_text(options: Mapping[str, Any]) -> str:
    """The options and the package's version as TOML. Tuples become lists, paths become text, None is omitted."""
    import tomli_w

    return tomli_w.dumps(_plain({"version": __version__, **options}))


def options_for_json(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options with "inf", as one types it, for an infinite one: JSON has no infinity, and null is left out."""
    return {key: _typed(value) for key, value in options.items()}


def _typed(value: Any) -> Any:
    if isinstance(value, Mapping):
        return options_for_json(value)
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(v) for key, v in value.items() if v is not None}
    if isinstance(value, Path):
        return str(value.resolve())
    return list(value) if isinstance(value, tuple) else value
