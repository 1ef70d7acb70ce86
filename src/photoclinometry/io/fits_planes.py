"""FITS files of named quantities: a cube of planes over a grid, or a binary table of columns."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.atomic import write_bytes


@dataclass(frozen=True)
class Plane:
    """One quantity."""

    name: str
    unit: str
    """Empty for pure numbers."""
    values: np.ndarray
    """(h, w) of a cube, (n,) of a table; NaN where there is none."""
    exact: bool = False
    """Whether a table has it in double precision, as positions are."""


@dataclass(frozen=True)
class Card:
    """A keyword with its value and comment."""

    key: str
    value: str | float
    comment: str


def write_cube(path: Path | str, planes: Sequence[Plane], cards: Sequence[Card]) -> None:
    """Planes (h, w) as one image in single precision, the first row at the bottom. PLANE1, PLANE2, ... are the names,
    with units as comments. Raises RunFolderError."""
    from astropy.io import fits

    cube: Any = fits.PrimaryHDU(np.stack([plane.values for plane in planes]).astype(">f4"))
    _add(cube.header, cards)
    for number, plane in enumerate(planes, start=1):
        cube.header[f"PLANE{number}"] = (plane.name, f"[{plane.unit}]" if plane.unit else "")
    _write(path, cube)


def write_table(path: Path | str, columns: Sequence[Plane], cards: Sequence[Card]) -> None:
    """Columns (n,) as a binary table: whole numbers in 32 bits, others in single precision unless they are exact.

    Raises RunFolderError.
    """
    from astropy.io import fits

    found = [
        fits.Column(
            name=column.name,
            format="J" if column.values.dtype.kind in "iu" else "D" if column.exact else "E",
            unit=column.unit or None,
            array=column.values,
        )
        for column in columns
    ]
    table: Any = fits.BinTableHDU.from_columns(found)
    _add(table.header, cards)
    _write(path, fits.HDUList([fits.PrimaryHDU(), table]))


def _add(header: Any, cards: Sequence[Card]) -> None:
    for card in cards:
        value = card.value
        if isinstance(value, str):  # FITS has ASCII alone
            value = "".join(c if " " <= c <= "~" else "?" for c in value)
        header[card.key] = (value, card.comment)


def _write(path: Path | str, hdus: Any) -> None:
    buffer = io.BytesIO()
    hdus.writeto(buffer)
    write_bytes(path, buffer.getvalue())
