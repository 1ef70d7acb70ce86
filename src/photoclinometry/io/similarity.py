"""A similarity transform as a TOML file: scale, rotation (3 rows of 3 numbers) and translation (3 numbers)."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import write_text
from photoclinometry.io.reading import read_bytes
from photoclinometry.io.table import Table
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity

_ROTATION_TOLERANCE = 1e-6


def write_similarity(path: Path | str, similarity: Similarity) -> None:
    """The transform, exact to the last bit. Raises RunFolderError."""
    import tomli_w

    rows = {"scale": float(similarity.scale), "rotation": np.asarray(similarity.rotation).tolist()}
    write_text(path, tomli_w.dumps(rows | {"translation": np.asarray(similarity.translation).tolist()}))


def read_similarity(path: Path | str) -> Similarity:
    """The transform in the file. Raises InputError for a file that is missing or holds no similarity."""
    path = Path(path)
    data = read_bytes(path)
    try:
        table = Table(tomllib.loads(data.decode()), str(path))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as TOML: {error}") from error
    scale = table.positive_number("scale")
    rotation = table.matrix("rotation", 3)
    translation = table.numbers("translation", 3)
    table.finish()
    off = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if off > _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError(f"{path}: rotation: is no rotation (rows not orthonormal by {off:.2g}, or a mirror image)")
    return Similarity(scale, rotation, translation)
