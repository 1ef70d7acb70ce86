"""A table of laser altimetry: `track,x_m,y_m,z_m,sigma_m,track_sigma_m`, a line for each shot.

Shots of a track share the error of the spacecraft's orbit, of standard deviation `track_sigma_m` along each axis, which
is stated once or in every line. `sigma_m` is that of each shot's own error.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photoclinometry.io.csv_columns import write_csv
from photoclinometry.io.csv_rows import CsvRow, read_csv_rows
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.errors import InputError

_POSITION = ("x_m", "y_m", "z_m")
_COLUMNS = ("track", *_POSITION, "sigma_m", "track_sigma_m")


def read_altimetry(path: Path | str) -> AltimeterTracks:
    """The shots in the order of the table, in the body-fixed frame [m]. Raises InputError that names the line."""
    path = Path(path)
    rows = read_csv_rows(path, "table of altimetry", _COLUMNS)
    if not rows:
        raise InputError(f"{path}: has no shot; write a line for each")
    sigma_of: dict[str, float] = {}
    for row in rows:
        _take_track(row, sigma_of)
    names = tuple(sigma_of)
    number = {name: n for n, name in enumerate(names)}
    return AltimeterTracks(
        name=names,
        shift_sigma=np.array([sigma_of[name] for name in names]),
        track=np.array([number[row.name("track")] for row in rows]),
        position=np.array([[row.number(column) for column in _POSITION] for row in rows]),
        sigma=np.array([row.positive("sigma_m") for row in rows]),
    )


def write_altimetry(path: Path | str, tracks: AltimeterTracks, more: dict[str, np.ndarray] | None = None) -> None:
    """The same table; more: further columns (n,), by name. Raises RunFolderError."""
    names: Sequence[str] = [tracks.name[n] for n in tracks.track]
    position = dict(zip(_POSITION, tracks.position.T, strict=True))
    sigmas = {"sigma_m": tracks.sigma, "track_sigma_m": tracks.shift_sigma[tracks.track]}
    write_csv(path, {"track": names, **position, **sigmas, **(more or {})})


def _take_track(row: CsvRow, sigma_of: dict[str, float]) -> None:
    """The row's track, by name, with the standard deviation of its shift."""
    name = row.name("track")
    if name in sigma_of and not row.has("track_sigma_m"):
        return
    sigma = row.positive("track_sigma_m")
    if sigma_of.setdefault(name, sigma) != sigma:
        raise row.error(
            f"track {name!r} has a track_sigma_m of {sigma_of[name]:g} m above and {sigma:g} m here; give each track "
            "one"
        )
