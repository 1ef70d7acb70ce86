"""A table of ground control points: `point,view,x_px,y_px,x_m,y_m,z_m,sigma_m`, a line for each measured pixel.

Optional columns: `sigma_px` (default 1) and, in place of `sigma_m`, `sigma_x_m,sigma_y_m,sigma_z_m`. Lines of one point
repeat its position.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photoclinometry.io.csv_rows import CsvRow, read_csv_rows
from photoclinometry.model.control import ControlPixel, ControlPoint
from photoclinometry.model.errors import InputError

DEFAULT_SIGMA_PX = 1.0
"""Standard deviation of a pixel that a person pointed at."""

_COLUMNS = ("point", "view", "x_px", "y_px", "x_m", "y_m", "z_m")
_AXES = ("sigma_x_m", "sigma_y_m", "sigma_z_m")


def read_control_points(path: Path | str, views: Sequence[str] | None = None) -> tuple[ControlPoint, ...]:
    """Control points in the order of the table. views: those of the site, outside of which no point may be.

    Raises InputError that names the line.
    """
    path = Path(path)
    points: dict[str, ControlPoint] = {}
    for row in read_csv_rows(path, "table of control points", _COLUMNS, either=(("sigma_m",), _AXES)):
        found = _point(row)
        view = found.pixels[0].view
        if views is not None and view not in views:
            raise row.error(
                f"point {found.name!r} is in view {view!r}, which the site does not have; write the image's path as "
                f"site.toml does (the first is {views[0]!r})"
            )
        known = points.get(found.name)
        points[found.name] = found if known is None else _joined(row, known, found)
    if not points:
        raise InputError(f"{path}: has no control point; write a line for each measured pixel")
    return tuple(points.values())


def _point(row: CsvRow) -> ControlPoint:
    name, view = row.name("point"), row.name("view")
    x, y, *position = (row.number(column) for column in _COLUMNS[2:])
    axes = _AXES if row.has(_AXES[0]) else ("sigma_m",) * 3
    sigma = np.array([row.positive(column) for column in axes])
    pixel = ControlPixel(view, x, y, row.positive("sigma_px", DEFAULT_SIGMA_PX))
    return ControlPoint(name=name, position=np.array(position), sigma=sigma, pixels=(pixel,))


def _joined(row: CsvRow, known: ControlPoint, found: ControlPoint) -> ControlPoint:
    """A point with one more pixel."""
    if not np.array_equal(known.position, found.position) or not np.array_equal(known.sigma, found.sigma):
        raise row.error(f"point {found.name!r} has another position or sigma than above; give each point one")
    if any(pixel.view == found.pixels[0].view for pixel in known.pixels):
        raise row.error(f"point {found.name!r} is in view {found.pixels[0].view!r} twice; remove one line")
    return ControlPoint(
        name=known.name, position=known.position, sigma=known.sigma, pixels=(*known.pixels, *found.pixels)
    )
