"""A table of ground control points: `point,view,x_px,y_px,x_m,y_m,z_m,sigma_m`, a line for each measured pixel.

Optional columns: `sigma_px` (default 1) and, in place of `sigma_m`, `sigma_x_m,sigma_y_m,sigma_z_m`. Lines of one point
repeat its position.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from photoclinometry.io.reading import read_bytes
from photoclinometry.model.control import ControlPixel, ControlPoint
from photoclinometry.model.errors import InputError

MAX_BYTES = 1 << 26
"""A table of a million measurements has half of this."""

DEFAULT_SIGMA_PX = 1.0
"""Standard deviation of a pixel that a person pointed at."""

_COLUMNS = ("point", "view", "x_px", "y_px", "x_m", "y_m", "z_m")
_AXES = ("sigma_x_m", "sigma_y_m", "sigma_z_m")


def read_control_points(path: Path | str) -> tuple[ControlPoint, ...]:
    """Control points in the order of the table. Raises InputError that names the line."""
    path = Path(path)
    reader = csv.DictReader(_text(path).splitlines(), skipinitialspace=True)
    points: dict[str, ControlPoint] = {}
    try:
        columns = reader.fieldnames or ()
        missing = [column for column in _COLUMNS if column not in columns]
        if "sigma_m" not in columns and not all(column in columns for column in _AXES):
            missing.append("sigma_m")
        if missing:
            raise InputError(f"{path}: the first line has no column {missing[0]!r}; write {','.join(_COLUMNS)},sigma_m")
        for row in reader:
            found = _point(f"{path}, line {reader.line_num}", row)
            known = points.get(found.name)
            points[found.name] = found if known is None else _joined(f"{path}, line {reader.line_num}", known, found)
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}: {error}; write comma-separated values") from error
    if not points:
        raise InputError(f"{path}: has no control point; write a line for each measured pixel")
    return tuple(points.values())


def _text(path: Path) -> str:
    data = read_bytes(path, "table of control points", limit=MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: is larger than {MAX_BYTES >> 20} MiB, so it is no table of control points")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text ({error.reason} at byte {error.start})") from error


def _point(where: str, row: Mapping[str, str | None]) -> ControlPoint:
    name, view = ((row[column] or "").strip() for column in ("point", "view"))
    if not name or not view:
        raise InputError(f"{where}: {'point' if not name else 'view'} is empty, expected a name")
    x, y, *position = (_number(where, row, column) for column in _COLUMNS[2:])
    axes = _AXES if (row.get(_AXES[0]) or "").strip() else ("sigma_m",) * 3
    sigma = np.array([_positive(where, row, column) for column in axes])
    pixel_sigma = _positive(where, row, "sigma_px") if (row.get("sigma_px") or "").strip() else DEFAULT_SIGMA_PX
    pixel = ControlPixel(view, x, y, pixel_sigma)
    return ControlPoint(name=name, position=np.array(position), sigma=sigma, pixels=(pixel,))


def _joined(where: str, known: ControlPoint, found: ControlPoint) -> ControlPoint:
    """A point with one more pixel."""
    if not np.array_equal(known.position, found.position) or not np.array_equal(known.sigma, found.sigma):
        raise InputError(f"{where}: point {found.name!r} has another position or sigma than above; give each point one")
    if any(pixel.view == found.pixels[0].view for pixel in known.pixels):
        raise InputError(f"{where}: point {found.name!r} is in view {found.pixels[0].view!r} twice; remove one line")
    return ControlPoint(
        name=known.name, position=known.position, sigma=known.sigma, pixels=(*known.pixels, *found.pixels)
    )


def _number(where: str, row: Mapping[str, str | None], column: str) -> float:
    try:
        value = float(row.get(column) or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{where}: {column} is {row.get(column)!r}, expected a number")
    return value


def _positive(where: str, row: Mapping[str, str | None], column: str) -> float:
    value = _number(where, row, column)
    if value <= 0:
        raise InputError(f"{where}: {column} is {value:g}, expected a positive number")
    return value
