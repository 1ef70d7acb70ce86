"""TOML files, read as a `Table` whose errors name the file and the key."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from photoclinometry.io.reading import read_text
from photoclinometry.io.table import Table
from photoclinometry.model.errors import InputError

LONGEST_KEY = 64
"""Parts of a dotted key. The time to parse one grows with their square; files of this package have two."""

_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*"""
_LONGER_KEY = re.compile(rf"(?<![\w-])(?:{_PART}){{{LONGEST_KEY}}}")


def read_toml(path: Path | str, what: str = "TOML file", error: type[InputError] = InputError) -> Table:
    """The top table of a TOML file. what: kind of file, for messages. Raises `error` where it cannot be read."""
    path = Path(path)
    text = read_text(path, error=error, remedy=f"give a {what}")
    if _LONGER_KEY.search(text):
        raise error(f"{path}: has a key of more than {LONGEST_KEY} parts, which no {what} has")
    try:
        return Table(tomllib.loads(text), str(path))
    except tomllib.TOMLDecodeError as cause:
        raise error(f"{path}: is not valid TOML: {cause}") from cause
    except ValueError:
        raise error(f"{path}: holds a whole number of more digits than Python reads; no {what} needs it") from None
    except RecursionError:
        raise error(f"{path}: is nested too deeply to be a {what}") from None
