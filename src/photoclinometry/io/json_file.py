"""JSON files: written whole or not at all, read with an error that names the file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.atomic import write_text
from photoclinometry.io.reading import read_bytes
from photoclinometry.model.errors import RunFolderError


def write_json(path: Path | str, value: Any, *, indent: int = 1) -> None:
    """`value` as the file `path`. Raises RunFolderError.

    Numbers that are not finite become null, at any depth: JSON has neither infinity nor NaN (RFC 8259, section 6).
    Numbers of NumPy become those of Python, and other objects that JSON does not know become text.
    """
    write_text(path, json.dumps(_finite(value), indent=indent, default=str, allow_nan=False) + "\n")


def _finite(value: Any) -> Any:
    """The value with None for every number that is not finite."""
    if isinstance(value, Mapping):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_json(path: Path | str, remedy: str = "run the site again") -> Any:
    """The content of a file that this package wrote. Raises RunFolderError where it is missing or damaged.

    remedy: what to do where it is damaged, for messages.
    """
    data = read_bytes(Path(path), error=RunFolderError)
    try:
        return parse_json(data)
    except ValueError as error:
        raise RunFolderError(f"{path}: is damaged ({error}); {remedy}") from error


def parse_json(text: str | bytes) -> Any:
    """The value that a text in JSON states. Raises ValueError for any other text, and for one nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
