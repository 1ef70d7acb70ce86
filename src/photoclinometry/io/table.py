"""A table of a TOML file, read key by key: errors name the file, the table, the key and the value found."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

import numpy as np

from photoclinometry.model.errors import SiteError

_REQUIRED: Any = object()
_INT32_END = 2**31
"""Whole numbers from here on do not fit the 32-bit integers that other programs keep sizes in."""
_INT64_END = 2**63
"""Whole numbers of TOML end here (64 bits); larger ones are mistakes."""
_SHOWN = 60
"""Characters of a wrong value that an error shows."""


class Table:
    """One TOML table, read by key.

    Every method that reads a key raises SiteError if the key is missing (and has no default) or of another type.
    """

    def __init__(self, content: dict[str, Any], file: str, where: str = ""):
        self.content = content
        self.file = file
        self.where = where
        """The table's place in the file, for messages, such as "views[2]"; empty for the top table."""
        self._known: tuple[str, ...] = ()
        """All keys that the table may have, as `expect` was given them."""

    def expect(self, *keys: str) -> Table:
        """The table itself, which may have these keys and no others. To be called before any key is read, so that hints
        distinguish a misspelt key from one that is only read later."""
        self._known = keys
        return self

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def error(self, key: str, what: str, nearest: tuple[str, Iterable[str]] | None = None) -> SiteError:
        """The error `what` about `key`; nearest: (word found, words known) adds "did you mean"."""
        hint = ""
        if nearest is not None:
            word, known = nearest
            close = difflib.get_close_matches(word, list(known), n=1)
            hint = f"; did you mean {close[0]!r}?" if close else f"; known: {', '.join(known)}"
        place = f"{self.where}: {key}" if self.where else key
        return SiteError(f"{self.file}: {place}: {what}{hint}")

    def finish(self) -> None:
        """Raises SiteError for the first key that was not expected, with the nearest one that is."""
        for key in self.content:
            if key not in self._known:
                raise self.error(key, "unknown key", nearest=(key, self._known))

    def text(self, key: str, default: Any = _REQUIRED, expected: str = "text in quotes") -> Any:
        """A text that is not blank. expected: what to give where it is missing, for messages."""
        value = self._get(key, default, expected)
        if value is default:
            return default
        if not isinstance(value, str):
            raise self._wrong_type(key, "text in quotes")
        if not value.strip() or "\0" in value:
            raise self.error(key, f"is empty or not printable: {value!r}")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """One text that is not blank, or a list of such."""
        value = self._get(key, _REQUIRED, "text in quotes, or a list of such")
        values = value if isinstance(value, list) else [value]
        if not values or not all(isinstance(each, str) and each.strip() and "\0" not in each for each in values):
            raise self._wrong_type(key, "text in quotes, or a list of such")
        return tuple(values)

    def choice(self, key: str, known: tuple[str, ...], remedy: str = "") -> str:
        """One of the texts `known`."""
        value = self.text(key, expected=" or ".join(map(repr, known)))
        if value not in known:
            listed = ", ".join(map(repr, known))
            raise self.error(key, f"{value!r} is not supported (known: {listed})" + (remedy and f"; {remedy}"))
        return value

    def boolean(self, key: str, default: bool) -> bool:
        """true or false."""
        value = self._get(key, default, "true or false")
        if not isinstance(value, bool):
            raise self._wrong_type(key, "true or false")
        return value

    def positive_number(self, key: str, default: Any = _REQUIRED) -> Any:
        """A finite number above 0."""
        value = self._get(key, default, "a positive number")
        if value is default:
            return default
        if not _is_number(value) or not 0 < value < float("inf"):
            raise self._wrong_type(key, "a positive number")
        return float(value)

    def number_from_zero(self, key: str, default: Any = _REQUIRED) -> Any:
        """A finite number that is not negative."""
        value = self._get(key, default, "a number of 0 or more")
        if value is default:
            return default
        if not _is_number(value) or not 0 <= value < float("inf"):
            raise self._wrong_type(key, "a number of 0 or more")
        return float(value)

    def positive_integer(self, key: str) -> int:
        """A whole number from 1 to 2^31 - 1."""
        value = self._get(key, _REQUIRED, "a positive whole number")
        if not _is_number(value) or not 0 < value < _INT32_END or value != int(value):
            raise self._wrong_type(key, "a positive whole number")
        return int(value)

    def numbers(self, key: str, count: int, remedy: str = "") -> np.ndarray:
        """(count,) float64, all finite."""
        expected = f"a list of {count} finite numbers"
        value = self._get(key, _REQUIRED, remedy or expected)
        wrong = not isinstance(value, list) or len(value) != count or not all(map(_is_number, value))
        if wrong or not np.isfinite(np.array(value, float)).all():
            raise self._wrong_type(key, expected, remedy)
        return np.array(value, float)

    def matrix(self, key: str, size: int) -> np.ndarray:
        """(size, size) float64, all finite."""
        expected = f"{size} rows of {size} finite numbers"
        rows = self._get(key, _REQUIRED, expected)
        wrong = not isinstance(rows, list) or len(rows) != size
        if wrong or not all(isinstance(r, list) and len(r) == size and all(map(_is_number, r)) for r in rows):
            raise self._wrong_type(key, expected)
        found = np.array(rows, float)
        if not np.isfinite(found).all():
            raise self._wrong_type(key, expected)
        return found

    def positive_integers(self, key: str, count: int) -> np.ndarray:
        """(count,) int64."""
        values = self.numbers(key, count)
        if (values < 1).any() or (values >= _INT32_END).any() or (values != np.round(values)).any():
            raise self._wrong_type(key, f"a list of {count} positive whole numbers")
        return values.astype(np.int64)

    def integers_from_zero(self, key: str, count: int) -> np.ndarray:
        """(count,) int64."""
        values = self.numbers(key, count)
        if (values < 0).any() or (values >= _INT32_END).any() or (values != np.round(values)).any():
            raise self._wrong_type(key, f"a list of {count} whole numbers of 0 or more")
        return values.astype(np.int64)

    def table(self, key: str, default: Any = _REQUIRED) -> Any:
        """The table [key] below this one."""
        value = self._get(key, default, "a table")
        if value is default:
            return default
        if not isinstance(value, dict):
            raise self._wrong_type(key, "a table")
        return Table(value, self.file, f"{self.where}: {key}" if self.where else key)

    def tables(self, key: str) -> list[Table]:
        """The tables [[key]]; empty where there is none."""
        value = self._get(key, [], f"[[{key}]]")
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise self._wrong_type(key, f"a list of tables; write [[{key}]] for each")
        return [Table(v, self.file, f"{key}[{n}]") for n, v in enumerate(value)]

    def _get(self, key: str, default: Any, expected: str) -> Any:
        if key in self.content:
            return self.content[key]
        if default is _REQUIRED:
            close = difflib.get_close_matches(key, [k for k in self.content if k not in self._known], n=1)
            found = f" (found the unknown key {close[0]!r}; did you mean {key!r}?)" if close else ""
            raise self.error(key, f"is missing{found}; give {expected.removeprefix('give ')}")
        return default

    def _wrong_type(self, key: str, expected: str, remedy: str = "") -> SiteError:
        found = repr(self.content[key])
        found = found if len(found) <= _SHOWN else found[: _SHOWN - 3] + "..."
        return self.error(key, f"expected {expected}, found {found}" + (remedy and f"; {remedy}"))


def _is_number(value: Any) -> bool:
    """Whether `value` is a TOML number that a double can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return isinstance(value, float) or abs(value) < _INT64_END
