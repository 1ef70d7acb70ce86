"""Rows of a CSV file with a header (RFC 4180); errors name the file, the line, the column and what was found."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from photoclinometry.io.reading import read_limited
from photoclinometry.model.errors import InputError

MAX_BYTES = 1 << 26
"""64 MiB: a table of a million lines has half of this; larger files are something else."""
_SHOWN = 60
"""Characters of a wrong value that an error shows."""


@dataclass(frozen=True)
class CsvRow:
    """One line of a table. Every method that reads a column raises InputError."""

    where: str
    """File and line, for messages."""
    values: dict[str, str]
    """By column, without surrounding blanks; empty where the line ends early."""

    def error(self, what: str) -> InputError:
        """The error `what` about this line."""
        return InputError(f"{self.where}: {what}")

    def has(self, column: str) -> bool:
        """Whether the line has a value in a column, which may be missing altogether."""
        return bool(self.values.get(column))

    def name(self, column: str) -> str:
        """A text that is not empty."""
        if not self.has(column):
            raise self.error(f"{column} is empty, expected a name")
        return self.values[column]

    def number(self, column: str) -> float:
        """A finite number."""
        found = self.values.get(column, "")
        if not found:
            raise self.error(f"{column} is empty, expected a number")
        try:
            value = float(found)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            shown = found if len(found) <= _SHOWN else found[: _SHOWN - 3] + "..."
            raise self.error(f"{column} is {shown!r}, expected a number")
        return value

    def positive(self, column: str, default: float | None = None) -> float:
        """A finite number above 0; the default, if there is one, where the line has no value."""
        if default is not None and not self.has(column):
            return default
        value = self.number(column)
        if value <= 0:
            raise self.error(f"{column} is {value:g}, expected a positive number")
        return value


def read_csv_rows(path: Path, what: str, columns: Sequence[str], either: Sequence[Sequence[str]] = ()) -> list[CsvRow]:
    """The lines of a table below its header.

    what: kind of table, for messages; columns: those it must have; either: sets of columns of which it must have one.
    Raises InputError for a file that is missing, too large, not UTF-8 or not CSV, and for a missing column.
    """
    lines = _text(path, what).splitlines()
    reader = csv.reader(lines, skipinitialspace=True)
    try:
        header = [column.strip() for column in next(reader, [])]
        _check_header(path, header, columns, either)
        return list(_rows(path, reader, header))
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: {error}; write comma-separated values") from error


def _text(path: Path, what: str) -> str:
    data = read_limited(path, what, MAX_BYTES)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not UTF-8 text ({error.reason} at byte {error.start}); save it as UTF-8"
        ) from error


def _check_header(path: Path, header: Sequence[str], columns: Sequence[str], either: Sequence[Sequence[str]]) -> None:
    missing = [column for column in columns if column not in header]
    if either and not any(all(column in header for column in choice) for choice in either):
        missing.append(either[0][0])
    if missing:
        expected = ",".join([*columns, *(either[0] if either else ())])
        raise InputError(f"{path}: the first line has no column {missing[0]!r}; write {expected}")
    twice = [column for n, column in enumerate(header) if column and column in header[:n]]
    if twice:
        raise InputError(f"{path}: the first line has the column {twice[0]!r} twice; remove one")


def _rows(path: Path, reader: Iterator[list[str]], header: Sequence[str]) -> Iterator[CsvRow]:
    for values in reader:
        line = getattr(reader, "line_num", 0)
        if not values:
            continue
        if len(values) > len(header) and any(value.strip() for value in values[len(header) :]):
            raise InputError(
                f"{path}, line {line}: has {len(values)} values, the first line has {len(header)} columns; put text "
                "with commas in double quotes"
            )
        padded = [*values, *[""] * (len(header) - len(values))]
        yield CsvRow(f"{path}, line {line}", {c: v.strip() for c, v in zip(header, padded, strict=False)})
