"""The model for other programs of navigation: SPC's ICQ and SPICE's DSK."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry import __version__
from photoclinometry.io.models.icq import icq_directions, write_icq
from photoclinometry.io.spice_dsk import write_dsk
from photoclinometry.model.geometry import KM_PER_M
from photoclinometry.output.export.shape.placed import PlacedShape

_QS = (64, 128, 256, 512)


def write_icq_model(folder: Path, placed: PlacedShape, products: tuple[str, ...], options: Any) -> dict[str, str]:
    """Writes SHAPE.TXT of a star-shaped model; returns its description. Raises RunFolderError."""
    q = placed.options.icq_q or nearest_q(len(placed.shape.faces))
    directions = icq_directions(q)
    radius, _, _ = placed.rays.outermost(directions.reshape(-1, 3))
    write_icq(folder / "SHAPE.TXT", KM_PER_M * radius.reshape(*directions.shape[:-1], 1) * directions)
    return {"SHAPE.TXT": f"ICQ model with Q = {q} for stereophotoclinometry (SPC), in km"}


def nearest_q(facets: int) -> int:
    """The Q whose 12 Q^2 triangles are nearest to a number of facets, by their ratio."""
    return min(_QS, key=lambda q: abs(np.log(12.0 * q * q / facets)))


def write_dsk_model(folder: Path, placed: PlacedShape, products: tuple[str, ...], options: Any) -> dict[str, str]:
    """Writes shape.bds; returns its description. Raises InputError for what SPICE refuses, and RunFolderError."""
    comments = [
        f"Shape model {placed.name}, {len(placed.shape.faces)} plates, lengths in km.",
        f"Written by photoclinometry {__version__}.",
    ]
    body, frame = write_dsk(
        folder / "shape.bds",
        placed.shape.vertices,
        placed.shape.faces,
        place=placed.dsk_place,
        single_valued=placed.star_shaped,
        comments=comments,
    )
    return {"shape.bds": f"DSK of type 2 of body {body} in frame {frame}, surface {placed.options.surface_id}, in km"}
