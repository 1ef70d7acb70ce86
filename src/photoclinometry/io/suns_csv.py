"""A table of Sun directions, for images without labels: `image,sun_x,sun_y,sun_z`, optionally `sun_sigma_deg`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.csv_rows import CsvRow, read_csv_rows

_COLUMNS = ("image", "sun_x", "sun_y", "sun_z")
GIVE_SUN = "give the unit vector from the body towards the Sun in the camera frame (x right, y down, z forward)"
"""To do where a Sun is missing or wrong, for messages."""
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
    for row in read_csv_rows(path, "table of Suns", _COLUMNS):
        name = row.name("image")
        if name in rows:
            raise row.error(f"{name!r} occurs twice; remove one")
        rows[name] = _sun(row)
    return rows


def _sun(row: CsvRow) -> SunRow:
    sun = np.array([row.number(column) for column in _COLUMNS[1:]])
    length = math.hypot(*sun)
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise row.error(f"the Sun has length {length:.6g}, not 1; {GIVE_SUN}")
    sigma = math.radians(row.positive("sun_sigma_deg")) if row.has("sun_sigma_deg") else None
    return SunRow(sun / length, sigma)
