"""The tables of a study: the paper's Tables 3 and 4, PSNR of held-out views, heights with and without photometry."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from photoclinometry.evaluate.tables import markdown_table
from photoclinometry.study.plan import GEOMETRY, StudyOptions
from photoclinometry.study.record import Record

LABEL_WIDTH = 26
"""Characters of a row's label on a terminal; longer ones are folded."""

TABLE_4: tuple[tuple[str, str, int], ...] = (
    ("photometric error [%]", "photometric_error_mean_percent", 2),
    ("albedo error [%]", "albedo_error_mean_percent", 2),
    ("normal error [°]", "normal_error_mean_deg", 2),
    ("landmark error (Eq. 36) [m]", "landmark_error_mean_m", 2),
    ("distance to surface [m]", "surface_distance_mean_m", 2),
    ("distance to surface [GSD]", "surface_distance_mean_gsd", 3),
    ("completeness [%]", "completeness_percent", 1),
)


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


def tables(options: StudyOptions, records: Sequence[Record]) -> list[Table]:
    """All tables of a study, in the order of the paper."""
    found = [_by_model(options, records, "Table 3: PSNR of renderings on the views used, mean [dB]", "psnr_mean_db")]
    if options.hold_out_every:
        title = "PSNR of renderings on views held out, mean [dB]"
        found.append(_by_model(options, records, title, "psnr_held_out_mean_db"))
    found.append(_table_4(options, records))
    if options.geometry_alone:
        found.append(_heights(options, records))
    return found


def groups(records: Sequence[Record]) -> list[tuple[str, str, str]]:
    """The groups of cells that differ in model and seed alone, in order."""
    return list(dict.fromkeys(sorted(record.cell.group for record in records)))


def label(options: StudyOptions, group: tuple[str, str, str]) -> str:
    """A group in words; lighting and surface are named if the study has several."""
    preset, lighting, surface = group
    extra = [lighting] if len(options.lightings) > 1 else []
    return ", ".join([preset, *extra, *([surface] if len(options.surfaces) > 1 else [])])


def height_error(record: Record) -> np.ndarray:
    """(h, w) height of the map above the true ground at the same place [m]."""
    return record.arrays["height"] - record.arrays["true_height"]


def select(records: Sequence[Record], group: tuple[str, str, str], model: str) -> list[Record]:
    """The finished cells of a group and model, by seed."""
    chosen = [r for r in records if r.cell.group == group and r.cell.model == model and not r.failure]
    return sorted(chosen, key=lambda r: r.cell.simulation.seed)


def _over_seeds(records: Sequence[Record], value: Callable[[Record], float]) -> Spread | None:
    found = np.array([value(record) for record in records], float)
    found = found[np.isfinite(found)]
    if not found.size:
        return None
    return Spread(float(found.mean()), float(found.std(ddof=1)) if found.size > 1 else None)


def _figure(records: Sequence[Record], key: str) -> Spread | None:
    return _over_seeds(records, lambda record: record.metrics.get(key, float("nan")))


def _by_model(options: StudyOptions, records: Sequence[Record], title: str, key: str) -> Table:
    """One row per group, one column per model, and the average of the rows."""
    rows = [
        (label(options, group), tuple(_figure(select(records, group, model), key) for model in options.models))
        for group in groups(records)
    ]
    if len(rows) > 1:
        columns = zip(*(values for _, values in rows), strict=True)
        known = [[v.mean for v in column if v is not None] for column in columns]
        rows.append(("average", tuple(Spread(float(np.mean(c)), None) if c else None for c in known)))
    return Table(title, options.models, tuple(rows), (2,) * len(options.models))


def _table_4(options: StudyOptions, records: Sequence[Record]) -> Table:
    models = options.models + ((GEOMETRY,) if options.geometry_alone else ())
    rows = tuple(
        (
            f"{label(options, group)}: {'geometry alone' if model == GEOMETRY else model}",
            tuple(_figure(select(records, group, model), key) for _, key, _ in TABLE_4),
        )
        for group in groups(records)
        for model in models
    )
    title = "Table 4: errors against truth, mean over landmarks"
    return Table(title, tuple(head for head, _, _ in TABLE_4), rows, tuple(digits for *_, digits in TABLE_4))


def _heights(options: StudyOptions, records: Sequence[Record]) -> Table:
    """Fig. 11 in numbers: mean absolute height error, and its reduction by photometry."""

    def mean_error(record: Record) -> float:
        return float(np.nanmean(np.abs(height_error(record))))

    rows = []
    for group in groups(records):
        without = _over_seeds(select(records, group, GEOMETRY), mean_error)
        with_it = _over_seeds(select(records, group, options.shown), mean_error)
        gain = Spread(100.0 * (1.0 - with_it.mean / without.mean), None) if without and with_it else None
        rows.append((label(options, group), (without, with_it, gain)))
    columns = ("geometry alone [m]", f"{options.shown} [m]", "reduction [%]")
    return Table("Fig. 11: height error against truth, mean", columns, tuple(rows), (2, 2, 1))
