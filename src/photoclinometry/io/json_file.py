"""JSON files: written whole or not at all, read with an error that names the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from photoclinometry.io.atomic import write_text
from photoclinometry.io.reading import read_bytes
from photoclinometry.model.errors import RunFolderError


def write_json(path: Path | str, value: Any, *, indent: int = 1) -> None:
    """`value` as the file `path`; objects that JSON does not know are written as text. Raises RunFolderError."""
    write_text(path, json.dumps(value, indent=indent, default=str) + "\n")


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
