"""The first few of many in words, and how many more there are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice


def first_names(names: Sequence[str], count: int) -> str:
    """Up to `count` names: "a, b and 7 more"."""
    more = len(names) - count
    return ", ".join(names[:count]) + (f" and {more} more" if more > 0 else "")


def first_reasons(reasons: Mapping[str, str], count: int) -> str:
    """Up to `count` names with their reasons: "a: it is dark; b: it is empty; and 7 more"."""
    more = len(reasons) - count
    return "; ".join(f"{name}: {reason}" for name, reason in islice(reasons.items(), count)) + (
        f"; and {more} more" if more > 0 else ""
    )
