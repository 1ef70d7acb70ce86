"""The table of a comparison: one row for each method."""

from __future__ import annotations

import math
from collections.abc import Mapping

from photoclinometry.evaluate.spread import Spread, Table

COLUMNS: tuple[tuple[str, str, int], ...] = (
    ("PSNR [dB]", "psnr_mean_db", 2),
    ("PSNR held out [dB]", "psnr_held_out_mean_db", 2),
    ("SSIM", "ssim_mean", 4),
    ("SSIM held out", "ssim_held_out_mean", 4),
    ("error [%]", "view_error_mean_percent", 2),
    ("error held out [%]", "view_error_held_out_mean_percent", 2),
    ("surface [GSD]", "surface_distance_mean_gsd", 3),
    ("normals [°]", "normal_error_mean_deg", 2),
    ("albedo [%]", "albedo_error_mean_percent", 2),
    ("coverage [%]", "coverage_percent", 1),
    ("CPU [s]", "cpu_s", 1),
    ("memory [GB]", "peak_memory_gb", 2),
)
"""Head, key and decimals of every column."""


def comparison_table(figures: Mapping[str, Mapping[str, float | None]], title: str) -> Table:
    """A row for each method of `figures`; columns that no method has are left out."""
    kept = [column for column in COLUMNS if any(_known(row.get(column[1])) for row in figures.values())]
    rows = tuple((name, tuple(_cell(row.get(key)) for _, key, _ in kept)) for name, row in figures.items())
    return Table(title, tuple(head for head, *_ in kept), rows, tuple(digits for *_, digits in kept))


def _known(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _cell(value: float | None) -> Spread | None:
    return Spread(value, None) if value is not None and math.isfinite(value) else None
