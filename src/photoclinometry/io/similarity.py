"""A similarity transform as a TOML file: scale, rotation (3 rows of 3 numbers) and translation (3 numbers)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import write_text
from photoclinometry.io.toml_file import read_toml
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity

_ROTATION_TOLERANCE = 1e-6
"""Rows of a rotation written with seven decimals are this near to orthonormal."""


def write_similarity(path: Path | str, similarity: Similarity) -> None:
    """The transform, exact to the last bit. Raises RunFolderError."""
    import tomli_w

    rows = {"scale": float(similarity.scale), "rotation": np.asarray(similarity.rotation).tolist()}
    write_text(path, tomli_w.dumps(rows | {"translation": np.asarray(similarity.translation).tolist()}))


def read_similarity(path: Path | str) -> Similarity:
    """The transform in the file. Raises InputError if the file is missing or holds no similarity transform."""
    path = Path(path)
    table = read_toml(path, "TOML file with scale, rotation and translation")
    table.expect("scale", "rotation", "translation")
    scale = table.positive_number("scale")
    rotation = table.matrix("rotation", 3)
    translation = table.numbers("translation", 3)
    table.finish()
    # Larger entries are of no rotation, and their products may overflow.
    off = np.abs(rotation).max() if np.abs(rotation).max() > 2.0 else np.abs(rotation @ rotation.T - np.eye(3)).max()
    if off > _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError(
            f"{path}: rotation: is not a rotation (rows off orthonormal by {off:.2g}, or mirrored); correct it"
        )
    return Similarity(scale, rotation, translation)
