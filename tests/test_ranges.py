"""Every numeric option states its range. Values outside of it, NaN and infinity are refused when options are made."""

import importlib
import math
import re
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import get_origin, get_type_hints

import pytest

import photoclinometry
from photoclinometry.adjust import AdjustOptions
from photoclinometry.model.errors import InputError
from photoclinometry.model.ranges import Range, Ranged, described, numeric_parts
from photoclinometry.sfm import SfmOptions
from photoclinometry.simulate.camera_model import Detector

ROOT = Path(photoclinometry.__file__).parent


def options_classes() -> list[type]:
    """Every class of the package that is named `...Options`, and the dataclasses that are their fields."""
    found = []
    for file in sorted(ROOT.rglob("*.py")):
        for name in re.findall(r"^class (\w*Options)\b", file.read_text(encoding="utf-8"), flags=re.MULTILINE):
            module = ".".join(file.relative_to(ROOT.parent).with_suffix("").parts)
            found.append(getattr(importlib.import_module(module), name))
    parts = [hint for kind in found for hint in get_type_hints(kind).values() if is_dataclass(hint)]
    return sorted({*found, *parts}, key=lambda kind: (kind.__name__, kind.__module__))


CLASSES = options_classes()
NUMBERS = [
    (kind, field.name, part, number, limits)
    for kind in CLASSES
    for field in fields(kind)
    for part, (number, limits) in enumerate(numeric_parts(get_type_hints(kind, include_extras=True)[field.name]))
]
RANGED = [case for case in NUMBERS if case[-1] is not None]
NAMES = [f"{kind.__name__}.{name}-{part}" for kind, name, part, _, _ in RANGED]


def test_all_options_are_looked_at():
    assert {"RunOptions", "SolverOptions", "Detector", "StudyOptions"} <= {kind.__name__ for kind in CLASSES}
    assert len(NUMBERS) > 90


@pytest.mark.parametrize("kind", CLASSES)
def test_every_number_has_a_range_and_is_checked_against_it(kind):
    assert issubclass(kind, Ranged)
    assert [name for owner, name, _, _, limits in NUMBERS if owner is kind and limits is None] == []


def just_outside(limits: Range, number: type) -> list[float]:
    """The nearest numbers below and above a range."""
    step = (lambda x, to: x + math.copysign(1, to)) if number is int else math.nextafter
    found = [step(limits.least, -math.inf)] if limits.least is not None else []
    found += [limits.above] if limits.above is not None else []
    found += [step(limits.most, math.inf)] if limits.most is not None else []
    found += [limits.below] if limits.below is not None else []
    return [value for value in found if value not in limits.also]


def put(kind: type, name: str, part: int, value: float) -> None:
    """Makes the options of a class with one number replaced; in tuples the others stay within their ranges."""
    hint = get_type_hints(kind)[name]
    choices = [hint, *getattr(hint, "__args__", ())]
    whole = next((choice for choice in choices if get_origin(choice) is tuple), None)
    if whole is not None:
        size = 1 if whole.__args__[-1] is Ellipsis else len(whole.__args__)
        value = tuple(value if k == part else 50.0 for k in range(size))  # type: ignore[assignment]
    Ranged.__post_init__(_bare(kind, name, value))


def _bare(kind: type, name: str, value: object) -> object:
    """Options that were not checked: with this value, and the defaults otherwise."""
    options = object.__new__(kind)
    options.__dict__.update(kind().__dict__ | {name: value})
    return options


@pytest.mark.parametrize(("kind", "name", "part", "number", "limits"), RANGED, ids=NAMES)
def test_limits_are_taken_and_what_is_just_outside_is_refused(kind, name, part, number, limits):
    for value in (limits.least, limits.most, *limits.also):
        if value is not None and value % limits.multiple_of == 0:
            put(kind, name, part, value)
    for value in (*just_outside(limits, number), math.nan, -math.inf, *([] if limits.infinite else [math.inf])):
        with pytest.raises(InputError, match=rf"{kind.__name__}\.{name} is .*; give .*{re.escape(str(limits))}"):
            put(kind, name, part, value)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (Range(above=0), "above 0"),
        (Range(least=0, most=90), "0 to 90"),
        (Range(above=0, most=1), "above 0, up to 1"),
        (Range(least=1, also=(-1,)), "1 or more, or -1"),
        (Range(above=0, infinite=True), "above 0, or inf"),
        (Range(least=56, most=560, multiple_of=14), "56 to 560, a multiple of 14"),
        (Range(), "any finite number"),
    ],
)
def test_a_range_says_itself_in_words(limits, words):
    assert str(limits) == words


def test_whole_numbers_are_whole_and_may_be_of_any_length():
    assert replace(AdjustOptions(), max_reweightings=100).max_reweightings == 100
    for value in (2.5, 10**400, "many", True):
        with pytest.raises(InputError, match=r"AdjustOptions\.max_reweightings is"):
            AdjustOptions(max_reweightings=value)  # type: ignore[arg-type]


def test_tuples_are_checked_one_by_one_and_named_as_a_whole():
    with pytest.raises(InputError, match=re.escape("Detector.offset_dn is (100.0, -1.0): -1; give 0 to 32768")):
        Detector(offset_dn=(100.0, -1.0))
    assert described(get_type_hints(SfmOptions, include_extras=True)["threads"]) == "1 to 1024, or -1"
