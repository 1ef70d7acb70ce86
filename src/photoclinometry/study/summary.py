"""The tables of a study: the paper's Tables 3 and 4, PSNR of held-out views, heights with and without photometry."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from photoclinometry.evaluate.spread import Spread, Table
from photoclinometry.rivals.compare import OURS
from photoclinometry.rivals.table import COLUMNS
from photoclinometry.study.plan import GEOMETRY, StudyOptions
from photoclinometry.study.record import Record

TABLE_4: tuple[tuple[str, str, int], ...] = (
    ("photometric error [%]", "photometric_error_mean_percent", 2),
    ("albedo error [%]", "albedo_error_mean_percent", 2),
    ("normal error [°]", "normal_error_mean_deg", 2),
    ("landmark error (Eq. 36) [m]", "landmark_error_mean_m", 2),
    ("distance to surface [m]", "surface_distance_mean_m", 2),
    ("distance to surface [GSD]", "surface_distance_mean_gsd", 3),
    ("completeness [%]", "completeness_percent", 1),
)


HELD_OUT = "psnr_held_out_mean_db"
"""The figure of the paper's Table 5."""

Row = tuple[str, tuple[Spread | None, ...]]
"""A label, and the figures of each column."""


def tables(options: StudyOptions, records: Sequence[Record]) -> list[Table]:
    """All tables of a study, in the order of the paper."""
    found = [_by_model(options, records, "Table 3: PSNR of renderings on the views used, mean [dB]", "psnr_mean_db")]
    if options.hold_out_every:
        title = "PSNR of renderings on views held out, mean [dB]"
        found.append(_by_model(options, records, title, "psnr_held_out_mean_db"))
    found.append(_table_4(options, records))
    if options.geometry_alone:
        found.append(_heights(options, records))
    if options.rivals:
        found += _rivals(options, records)
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
    return Table(title, options.models, _with_average(rows), (2,) * len(options.models))


def _with_average(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Several rows, and the average of each column."""
    if len(rows) < 2:
        return tuple(rows)
    columns = zip(*(values for _, values in rows), strict=True)
    known = [[v.mean for v in column if v is not None] for column in columns]
    return (*rows, ("average", tuple(Spread(float(np.mean(c)), None) if c else None for c in known)))


def _rivals(options: StudyOptions, records: Sequence[Record]) -> list[Table]:
    """The paper's Table 5, and all figures of the runs and their rivals."""
    methods = (OURS, *options.rivals)
    runs = {group: select(records, group, options.shown) for group in groups(records)}

    def figure(group: tuple[str, str, str], method: str, key: str) -> Spread | None:
        return _over_seeds(runs[group], lambda run: _rival_figure(run, method, key))

    found = []
    if options.hold_out_every:
        held = [(label(options, group), tuple(figure(group, m, HELD_OUT) for m in methods)) for group in runs]
        title = "Table 5: PSNR of views held out, the run and its rivals, mean [dB]"
        found.append(Table(title, methods, _with_average(held), (2,) * len(methods)))
    heads, keys, digits = zip(*COLUMNS, strict=True)
    rows = tuple(
        (f"{label(options, group)}: {method}", tuple(figure(group, method, key) for key in keys))
        for group in runs
        for method in methods
    )
    return [*found, Table("The run and its rivals on the same pixels", heads, rows, digits)]


def _rival_figure(record: Record, method: str, key: str) -> float:
    value = record.rivals.get(method, {}).get(key)
    return float("nan") if value is None else value


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
