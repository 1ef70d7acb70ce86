"""Tables of metrics: from flat dictionaries whose keys end in the unit to rows for people."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

STATISTICS = ("mean", "median", "rms", "p90")
_LARGEST_WHOLE = 1e15
"""Whole numbers above have more digits than a double keeps; they are shown in scientific notation."""
_SPREAD = re.compile(rf"(?P<name>.+)_(?P<statistic>{'|'.join(STATISTICS)})_(?P<unit>.+)")
_UNITS = {
    "percent_of_brightness": "% of brightness",
    "percent": "%",
    "deg": "°",
    "gsd": "GSD",
    "db": "dB",
    "px": "px",
    "gb": "GB",
    "km": "km",
    "m": "m",
    "s": "s",
}


def metric_rows(metrics: Mapping[str, float]) -> tuple[list[tuple[str, ...]], list[tuple[str, str]]]:
    """Rows (quantity, unit, mean, median, RMS, 90 %) and rows (quantity, value with unit), in the given order."""
    spreads: dict[tuple[str, str], dict[str, float]] = {}
    singles = []
    complete = {(m["name"], m["unit"]) for key in metrics if (m := _SPREAD.fullmatch(key)) and m["statistic"] == "rms"}
    for key, value in metrics.items():
        match = _SPREAD.fullmatch(key)
        if match and (match["name"], match["unit"]) in complete:
            spreads.setdefault((match["name"], match["unit"]), {})[match["statistic"]] = value
        else:
            name, unit = split_unit(key)
            singles.append((words(name), f"{number(value)} {unit}".strip()))
    rows = [
        (words(name), _UNITS.get(unit, unit), *(number(values.get(s)) for s in STATISTICS))
        for (name, unit), values in spreads.items()
    ]
    return rows, singles


def split_unit(key: str) -> tuple[str, str]:
    """ "psnr_mean_db" -> ("psnr_mean", "dB"); a key without a known unit is returned unchanged."""
    for unit, shown in _UNITS.items():
        if key.endswith(f"_{unit}"):
            return key.removesuffix(f"_{unit}"), shown
    return key, ""


def words(name: str) -> str:
    """ "photometric_error" -> "photometric error"."""
    text = name.replace("_", " ").replace("psnr", "PSNR").replace("gsd", "GSD").replace("nees", "NEES")
    return text


def number(value: float | int | str | None) -> str:
    """Four significant digits; whole numbers in full; a dash for None and NaN."""
    if value is None or value != value:
        return "–"
    if isinstance(value, str):
        return value
    if float(value).is_integer() and abs(value) < _LARGEST_WHOLE:
        return f"{int(value):,}".replace(",", "\u202f")
    return f"{value:.4g}"


def digits(value: float, count: int = 3) -> str:
    """So many significant digits, and all before the point; never in scientific notation."""
    if not math.isfinite(value) or value == 0.0:
        return number(value)
    return grouped(value, count - 1 - math.floor(math.log10(abs(value))))


def grouped(value: float, decimals: int) -> str:
    """So many decimals, at least none, and thin spaces between thousands."""
    return f"{value:,.{max(0, decimals)}f}".replace(",", "\u202f")


def markdown(metrics: Mapping[str, float], title: str) -> str:
    """The metrics as a Markdown page of two tables."""
    spreads, singles = metric_rows(metrics)
    lines = [f"# {title}", ""]
    if spreads:
        lines += markdown_table(("quantity", "unit", "mean", "median", "RMS", "90 %"), spreads)
    if singles:
        lines += markdown_table(("quantity", "value"), singles)
    return "\n".join(lines)


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table and an empty line. The first column is aligned left, the others right."""
    shown = [head, ("---", *["---:"] * (len(head) - 1)), *rows]
    return [f"| {' | '.join(row)} |" for row in shown] + [""]
