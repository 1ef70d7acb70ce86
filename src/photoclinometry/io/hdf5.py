"""HDF5 files: written whole or not at all."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path

import h5py

from photoclinometry.io.atomic import atomic_path


@contextlib.contextmanager
def new_hdf5(path: Path | str) -> Iterator[h5py.File]:
    """An HDF5 file to fill, which becomes `path` when the block succeeds. Raises RunFolderError.

    It is built in memory, since HDF5 cannot close a file after a write to a full disk has failed.
    """
    stream = io.BytesIO()
    with h5py.File(stream, "w", libver=("v110", "v110")) as file:
        yield file
    with atomic_path(path) as temporary:
        temporary.write_bytes(stream.getbuffer())
