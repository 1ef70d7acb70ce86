"""TOML files, read as a `Table` whose errors name the file and the key."""

from __future__ import annotations

import tomllib
from pathlib import Path

from photoclinometry.io.reading import read_text
from photoclinometry.io.table import Table
from photoclinometry.model.errors import InputError


def read_toml(path: Path | str, what: str = "TOML file", error: type[InputError] = InputError) -> Table:
    """The top table of a TOML file. what: kind of file, for messages. Raises `error` where it cannot be read."""
    path = Path(path)
    text = read_text(path, error=error, remedy=f"give a {what}")
    try:
        return Table(tomllib.loads(text), str(path))
    except tomllib.TOMLDecodeError as cause:
        raise error(f"{path}: is not valid TOML: {cause}") from cause
    except RecursionError:
        raise error(f"{path}: is nested too deeply to be a {what}") from None
