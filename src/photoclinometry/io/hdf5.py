"""HDF5 files: written whole or not at all, and read in a process of their own before they are read here."""

from __future__ import annotations

import atexit
import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path
from threading import Lock

import h5py

from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.child import Child, NoAnswerError
from photoclinometry.model.errors import InputError

_TIMEOUT_S = 120.0
"""Longest wait for a check [s], where the system has no limit of CPU time, or is busy."""


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
    _checks.sound.add(_state(Path(path)))


def check_hdf5(path: Path, what: str, remedy: str, error: type[InputError] = InputError) -> None:
    """Raises `error` for a file that HDF5 cannot read without harm, or whose values are elsewhere (`io/hdf5_check.py`).

    what: kind of file, and remedy: what to do, for messages. A file that this process wrote, or has checked, and that
    has not changed since, is not checked again.
    """
    try:
        state = _state(path)
    except OSError as cause:
        raise error(f"{path}: cannot be read: {cause.strerror or cause}; check the path") from cause
    if state in _checks.sound:
        return
    fault = _checks.fault_of(path)
    if fault:
        raise error(f"{path}: is not a {what}, or is damaged ({fault}); {remedy}")
    _checks.sound.add(state)


class _Checks:
    """The process that checks, started when it is needed, and again after a file has ended it."""

    def __init__(self):
        self.sound: set[tuple[str, int, int]] = set()
        """Path, size and time of change [ns] of files that need no check."""
        self.child: Child | None = None
        self.owner = 0
        """The process that started it: a fork of that must not use its pipes."""
        self.lock = Lock()

    def fault_of(self, path: Path) -> str:
        """What is wrong with a file; empty where nothing is."""
        with self.lock:
            try:
                return self._started().ask(str(path.resolve()), _TIMEOUT_S)
            except NoAnswerError:
                self.end()
                return "the HDF5 library crashes on it, or does not end"

    def _started(self) -> Child:
        if self.child is None or self.owner != os.getpid():
            self.child = Child("hdf5_check.py")
            self.owner = os.getpid()
        return self.child

    def end(self) -> None:
        """Ends the process."""
        if self.child is not None and self.owner == os.getpid():
            self.child.close()
            self.child = None


_checks = _Checks()
atexit.register(_checks.end)


def _state(path: Path) -> tuple[str, int, int]:
    about = path.stat()
    return str(path.resolve()), about.st_size, about.st_mtime_ns
