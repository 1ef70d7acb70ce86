"""A table of Sun directions, for images without labels: `image,sun_x,sun_y,sun_z`, optionally `sun_sigma_deg`."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.reading import read_limited
from photoclinometry.model.errors import InputError

_MAX_BYTES = 1 << 26
"""64 MiB: half a million lines; larger files are something else."""
_COLUMNS = ("image", "sun_x", "sun_y", "sun_z")
_UNIT_TOLERANCE = 1e-3
"""A vector written with three decimals is this near to unit length."""


@dataclass(frozen=True)
class SunRow:
    """One line of the table."""

    sun: np.ndarray
    """(3,) unit vector from the body towards the Sun, in the camera's frame: x right, y down, z forward."""
    sigma_rad: float | None
    """Standard deviation about each tangent axis; None if the table has none."""


def read_suns(path: Path) -> dict[str, SunRow]:
    """The Suns by image name as written. Raises InputError that names the line."""
    rows: dict[str, SunRow] = {}
    reader = csv.DictReader(_text(path).splitlines(), skipinitialspace=True)
    try:
        missing = [c for c in _COLUMNS if c not in (reader.fieldnames or ())]
        if missing:
            raise InputError(f"{path}: the first line has no column {missing[0]!r}; write {','.join(_COLUMNS)}")
        for row in reader:
            name = (row["image"] or "").strip()
            if name in rows:
                raise InputError(f"{path}, line {reader.line_num}: {name!r} occurs twice; remove one")
            rows[name] = _row(path, reader.line_num, row)
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: {error}; write comma-separated values") from error
    return rows


def _text(path: Path) -> str:
    data = read_limited(path, "table of Suns", _MAX_BYTES)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: is not UTF-8 text ({error.reason} at byte {error.start}); save it as UTF-8"
        ) from error


def _row(path: Path, line: int, row: dict[str, str | None]) -> SunRow:
    sun = np.array([_number(path, line, row, key) for key in _COLUMNS[1:]])
    length = float(np.linalg.norm(sun))
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise InputError(f"{path}, line {line}: the Sun has length {length:.6g}, expected a unit vector")
    sigma = _number(path, line, row, "sun_sigma_deg") if (row.get("sun_sigma_deg") or "").strip() else None
    if sigma is not None and sigma <= 0:
        raise InputError(f"{path}, line {line}: sun_sigma_deg is {sigma:g}, expected a positive number")
    return SunRow(sun / length, None if sigma is None else float(np.deg2rad(sigma)))


def _number(path: Path, line: int, row: dict[str, str | None], key: str) -> float:
    try:
        value = float(row[key] or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{path}, line {line}: {key} is {row[key]!r}, expected a number")
    return value
