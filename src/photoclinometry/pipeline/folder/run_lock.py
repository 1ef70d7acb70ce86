"""The lock of a run folder: a file that names the process that writes there, so that no second one does.

A lock whose process has ended is stale, and is taken over: a run that was killed with -9 goes on without further steps.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil

from photoclinometry.io.atomic import unwritable
from photoclinometry.io.json_file import parse_json
from photoclinometry.model.errors import RunFolderError

log = logging.getLogger(__name__)

NAME = "lock"

GRACE_S = 10.0
"""A lock that cannot be read is taken for one that is just being written, up to this age. That takes milliseconds."""

SET_CLOCK_S = 60.0
"""A process whose start differs by less is the same one: some systems count the start from a clock that may be set
meanwhile. A process number is used again after all others, minutes later at the earliest."""

TRIES = 5
"""Most attempts to read a lock that vanishes or changes meanwhile."""


@dataclass(frozen=True)
class Holder:
    """The process that holds a lock."""

    pid: int
    host: str
    since: str
    """When the lock was made, in UTC."""
    process_started: float | None = None
    """When the process started, in seconds since 1970; None where that is not known. Process numbers are used again."""

    @property
    def is_here(self) -> bool:
        """Whether the process is one of this computer."""
        return self.host == socket.gethostname()

    @property
    def is_running(self) -> bool:
        """Whether the process still runs, or may; it must be one of this computer."""
        try:
            process = psutil.Process(self.pid)
            if process.status() == psutil.STATUS_ZOMBIE:
                return False
            return self.process_started is None or abs(process.create_time() - self.process_started) < SET_CLOCK_S
        except psutil.AccessDenied:
            return True  # another user's
        except (psutil.NoSuchProcess, OverflowError, ValueError):  # errors of numbers that no process can have, too
            return False


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Holds the lock of `folder` during the block.

    Raises RunFolderError where another process, or another thread of this one, holds it, or it cannot be written.
    """
    path = folder / NAME
    text = _take(path)
    try:
        yield
    finally:
        # Somebody may have removed it by hand, and another run have made its own.
        with suppress(OSError):
            if path.read_text(encoding="utf-8") == text:
                path.unlink()


def check_lock(folder: Path) -> None:
    """Raises RunFolderError where a process that may still run holds the lock of `folder`. Changes nothing."""
    text = _content(folder / NAME)
    if text is not None and not _is_stale(folder / NAME, text):
        raise RunFolderError(_refusal(folder / NAME, text))


def _take(path: Path) -> str:
    """Makes the lock; returns its content."""
    since = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    holder = Holder(os.getpid(), socket.gethostname(), since, psutil.Process().create_time())
    # Two threads of one process would write the same.
    text = json.dumps(asdict(holder) | {"token": secrets.token_hex(4)}) + "\n"
    for _ in range(TRIES):
        try:
            file = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
        except FileExistsError:
            found = _content(path)
            if found is not None:
                if not _is_stale(path, found):
                    raise RunFolderError(_refusal(path, found)) from None
                _remove_stale(path, found)
            continue
        except OSError as error:
            raise unwritable(path, error) from error
        try:
            with os.fdopen(file, "w", encoding="utf-8") as stream:
                stream.write(text)
        except OSError as error:
            with suppress(OSError):
                path.unlink()
            raise unwritable(path, error) from error
        return text
    raise RunFolderError(f"{path}: other runs make and remove it all the time; start one run at a time in this folder")


def _content(path: Path) -> str | None:
    """What the lock says; None where there is none (any more)."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be read: {error.strerror or error}; choose another --out") from error


def _holder(text: str) -> Holder | None:
    """The process that a lock names; None where it is damaged."""
    try:
        found = parse_json(text)
        pid, host, since = int(found["pid"]), str(found["host"]), str(found["since"])
        started = found.get("process_started")
        return Holder(pid, host, since, None if started is None else float(started))
    except (ValueError, KeyError, TypeError, OverflowError):
        return None


def _is_stale(path: Path, text: str) -> bool:
    """Whether no process can hold the lock any more."""
    holder = _holder(text)
    if holder is None:
        try:
            return time.time() - path.stat().st_mtime > GRACE_S
        except OSError:
            return False
    return holder.is_here and not holder.is_running


def _remove_stale(path: Path, text: str) -> None:
    """Removes a stale lock of this content, and none that another process has made meanwhile."""
    aside = path.with_name(f".{NAME}.partial-{secrets.token_hex(4)}")
    try:
        os.rename(path, aside)
        if aside.read_text(encoding="utf-8", errors="replace") != text:
            os.rename(aside, path)
            return
        aside.unlink()
    except FileNotFoundError:
        return
    except OSError as error:
        raise unwritable(path, error) from error
    log.info("%s: the run that held it has ended without removing it (%s); taken over", path, text.strip())


def _refusal(path: Path, text: str) -> str:
    """Who holds the lock, and what to do."""
    holder = _holder(text)
    if holder is None:
        return f"{path}: is just being written by another run; try again in {GRACE_S:.0f} s, or choose another --out"
    who = f"{path.parent}: process {holder.pid} on {holder.host} has been writing to this folder since {holder.since}"
    if holder.is_here:
        return f"{who}; wait for it, stop it, or choose another --out"
    return f"{who}; wait for it or choose another --out; if it no longer runs there, remove {path}"
