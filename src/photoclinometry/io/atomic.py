"""Files and folders that appear whole or not at all: written under a temporary name, then renamed."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from photoclinometry.model.errors import OutputError, RunFolderError

_REMEDIES = {
    errno.ENOSPC: "free some space or choose another output folder",
    errno.EDQUOT: "free some of your quota or choose another output folder",
    errno.EFBIG: "the file system or a limit forbids files of this size; choose another output folder",
    errno.EROFS: "the file system is read-only; choose another output folder",
    errno.EACCES: "you may not write there; change the permissions or choose another output folder",
    errno.EPERM: "you may not write there; change the permissions or choose another output folder",
    errno.ENOTDIR: "part of the path is a file, not a folder; choose another output folder",
    errno.EEXIST: "part of the path is a file, not a folder; choose another output folder",
    errno.EISDIR: "a folder of this name is in the way; move it or choose another output",
    errno.ENAMETOOLONG: "choose a shorter output path",
}


@contextlib.contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """A temporary path beside `path`, with the same suffix, that becomes `path` when the block succeeds.

        with atomic_path("out/landmarks.ply") as temporary:
            temporary.write_bytes(data)

    The block writes a file there, or makes a folder of files. Parent folders are made. On success everything
    is flushed to the disk and renamed over `path`; on any exception `path` stays as it was, and neither anything
    temporary nor an empty new folder remains. Every OSError becomes a RunFolderError with a remedy, those of the disk
    an OutputError.

    A link to a folder stays, and the folder that it leads to is replaced. The working folder and the root of a disk
    stay themselves, and their content is replaced; the temporary path then is within.
    """
    path = _replaceable(Path(path))
    place = path if _stays(path) else path.parent
    temporary = place / f".{path.stem}.partial-{secrets.token_hex(4)}{path.suffix}"
    new: list[Path] = []
    try:
        new = [folder for folder in path.parents if not folder.exists()]
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        _flush(temporary)
        _move_over(temporary, path)
        new.clear()
    except OSError as error:
        raise unwritable(path, error) from error
    except RunFolderError as error:  # of a file in a folder that is being made
        if str(temporary) not in str(error):
            raise
        raise type(error)(str(error).replace(str(temporary), str(path))) from error
    finally:
        _remove(temporary)
        for made in new:  # those made for this file alone, the innermost first
            with contextlib.suppress(OSError):
                made.rmdir()


def write_bytes(path: Path | str, data: bytes) -> None:
    """`data` as the file `path`, whole or not at all. Raises RunFolderError."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path | str, text: str) -> None:
    """`text` as the UTF-8 file `path`, whole or not at all. Raises RunFolderError."""
    write_bytes(path, text.encode())


_SHOWN = 60
"""Characters of a path that is too long that an error shows."""
_WRONG_PATH = frozenset({errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.ENAMETOOLONG})
"""Errors of the path that was given; all others are of the disk."""


def unwritable(path: Path, error: OSError) -> RunFolderError:
    """The error for a path that could not be written, with a remedy: an OutputError unless the path itself is wrong."""
    reason = error.strerror or str(error)
    remedy = _REMEDIES.get(error.errno or 0, "check the disk or choose another output folder")
    kind = RunFolderError if error.errno in _WRONG_PATH else OutputError
    place = too_long(path) if error.errno == errno.ENAMETOOLONG else path
    return kind(f"{place}: cannot be written: {reason}; {remedy}")


def too_long(path: Path | str) -> str:
    """A path that is too long, for messages: its beginning, and its length."""
    return f"{str(path)[:_SHOWN]}... ({len(str(path))} characters)"


def _replaceable(path: Path) -> Path:
    """The path as it was given; resolved where another cannot be renamed over it: ".", "..", and links.

    A link to a file is replaced like a file.
    """
    linked = os.path.islink(path) and not os.path.isfile(path)
    return Path(os.path.realpath(path)) if linked or path.name in ("", "..") else path


def _stays(path: Path) -> bool:
    """Whether a folder cannot be replaced by another: the working folder, which shells hold on to, or a disk's root."""
    return os.path.isdir(path) and (os.path.samefile(path, os.curdir) or os.path.ismount(path))


def _flush(path: Path) -> None:
    for file in [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file()]:
        with open(file, "rb+") as stream:
            os.fsync(stream.fileno())


def _move_over(source: Path, target: Path) -> None:
    """Rename `source` to `target`. A folder at `target` is moved aside first, and moved back if the rename fails."""
    if source.is_file() and target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not (source.is_dir() and target.is_dir()):
        os.replace(source, target)
        return
    if source.parent == target:
        _fill_from(source, target)
        return
    aside = target.with_name(f".{target.name}.replaced-{secrets.token_hex(4)}")
    os.replace(target, aside)
    try:
        os.replace(source, target)
    except OSError:
        os.replace(aside, target)
        raise
    shutil.rmtree(aside)


def _fill_from(source: Path, folder: Path) -> None:
    """Put the content of `source`, a folder in `folder`, in the place of all else there; if it fails, all goes back."""
    aside = folder / f".{folder.name}.replaced-{secrets.token_hex(4)}"
    moves = [(old, aside / old.name) for old in folder.iterdir() if old != source]
    moves += [(new, folder / new.name) for new in source.iterdir()]
    aside.mkdir()
    done: list[tuple[Path, Path]] = []
    try:
        for before, after in moves:
            os.replace(before, after)
            done.append((before, after))
    except OSError:
        for before, after in reversed(done):
            os.replace(after, before)
        aside.rmdir()
        raise
    shutil.rmtree(aside)


def _remove(path: Path) -> None:
    if os.path.isdir(path):  # Path.is_dir raises where the name is too long
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
