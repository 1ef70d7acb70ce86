"""Options given field by field: names and words that do not exist are refused, all others are taken."""

from dataclasses import dataclass, field
from typing import Literal

import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.model.option_fields import changed, choices


@dataclass(frozen=True)
class Inner:
    colour: Literal["red", "green"] | None = None


@dataclass(frozen=True)
class Outer:
    kind: Literal["a", "b"] = "a"
    kinds: tuple[Literal["a", "b"] | Literal["c"], ...] = ()
    text: str | None = None
    number: float | Literal["auto"] = "auto"
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize(
    ("hint", "expected"),
    [
        (Literal["a", "b"], ("a", "b")),
        (Literal["a", "b"] | None, ("a", "b")),
        (tuple[Literal["a"] | Literal["c"], ...], ("a", "c")),
        (Literal["auto"] | str, ()),
        (str, ()),
        (tuple[float, float], ()),
    ],
)
def test_choices_are_the_words_of_a_type(hint, expected):
    assert choices(hint) == expected


def test_fields_are_replaced():
    new = changed(Outer(), {"kind": "b", "kinds": ("a", "c"), "text": "any", "inner": Inner("green")})
    assert new == Outer("b", ("a", "c"), "any", "auto", Inner("green"))
    assert changed(new, {}) == new


@pytest.mark.parametrize(
    ("options", "changes", "message"),
    [
        (Outer(), {"knid": "b"}, "Outer has no option 'knid'; the nearest is 'kind'"),
        (Outer(), {"kind": "c"}, "kind='c': must be one of 'a', 'b'"),
        (Outer(), {"kinds": ("a", "d")}, "kinds='d': must be one of 'a', 'b', 'c'"),
        (Outer(), {"inner": Inner("blue")}, "colour='blue': must be one of 'red', 'green'"),  # type: ignore[arg-type]
        (Outer(kind="z"), {}, "kind='z'"),  # type: ignore[arg-type]
    ],
)
def test_fields_and_words_that_do_not_exist_are_refused(options, changes, message):
    with pytest.raises(InputError, match=message):
        changed(options, changes)
