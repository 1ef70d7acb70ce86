"""Text files of whitespace-separated numbers, parsed in large blocks, with errors that name file, line and value.

Only a block that cannot be parsed is searched line by line for its fault.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from photoclinometry.model.errors import InputError

BLOCK_BYTES = 1 << 24
"""Size of the blocks that are read and parsed at once: 16 MiB."""

_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMENT = re.compile(rb"^[ \t]*#[^\n]*", re.MULTILINE)
_MAX_WHOLE = 2.0**53
"""Largest whole number up to which doubles hold every whole number."""
_SHOWN = 40
"""Characters of a wrong value that an error shows."""


class Rows(NamedTuple):
    """The numbers of a block of lines, without blank lines and comments."""

    value: np.ndarray
    """(n,) float64, all finite."""
    start: np.ndarray
    """(r + 1,) int64: row i is value[start[i]:start[i + 1]]."""
    line: np.ndarray
    """(r,) int64 line of the file of each row, from 1."""


def fault(path: Path, line: int, what: str) -> InputError:
    """The error `what` about a line of a file."""
    return InputError(f"{path}, line {line}: {what}")


def read_lines(path: Path, what: str) -> Iterator[bytes]:
    """The lines of a file, each with its newline. what: kind of model, for the error if the file is missing.

    Raises InputError if the file is missing, unreadable, empty, or ends in the middle of a line.
    """
    for block in _blocks(path, what, 1):
        yield from block


def read_rows(path: Path, what: str) -> Iterator[Rows]:
    """The numbers of a file, block by block; what: as for `read_lines`. Raises InputError."""
    first = 1
    for block in _blocks(path, what, BLOCK_BYTES):
        yield _rows(path, first, _COMMENT.sub(b"", b"".join(block)))
        first += len(block)


def parse_numbers(path: Path, line: int, text: bytes) -> np.ndarray:
    """(n,) float64, all finite, of whitespace-separated text that begins in `line`. Raises InputError."""
    return _checked(path, line, text, int(np.count_nonzero(_beginnings(text))))


def first_not_whole(values: np.ndarray, lowest: int = 0) -> int | None:
    """Index of the first value (n,) that is not a whole number from `lowest` to 2^53; None if all are."""
    bad = np.flatnonzero((values < lowest) | (values > _MAX_WHOLE) | (values != np.floor(values)))
    return int(bad[0]) if len(bad) else None


def announced_count(path: Path, what: str) -> int | None:
    """The n of a comment "# Number of WHAT: n" among the file's first lines; None if there is none."""
    with open(path, "rb") as file:
        for text in file:
            if not text.startswith(b"#"):
                return None
            found = re.match(rb"#\s*Number of " + what.encode() + rb": (\d+)\b", text)
            if found:
                return int(found[1])
    return None


def _blocks(path: Path, what: str, size: int) -> Iterator[list[bytes]]:
    number = 0
    try:
        with open(path, "rb") as file:
            while block := file.readlines(size):
                number += len(block)
                if not block[-1].endswith(b"\n"):
                    raise fault(
                        path,
                        number,
                        "the file ends in the middle of this line: it was cut short; "
                        "get it again, or end the line if it is whole",
                    )
                yield block
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; give the folder of a model in text form, {what}") from None
    except OSError as error:
        reason = error.strerror or error
        raise InputError(
            f"{path}: cannot be read: {reason}; give the folder of a model in text form, {what}"
        ) from error
    if number == 0:
        raise InputError(f"{path}: is empty; get it again")


def _rows(path: Path, first: int, text: bytes) -> Rows:
    beginning = _beginnings(text)
    newline = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n"))
    line_start = np.concatenate([[0], newline[:-1] + 1])
    count = np.add.reduceat(beginning, line_start, dtype=np.int64)
    value = _checked(path, first, text, int(count.sum()))
    held = np.flatnonzero(count)
    return Rows(value, np.concatenate([[0], np.cumsum(count[held])]), first + held)


def _beginnings(text: bytes) -> np.ndarray:
    """(bytes,) bool: True where a word begins."""
    raw = np.frombuffer(text, np.uint8)
    word = (raw != 32) & ((raw < 9) | (raw > 13))
    word[1:] &= ~word[:-1]
    return word


def _checked(path: Path, first: int, text: bytes, words: int) -> np.ndarray:
    """The numbers of a text of `words` words. The count detects words such as "1-2", two numbers to NumPy."""
    if words == 0:
        return np.empty(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            values = np.fromstring(text, sep=" ")
    except (DeprecationWarning, ValueError):
        raise _first_fault(path, first, text) from None
    if len(values) != words or not np.isfinite(values).all():
        raise _first_fault(path, first, text)
    return values


def _first_fault(path: Path, first: int, text: bytes) -> InputError:
    for line, content in enumerate(text.split(b"\n"), first):
        for place, word in enumerate(content.split(), 1):
            if not _NUMBER.fullmatch(word) or not np.isfinite(float(word)):
                shown = word[:_SHOWN].decode("utf-8", "backslashreplace")
                return fault(path, line, f"value {place} is {shown!r}, expected a finite number")
    raise AssertionError("NumPy cannot parse a text whose words are all numbers")
