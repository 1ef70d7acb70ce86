"""The content of a file, or an error that names the file and the reason."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.model.errors import ImageError, InputError


def read_bytes(
    path: Path,
    what: str = "file",
    *,
    limit: int | None = None,
    error: type[InputError] = InputError,
    remedy: str = "check the path",
) -> bytes:
    """The file, or its first `limit` bytes.

    what: kind of file, and remedy: what to do where it is missing, both for messages. Raises `error` where the file is
    missing or unreadable.
    """
    try:
        with open(path, "rb") as stream:
            return stream.read(-1 if limit is None else limit)
    except FileNotFoundError:
        raise error(f"{path}: there is no such {what}; {remedy}") from None
    except OSError as cause:
        raise error(f"{path}: cannot be read: {cause.strerror or cause}; {remedy}") from cause


def read_text(
    path: Path, what: str = "file", *, error: type[InputError] = InputError, remedy: str = "check the path"
) -> str:
    """As `read_bytes`, decoded as UTF-8, with or without a byte-order mark."""
    try:
        return read_bytes(path, what, error=error, remedy=remedy).decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        raise error(f"{path}: is not UTF-8 text ({cause.reason} at byte {cause.start}); {remedy}") from cause


def read_limited(path: Path, what: str, limit: int) -> bytes:
    """As `read_bytes`, whole, of a kind of file that is never larger than `limit` bytes. Raises InputError."""
    data = read_bytes(path, what, limit=limit + 1)
    if len(data) > limit:
        raise InputError(f"{path}: is larger than {limit >> 20} MiB, so it is no {what}; check the path")
    return data


def read_image_bytes(path: Path, what: str = "file", *, limit: int | None = None) -> bytes:
    """As `read_bytes`, of a file that must not be empty. Raises ImageError."""
    data = read_bytes(path, what, limit=limit, error=ImageError)
    if not data:
        raise ImageError(f"{path}: is an empty file; fetch or export it again")
    return data
