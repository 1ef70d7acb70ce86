"""The range of every numeric option, stated once beside the field, and checked whenever options are made.

    @dataclass(frozen=True, kw_only=True)
    class MyOptions(Ranged):
        sigma_px: Annotated[float, Range(above=0)] = 0.1
        threads: Annotated[int, Range(least=1, also=(-1,))] = -1

The command's help prints the range after the option's text (`cli/arguments.py`).
"""

from __future__ import annotations

import math
import numbers
import types
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args, get_origin, get_type_hints

from photoclinometry.model.errors import InputError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True, kw_only=True)
class Range:
    """The values that a number may take, in the unit of its option. NaN is never among them."""

    least: float | None = None
    """The smallest value."""
    above: float | None = None
    """In place of `least`: all values are larger than this."""
    most: float | None = None
    """The largest value."""
    below: float | None = None
    """In place of `most`: all values are smaller than this."""
    infinite: bool = False
    """Whether infinity is a value."""
    also: tuple[float, ...] = ()
    """Single values outside of the limits that have a meaning of their own."""
    multiple_of: int = 1
    """Whole numbers only: values are multiples of this."""

    def __contains__(self, value: Any) -> bool:
        if value in self.also:
            return True
        if not _finite(value):
            return value == math.inf and self.infinite
        return (
            (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
            and (self.multiple_of == 1 or value % self.multiple_of == 0)
        )

    def __str__(self) -> str:
        """The range in words, such as "above 0, up to 90"."""
        if self.least is not None and self.most is not None:
            text = f"{_shown(self.least)} to {_shown(self.most)}"
        else:
            parts = (
                self.least is not None and f"{_shown(self.least)} or more",
                self.above is not None and f"above {_shown(self.above)}",
                self.most is not None and f"up to {_shown(self.most)}",
                self.below is not None and f"below {_shown(self.below)}",
            )
            text = ", ".join(part for part in parts if part) or "any finite number"
        if self.multiple_of > 1:
            text += f", a multiple of {self.multiple_of}"
        if self.infinite:
            text += ", or inf"
        return text + "".join(f", or {_shown(value)}" for value in self.also)


Focal = Annotated[float, Range(above=0)]
"""Focal length [px]."""
Principal = Annotated[float, Range()]
"""A coordinate of the principal point [px]."""
Pinhole = tuple[Focal, Focal, Principal, Principal]
"""fx fy cx cy."""


class OptionError(InputError):
    """A value of an option is outside of its range."""

    def __init__(self, kind: type, field: str, problem: str):
        super().__init__(f"{kind.__name__}.{field} {problem}")
        self.kind, self.field, self.problem = kind, field, problem
        """The class of the options, the field's name, and what is wrong with its value."""


class Ranged:
    """Base of options: a dataclass whose numbers are checked against their ranges whenever one is made.

    A subclass with a `__post_init__` of its own calls this one first.
    """

    def __post_init__(self) -> None:
        check_ranges(self)  # pyright: ignore[reportArgumentType]


def check_ranges(options: DataclassInstance) -> None:
    """Raises OptionError where a numeric field is outside of its `Range`. Nested options check themselves."""
    for name, hint in _hints(type(options)).items():
        problem = _problem(getattr(options, name), hint, None)
        if problem:
            raise OptionError(type(options), name, problem)


def numeric_parts(hint: Any, limits: Range | None = None) -> Iterator[tuple[type, Range | None]]:
    """The numbers (int or float) of a type hint, as members of a union or elements of a tuple, with their ranges."""
    hint, limits = _unwrapped(hint, limits)
    if hint in (int, float):
        yield hint, limits
    elif get_origin(hint) in (Union, types.UnionType, tuple):
        for part in get_args(hint):
            yield from numeric_parts(part, limits)


def described(hint: Any) -> str:
    """The ranges of a type hint in words, each once; empty where it has none."""
    return "; ".join(dict.fromkeys(str(limits) for _, limits in numeric_parts(hint) if limits is not None))


@cache
def _hints(kind: type) -> dict[str, Any]:
    """The type hints of the numeric fields of a class of options."""
    hints = get_type_hints(kind, include_extras=True)
    return {f.name: hints[f.name] for f in fields(kind) if any(numeric_parts(hints[f.name]))}


def _unwrapped(hint: Any, limits: Range | None) -> tuple[Any, Range | None]:
    """The hint without its annotations, and the range among them, or else the one given."""
    if get_origin(hint) is Annotated:
        found = [part for part in hint.__metadata__ if isinstance(part, Range)]
        return get_args(hint)[0], found[0] if found else limits
    return hint, limits


def _problem(value: Any, hint: Any, limits: Range | None) -> str | None:
    """What is wrong with a value of a type; None if nothing is."""
    hint, limits = _unwrapped(hint, limits)
    if isinstance(value, (tuple, list)) and get_origin(hint) is tuple:
        parts = get_args(hint)
        parts = parts[:1] * len(value) if parts[-1] is Ellipsis else parts
        problems = (_problem(item, part, limits) for item, part in zip(value, parts, strict=False))
        return next((f"is {value}: {problem.removeprefix('is ')}" for problem in problems if problem), None)
    if get_origin(hint) in (Union, types.UnionType):
        parts = [part for part in get_args(hint) if part is not types.NoneType]
        if value is None or isinstance(value, str):
            return None
        return _problem(value, next((part for part in parts if any(numeric_parts(part))), parts[0]), limits)
    if hint not in (int, float) or limits is None:
        return None
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return f"is {value!r}; give a number, {limits}"
    if hint is int and not isinstance(value, numbers.Integral) and not float(value).is_integer():
        return f"is {value:g}; give a whole number, {limits}"
    if value not in limits:
        return f"is {_shown(value)}; give {'a whole number, ' if hint is int else ''}{limits}"
    return None


def _shown(value: Any) -> str:
    """A number as people write it: whole numbers in full, others to eight digits."""
    return f"{int(value)}" if _finite(value) and value == int(value) else f"{value:.8g}"


def _finite(value: Any) -> bool:
    """Whether a number is neither infinite nor NaN; whole numbers may be too large for floating point."""
    return isinstance(value, numbers.Integral) or math.isfinite(value)
