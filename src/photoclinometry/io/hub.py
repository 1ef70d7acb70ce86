"""Data sets published on Hugging Face: listed, fetched and verified. Needs the extra `fetch` (huggingface_hub).

A file is downloaded under a name ending in .part, which a later call resumes. It is renamed once its checksum is the
published one (SHA-256 of large files, git's blob hash of others). Public data sets only: no access token is used.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from photoclinometry import __version__
from photoclinometry.io.atomic import unwritable
from photoclinometry.model.errors import FetchError, InputError
from photoclinometry.model.progress import Progress, no_progress

AUTHORS_DATA = "travisdriver/phomo-data"
"""Images and models of Driver et al. (2025): huggingface.co/datasets/travisdriver/phomo-data."""

_BLOCK_BYTES = 1 << 20
"""Bytes that are read at a time for a checksum."""
_SHA1_DIGITS = 40
"""Hexadecimal digits of git's hash; SHA-256 has 64."""


@dataclass(frozen=True, kw_only=True)
class RemoteFile:
    """A file of a data set."""

    path: str
    """Within the data set, with slashes."""
    size: int
    """Bytes."""
    digest: str
    """Hexadecimal: SHA-256 of the content, or SHA-1 of it as a git blob."""


@dataclass(frozen=True, kw_only=True)
class DataSet:
    """The content of a data set at the time it was listed."""

    name: str
    commit: str
    """Files are fetched from this commit, even if another is published meanwhile."""
    endpoint: str | None
    """Address of the server; None for huggingface_hub's default ($HF_ENDPOINT, else huggingface.co)."""
    files: tuple[RemoteFile, ...]

    def folders(self) -> dict[str, tuple[int, int]]:
        """Number of files and bytes below each folder, by path, sorted."""
        found: dict[str, tuple[int, int]] = {}
        for file in self.files:
            for parent in list(PurePosixPath(file.path).parents)[:-1]:
                count, size = found.get(str(parent), (0, 0))
                found[str(parent)] = (count + 1, size + file.size)
        return dict(sorted(found.items()))

    def named(self, name: str) -> tuple[RemoteFile, ...]:
        """The files below the folder of this path, else below all folders of this name. Raises InputError for none."""
        wanted = PurePosixPath(name.strip("/"))
        folders = [PurePosixPath(folder) for folder in self.folders()]
        chosen = {f for f in folders if f == wanted} or {f for f in folders if f.name == str(wanted)}
        if not chosen:
            known = sorted({f.name for f in folders})
            raise InputError(f"{self.name} has no folder {name!r}; it has {', '.join(known) or 'none'}")
        return tuple(file for file in self.files if chosen & set(PurePosixPath(file.path).parents))


def list_files(name: str = AUTHORS_DATA, *, revision: str = "main", endpoint: str | None = None) -> DataSet:
    """The files of a data set. Raises FetchError if it cannot be listed, InputError without the extra."""
    with _hub_errors(name, f"revision {revision!r}"):
        api = _hub().HfApi(endpoint=endpoint, token=False)
        commit = api.dataset_info(name, revision=revision).sha
        entries = api.list_repo_tree(name, repo_type="dataset", revision=commit, recursive=True)
        files = tuple(_remote_file(name, entry) for entry in entries if hasattr(entry, "blob_id"))
    return DataSet(name=name, commit=str(commit), endpoint=endpoint, files=files)


def fetch_files(
    data: DataSet, files: tuple[RemoteFile, ...], out: Path | str, progress: Progress = no_progress
) -> list[str]:
    """Fetch files of a data set below `out`, in the data set's folders; returns the paths of those downloaded.

    Files that are there with the right checksum are kept, partial downloads are resumed. Raises FetchError if a file
    is not available or arrives damaged, RunFolderError if it cannot be written; files already complete are kept.
    """
    out, total = Path(out), sum(file.size for file in files)
    done, fetched = 0, []
    for file in files:

        def report(count: int, before: int = done) -> None:
            progress("fetch", before + count, total)

        target = out / file.path
        try:
            if not (target.is_file() and _has_digest(target, file)):
                _fetch(data, file, target, report)
                fetched.append(file.path)
        except FetchError:
            raise
        except OSError as error:
            raise unwritable(target, error) from error
        done += file.size
        report(0, done)
    return fetched


def _fetch(data: DataSet, file: RemoteFile, target: Path, report: Callable[[int], None]) -> None:
    part = target.with_name(target.name + ".part")
    target.parent.mkdir(parents=True, exist_ok=True)
    begun = part.stat().st_size if part.is_file() else 0
    if begun > file.size:
        part.unlink()
        begun = 0
    _download(data, file, part, report)
    if not _has_digest(part, file) and begun:  # the resumed part was damaged, or of another version
        part.unlink()
        _download(data, file, part, report)
    if not _has_digest(part, file):
        part.unlink()
        raise FetchError(f"{file.path}: arrived damaged: its checksum is not the published one; repeat the command")
    os.replace(part, target)


def _download(data: DataSet, file: RemoteFile, part: Path, report: Callable[[int], None]) -> None:
    """Downloads a file, or the rest of a file that was begun."""
    from huggingface_hub import hf_hub_url
    from huggingface_hub.file_download import http_get
    from huggingface_hub.utils import build_hf_headers, disable_progress_bars

    disable_progress_bars("huggingface_hub.http_get")
    url = hf_hub_url(data.name, file.path, repo_type="dataset", revision=data.commit, endpoint=data.endpoint)
    headers = build_hf_headers(token=False, library_name="photoclinometry", library_version=__version__)
    headers["Accept-Encoding"] = "identity"  # byte ranges must count bytes of the file, not of a compressed stream
    with open(part, "ab") as stream:
        begun = stream.tell()
        report(begun)
        if begun < file.size:
            with _hub_errors(data.name, file.path):
                http_get(url, _Counted(stream, report), resume_size=begun, headers=headers, expected_size=file.size)  # pyright: ignore[reportArgumentType]


class _Counted:
    """A stream that reports its position after every write."""

    def __init__(self, stream: Any, report: Callable[[int], None]):
        self._stream, self._report = stream, report

    def write(self, data: bytes) -> int:
        written = self._stream.write(data)
        self._report(self._stream.tell())
        return written

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _has_digest(path: Path, file: RemoteFile) -> bool:
    """Whether a file has the published size and checksum."""
    if path.stat().st_size != file.size:
        return False
    git = len(file.digest) == _SHA1_DIGITS
    whole = hashlib.sha1(b"blob %d\0" % file.size, usedforsecurity=False) if git else hashlib.sha256()
    with open(path, "rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            whole.update(block)
    return whole.hexdigest() == file.digest


def _remote_file(name: str, entry: Any) -> RemoteFile:
    path = PurePosixPath(entry.path)
    if path.is_absolute() or ".." in path.parts or "\\" in entry.path or "\0" in entry.path:
        raise FetchError(
            f"{name}: names a file {entry.path!r}, which lies outside of the output folder; do not trust this data set"
        )
    digest = entry.lfs.sha256 if entry.lfs is not None else entry.blob_id
    return RemoteFile(path=str(path), size=int(entry.size), digest=digest)


def _hub() -> Any:
    try:
        import huggingface_hub
    except ImportError as error:
        raise InputError(
            "published data sets are fetched with huggingface_hub: pip install 'photoclinometry[fetch]'"
        ) from error
    return huggingface_hub


@contextmanager
def _hub_errors(name: str, what: str) -> Iterator[None]:
    """Turns errors of the network and the server into FetchError."""
    _hub()
    from httpx2 import HTTPError
    from huggingface_hub.errors import HFValidationError, RepositoryNotFoundError, RevisionNotFoundError

    try:
        yield
    except HFValidationError as error:
        raise InputError(f"{name!r} is not the name of a data set ({error}); give OWNER/NAME") from error
    except RepositoryNotFoundError as error:
        raise FetchError(f"{name}: there is no such public data set; check its name") from error
    except RevisionNotFoundError as error:
        raise FetchError(f"{name}: has no {what}; check it") from error
    except (HTTPError, ConnectionError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise FetchError(
            f"{name}: {what} cannot be fetched ({reason}); check the network and repeat the command: it resumes the "
            "download"
        ) from error
    except OSError as error:
        if error.errno is not None:
            raise
        raise FetchError(
            f"{name}: {what} arrived in part ({str(error).splitlines()[0]}); repeat the command"
        ) from error
