"""A file's bytes, or an error that names the file and says why not."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.model.errors import ImageError, InputError


def read_bytes(
    path: Path, what: str = "file", *, limit: int | None = None, error: type[InputError] = InputError
) -> bytes:
    """The file, or its first `limit` bytes. what: a word for it. Raises `error` where it is missing or unreadable."""
    try:
        with open(path, "rb") as stream:
            return stream.read(-1 if limit is None else limit)
    except FileNotFoundError:
        raise error(f"{path}: there is no such {what}; check the path") from None
    except OSError as cause:
        raise error(f"{path}: cannot be read: {cause.strerror or cause}") from cause


def read_image_bytes(path: Path, what: str = "file", *, limit: int | None = None) -> bytes:
    """As `read_bytes`, of a file that must hold something. Raises ImageError."""
    data = read_bytes(path, what, limit=limit, error=ImageError)
    if not data:
        raise ImageError(f"{path}: is an empty file; fetch or export it again")
    return data
