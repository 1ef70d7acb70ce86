"""Gaskell's implicitly connected quadrilaterals (ICQ): the shape models of stereophotoclinometry (SHAPE.TXT).

The vertices are those of grids of (Q + 1) x (Q + 1) on the six sides of a cube, wrapped onto the body. The first line
is Q. Then follows one vertex x y z a line [km]: side by side from 1 to 6, row by row (J from 0 to Q), I fastest. Side 1
looks to +z, 2 to -y, 3 to -x, 4 to +y, 5 to +x, 6 to -z. Sides repeat the vertices of the edges that they share.
https://sbib.psi.edu/spc_wiki/SHAPE.TXT; the order was compared with a published model of Bennu.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.reading import read_bytes
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit

LARGEST_Q = 512
"""The largest Q that SPC accepts."""
_CORNERS = (
    ((-1, 1, 1), (1, 1, 1), (-1, -1, 1)),
    ((-1, -1, 1), (1, -1, 1), (-1, -1, -1)),
    ((-1, 1, 1), (-1, -1, 1), (-1, 1, -1)),
    ((1, 1, 1), (-1, 1, 1), (1, 1, -1)),
    ((1, -1, 1), (1, 1, 1), (1, -1, -1)),
    ((-1, -1, -1), (1, -1, -1), (-1, 1, -1)),
)
"""Of each side the corners of the cube at (I, J) = (0, 0), (Q, 0) and (0, Q)."""


def icq_directions(q: int) -> np.ndarray:
    """(6, Q + 1, Q + 1, 3) unit vectors of the grids, by side, J and I, at equal angles along the middles of sides."""
    angle = np.tan(np.linspace(-0.25, 0.25, q + 1) * np.pi)
    right, down = 0.5 * (1.0 + angle)[None, :, None], 0.5 * (1.0 + angle)[:, None, None]
    sides = []
    for corners in _CORNERS:
        first, along, below = (np.array(corner, float) for corner in corners)
        sides.append(first + right * (along - first) + down * (below - first))
    return unit(np.stack(sides))


def icq_faces(q: int) -> np.ndarray:
    """(12 Q^2, 3) triangles of the rows of a file, outwards; quadrilaterals are cut from (I, J) to (I + 1, J + 1)."""
    index = np.arange(6 * (q + 1) ** 2).reshape(6, q + 1, q + 1)
    here, right = index[:, :-1, :-1].ravel(), index[:, :-1, 1:].ravel()
    below, across = index[:, 1:, :-1].ravel(), index[:, 1:, 1:].ravel()
    return np.stack([np.stack([here, across, right], -1), np.stack([here, below, across], -1)], 1).reshape(-1, 3)


def write_icq(path: Path | str, vertices_km: np.ndarray) -> None:
    """Vertices (6, Q + 1, Q + 1, 3) [km] by side, J and I. Raises RunFolderError."""
    q = vertices_km.shape[1] - 1
    # Twelve characters a number, as SPC has them, with the decimals that fit beside sign, digits and point.
    digits = len(str(int(np.abs(vertices_km).max())))
    with atomic_path(path) as temporary, open(temporary, "w", encoding="ascii") as stream:
        stream.write(f"{q:12d}\n")
        np.savetxt(stream, vertices_km.reshape(-1, 3), fmt=f"%12.{max(9 - digits, 0)}f", delimiter="")


def read_icq(path: Path | str) -> np.ndarray:
    """Vertices (6, Q + 1, Q + 1, 3) [km] by side, J and I. Raises InputError for files that are damaged or no model."""
    path = Path(path)
    lines = read_bytes(path).split(b"\n", 1)
    try:
        q = int(lines[0])
    except ValueError as error:
        raise InputError(f"{path}: is not an ICQ shape model (its first line is not a whole number)") from error
    if not 1 <= q <= LARGEST_Q:
        raise InputError(f"{path}: has Q = {q}, ICQ models have 1 to {LARGEST_Q}")
    try:
        numbers = np.array(lines[1].split() if len(lines) > 1 else [], np.float64)
    except ValueError as error:
        raise InputError(f"{path}: is not a complete ICQ shape model ({error}); fetch it again") from error
    expected = 18 * (q + 1) ** 2
    if len(numbers) != expected or not np.isfinite(numbers).all():
        raise InputError(
            f"{path}: has {len(numbers)} coordinates, Q = {q} takes {expected} finite ones; fetch it again"
        )
    return numbers.reshape(6, q + 1, q + 1, 3)
