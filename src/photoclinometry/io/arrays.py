"""Named arrays as one compressed NumPy archive (.npz)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np


def write_arrays(path: Path | str, arrays: Mapping[str, np.ndarray]) -> None:
    """The arrays by name, exact to the last bit; within a folder that `atomic_path` makes."""
    with open(path, "wb") as stream:
        np.savez_compressed(stream, **arrays)  # pyright: ignore[reportArgumentType]


def read_arrays(path: Path | str) -> dict[str, np.ndarray]:
    """The arrays that `write_arrays` wrote; pickled objects are never loaded.

    Damaged archives raise nearly every built-in exception (zipfile).
    """
    # NumPy leaves a file that it has opened itself, and that is damaged, open.
    with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as stored:
        found = {name: stored[name] for name in stored}
    if not all(isinstance(values, np.ndarray) for values in found.values()):
        raise ValueError(f"{path}: holds members that are no arrays")
    return found
