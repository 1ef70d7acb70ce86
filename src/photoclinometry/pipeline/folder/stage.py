"""A stage of a run: a value that holds all its inputs, and a key that follows from them.

A stage is a frozen dataclass. Its fields are everything that may shape its result: options, fingerprints of inputs,
results of earlier stages. `make` sees nothing else, so the key is a digest of the fields, and no list of dependencies
is kept by hand. Results of earlier stages count by their keys, options and arrays by their values.

The program counts, too (`program_digest`), as the sources of the whole package. A change of the code makes every stage
anew, also where the change was in a function that the stage calls indirectly; following such calls was not thought
worth the risk of missing one. An installed version has the same sources, hence the same digest, until it is upgraded.
Where only compiled files are installed, the version stands for them.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

import photoclinometry
from photoclinometry.model.progress import Progress

T = TypeVar("T")

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Keyed(Generic[T]):
    """A value that is too large or of too many kinds to be digested, with a key that distinguishes it from all
    others."""

    value: T
    key: str


@dataclass(frozen=True, kw_only=True)
class Tools:
    """Tools that `Stage.make` may use, and that must not shape its result."""

    progress: Progress
    scratch: Path
    """A folder for files of its own."""


@dataclass(frozen=True, kw_only=True)
class Stage(Generic[T]):
    """One stage. A subclass names itself and the type of its result, adds fields, and implements `make`."""

    name: ClassVar[str]
    result: ClassVar[type]
    """A dataclass that `records` can write. Only used of stages that are kept."""
    kept: ClassVar[bool] = True
    """Whether the result is kept in the run folder; what is made in a moment is not."""

    def make(self, tools: Tools) -> T:
        """The result, from the fields alone."""
        raise NotImplementedError

    @property
    def file_name(self) -> str:
        """Of its result in the run folder, without ending."""
        return self.name

    @property
    def key(self) -> str:
        return digest(program_digest(), self.name, self)


def say_found(what: str) -> None:
    """Logs what a stage has found and how good it is, in 50 characters; the terminal shows it in the stage's line."""
    log.info("found: %s", what, extra={"found": what})


@cache
def program_digest() -> str:
    """A digest of the package's Python sources, or its version where it is installed without them."""
    root = Path(photoclinometry.__file__).parent
    sources = sorted(root.rglob("*.py"))
    if not sources:
        return photoclinometry.__version__
    found = hashlib.sha256()
    for source in sources:
        found.update(source.relative_to(root).as_posix().encode() + b"\0")
        found.update(hashlib.sha256(source.read_bytes()).digest())
    return found.hexdigest()


def digest(*parts: Any) -> str:
    """A short digest of options (dataclasses), arrays, mappings, sequences, text, numbers and `Keyed` values.

    The order of a mapping does not count. Raises TypeError for anything else, such as an object whose text does not
    show its value.
    """
    return hashlib.sha256(json.dumps([_content(part) for part in parts]).encode()).hexdigest()[:20]


def _content(value: Any) -> Any:
    """The value as JSON can write it, such that different values are written differently."""
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    if isinstance(value, Keyed):
        return {"key": value.key}
    if is_dataclass(value) and not isinstance(value, type):
        return {type(value).__qualname__: {f.name: _content(getattr(value, f.name)) for f in fields(value)}}
    if isinstance(value, np.generic):
        return _content(value.item())
    if isinstance(value, np.ndarray) and value.dtype != object:
        bytes_ = np.ascontiguousarray(value).tobytes()
        return {"array": [value.dtype.str, list(value.shape), hashlib.sha256(bytes_).hexdigest()]}
    if isinstance(value, Mapping):
        return {"mapping": sorted([str(name), _content(item)] for name, item in value.items())}
    if isinstance(value, (list, tuple)):
        return [_content(item) for item in value]
    if isinstance(value, Path):
        return {"path": str(value)}
    raise TypeError(f"{type(value).__qualname__} has no digest; give it as Keyed, with a key")
