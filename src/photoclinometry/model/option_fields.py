"""Options given field by field: the fields are checked by name, and words by the type that the field allows."""

from __future__ import annotations

import difflib
import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from photoclinometry.model.errors import InputError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Options = TypeVar("Options", bound="DataclassInstance")


def changed(options: Options, changes: Mapping[str, Any]) -> Options:
    """The options with some fields replaced. Raises InputError for a field or a choice that does not exist."""
    known = [f.name for f in fields(options)]
    for name in changes:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
            raise InputError(f"{type(options).__name__} has no option {name!r}; the nearest is {near!r}")
    new = replace(options, **changes)
    check_choices(new)
    return new


def check_choices(options: DataclassInstance) -> None:
    """Raises InputError where a field holds a word that its type does not allow; nested options are checked too."""
    hints = get_type_hints(type(options))
    for name in (f.name for f in fields(options)):
        value, allowed = getattr(options, name), choices(hints[name])
        if is_dataclass(value) and not isinstance(value, type):
            check_choices(value)
        for word in value if isinstance(value, tuple) else (value,):
            if allowed and isinstance(word, str) and word not in allowed:
                raise InputError(f"{name}={word!r}: must be one of {', '.join(map(repr, allowed))}")


def choices(hint: Any) -> tuple[str, ...]:
    """The words that a type hint allows, also as members of a union or elements of a tuple; none: any word."""
    if get_origin(hint) is Literal:
        return get_args(hint)
    if get_origin(hint) in (Union, types.UnionType, tuple):
        parts = [choices(part) for part in get_args(hint) if part not in (types.NoneType, Ellipsis)]
        return tuple(word for words in parts for word in words) if all(parts) else ()
    return ()
