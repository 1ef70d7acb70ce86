"""Numbers and names for tables of 80 columns."""

from __future__ import annotations

import math
from collections.abc import Sequence

_BOUNDARIES = "/_-. "
"""Common parts of names end, or begin, with one of these."""


def plain_number(value: float, digits: int = 3) -> str:
    """A number with the given significant digits and without an exponent: 7784, 45.5, 0.00806."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}"


def short_names(names: Sequence[str], longest: int) -> tuple[list[str], str]:
    """The names without what all have in common, and that with "*" for the rest, empty where nothing was left out.

    Names of up to `longest` characters stay. Common parts are left out up to a boundary, such as "_".
    """
    if len(set(names)) < 2 or max(map(len, names)) <= longest:
        return list(names), ""
    before = _common_start(names)
    before = before[: 1 + max(before.rfind(c) for c in _BOUNDARIES)]
    rest = [name[len(before) :] for name in names]
    after = _common_start([name[::-1] for name in rest])[::-1]
    after = after[min((k for k in (after.find(c) for c in _BOUNDARIES) if k >= 0), default=len(after)) :]
    short = [name.removesuffix(after) for name in rest]
    return (short, f"{before}*{after}") if all(short) else (list(names), "")


def _common_start(words: Sequence[str]) -> str:
    first, last = min(words), max(words)
    same = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:same]


def rows_as_text(head: Sequence[str], rows: Sequence[Sequence[str]], width: int = 80) -> list[str]:
    """A line for the head and for each row: the first column to the left, others to the right.

    Two blanks part columns, or one where the lines are wider than `width` otherwise; nothing is cut.
    """
    widths = [max(len(row[k]) for row in (head, *rows)) for k in range(len(head))]
    gap = 2 if sum(widths) + 2 * (len(head) - 1) <= width else 1
    lines = []
    for first, *others in (head, *rows):
        right = [text.rjust(w) for text, w in zip(others, widths[1:], strict=True)]
        lines.append((" " * gap).join([first.ljust(widths[0]), *right]))
    return lines
