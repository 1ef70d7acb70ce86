"""Tables of figures with their spread, as Markdown, as JSON, and in the width of a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from photoclinometry.evaluate.tables import markdown_table

LABEL_WIDTH = 26
"""Characters of a row's label on a terminal; longer ones are folded."""


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation of a figure over the seeds."""

    mean: float
    std: float | None
    """None for a single seed."""

    def text(self, digits: int = 2) -> str:
        around = "" if self.std is None else f" ± {self.std:.{digits}f}"
        return f"{self.mean:.{digits}f}{around}"


@dataclass(frozen=True)
class Table:
    """A table of figures; None where there is no figure."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Spread | None, ...]], ...]
    digits: tuple[int, ...]
    """Decimals of each column."""

    def cells(self) -> list[tuple[str, ...]]:
        """The values of each row as text."""
        return [
            tuple("–" if v is None else v.text(d) for v, d in zip(values, self.digits, strict=True))
            for _, values in self.rows
        ]

    def markdown(self) -> str:
        lines = [(label, *cells) for (label, _), cells in zip(self.rows, self.cells(), strict=True)]
        return "\n".join([f"## {self.title}", "", *markdown_table(("", *self.columns), lines)])

    def terminal(self, width: int = 80) -> str:
        """The table in lines of at most `width` characters. Columns that do not fit follow below, in a part of their
        own; labels and heads are folded, values are whole."""
        labels = [textwrap.wrap(label, LABEL_WIDTH, break_on_hyphens=False) for label, _ in self.rows]
        side = max((len(line) for label in labels for line in label), default=0)
        cells = self.cells()
        columns = [_Column.of(head, tuple(row[k] for row in cells)) for k, head in enumerate(self.columns)]
        lines = textwrap.wrap(self.title, width)
        for part in _parts(columns, width - side):
            depth = max(len(column.head) for column in part)
            heads = [[""] * (depth - len(column.head)) + column.head for column in part]
            lines += ["", *(_line("", side, part, head) for head in zip(*heads, strict=True))]
            for k, (first, *others) in enumerate(labels):
                lines += [_line(first, side, part, [column.values[k] for column in part]), *others]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        rows = [
            {"row": label, "values": [None if v is None else {"mean": v.mean, "std": v.std} for v in values]}
            for label, values in self.rows
        ]
        return {"title": self.title, "columns": list(self.columns), "digits": list(self.digits), "rows": rows}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Table:
        """A table as `as_dict` gave it."""
        rows = tuple(
            (row["row"], tuple(None if v is None else Spread(v["mean"], v["std"]) for v in row["values"]))
            for row in content["rows"]
        )
        return cls(content["title"], tuple(content["columns"]), rows, tuple(content["digits"]))


class _Column(NamedTuple):
    """A column as it is shown on a terminal."""

    head: list[str]
    """Lines."""
    values: tuple[str, ...]
    width: int

    @classmethod
    def of(cls, head: str, values: tuple[str, ...]) -> _Column:
        """As wide as its longest value, or word of its head."""
        width = max(map(len, (*values, *head.split())))
        return cls(textwrap.wrap(head, width), values, width)


def _parts(columns: Sequence[_Column], width: int) -> list[list[_Column]]:
    """The columns in parts that fit a width, each with two blanks before it."""
    parts: list[list[_Column]] = []
    for column in columns:
        if not parts or sum(2 + c.width for c in (*parts[-1], column)) > width:
            parts.append([])
        parts[-1].append(column)
    return parts


def _line(label: str, side: int, part: Sequence[_Column], values: Sequence[str]) -> str:
    """A label and values aligned to the right, each in the width of its column."""
    shown = (f"  {value:>{column.width}}" for column, value in zip(part, values, strict=True))
    return f"{label:{side}}{''.join(shown)}".rstrip()
