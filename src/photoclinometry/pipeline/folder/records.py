"""Results of stages on disk: any dataclass of arrays, numbers, text and further dataclasses, as an .npz with its key.

What is not an array is in one JSON text. Values come back by the types that the dataclass states: exactly as they were,
to the last bit. The warnings of the stage are kept with its result, so that a run that goes on ends with the same ones.
"""

from __future__ import annotations

import json
import logging
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from photoclinometry.io.atomic import atomic_path
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.warning import Warned, warn

log = logging.getLogger(__name__)

T = TypeVar("T")
R = TypeVar("R")
_ARRAY = {"array": True}
"""Stands in the JSON text for an array that is stored beside it."""


@dataclass(frozen=True)
class Record(Generic[T]):
    """What is kept of a stage."""

    value: T
    warnings: tuple[Warned, ...]


def write_record(file: Path, key: str, value: Any, warnings: Sequence[Warned] = ()) -> None:
    """The value, with the key of the stage that made it, and what that warned of.

    Raises RunFolderError, and TypeError for other values.
    """
    arrays: dict[str, np.ndarray] = {}
    text = json.dumps(_encoded(value, "value", arrays))
    said = json.dumps([warning.as_row() for warning in warnings])
    with atomic_path(file) as temporary, open(temporary, "wb") as stream:
        np.savez(stream, key=np.array(key), text=np.array(text), warnings=np.array(said), **arrays)  # pyright: ignore[reportArgumentType]


def read_record(file: Path, key: str, kind: type[T]) -> Record[T] | None:
    """What `write_record` wrote; None where nothing of this key is there. A damaged file is warned of.

    Raises RunFolderError for a file that may not be read, and MemoryError.
    """

    def content(stored: Mapping[str, np.ndarray]) -> Record[T] | None:
        if str(stored["key"]) != key:
            return None
        warnings = tuple(Warned(**row) for row in json.loads(str(stored["warnings"])))
        return Record(_decoded(kind, json.loads(str(stored["text"])), "value", stored), warnings)

    return _read(file, content)


def has_record(file: Path, key: str) -> bool:
    """Whether there is a result of this key. Reads the key alone: damage to the rest shows in `read_record`.

    Raises as that.
    """
    return _read(file, lambda stored: str(stored["key"]) == key) or False


def _read(file: Path, content: Callable[[Mapping[str, np.ndarray]], R]) -> R | None:
    """The content of a record's file, whose arrays are read as they are asked for; None where it is not there, or
    damaged. Warns and raises as `read_record`."""
    if not file.is_file():
        return None
    try:
        with open(file, "rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return content(stored)
    except MemoryError:
        raise
    except PermissionError as error:
        raise RunFolderError(
            f"{file}: cannot be read: {error.strerror}; change the permissions or choose another --out"
        ) from error
    # zipfile meets damage with nearly every built-in exception.
    except Exception as error:
        warn(log, "file-damaged", "%s: damaged (%s); the stage is done again", file, error)
        return None


def _encoded(value: Any, name: str, arrays: dict[str, np.ndarray]) -> Any:
    """The value for JSON; its arrays go into `arrays`, each by the dotted name of its place."""
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return _ARRAY
    if isinstance(value, np.generic):
        return value.item()
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: _encoded(getattr(value, f.name), f"{name}.{f.name}", arrays) for f in fields(value)}
    if isinstance(value, Mapping):
        return {key: _encoded(item, f"{name}.{key}", arrays) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_encoded(item, f"{name}.{n}", arrays) for n, item in enumerate(value)]
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise TypeError(f"{name}: {type(value).__qualname__} cannot be kept")


def _decoded(kind: Any, plain: Any, name: str, arrays: Mapping[str, np.ndarray]) -> Any:
    """The value of a stated type from what `_encoded` made of it."""
    if plain == _ARRAY:
        return arrays[name]
    if plain is None:
        return None
    if typing.get_origin(kind) in (types.UnionType, typing.Union):  # X | None
        (kind,) = (choice for choice in typing.get_args(kind) if choice is not types.NoneType)
    arguments = typing.get_args(kind)
    if typing.get_origin(kind) is dict:
        return {key: _decoded(arguments[1], item, f"{name}.{key}", arrays) for key, item in plain.items()}
    if typing.get_origin(kind) is tuple:
        kinds = arguments[:1] * len(plain) if arguments[-1] is Ellipsis else arguments
        pairs = enumerate(zip(kinds, plain, strict=True))
        return tuple(_decoded(one, item, f"{name}.{n}", arrays) for n, (one, item) in pairs)
    if not is_dataclass(kind):
        return kind(plain)
    stated = typing.get_type_hints(kind)
    parts = {part: _decoded(stated[part], item, f"{name}.{part}", arrays) for part, item in plain.items()}
    return typing.cast(Any, kind)(**parts)
