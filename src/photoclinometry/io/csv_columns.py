"""CSV files with a header (RFC 4180, lines end in LF); numbers have the fewest digits that read back exactly."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import atomic_path

Columns = dict[str, np.ndarray | Sequence[str]]


def write_csv(path: Path | str, columns: Columns) -> None:
    """Writes columns of equal length, by name and in order. Raises RunFolderError."""
    values = [column.tolist() if isinstance(column, np.ndarray) else column for column in columns.values()]
    with atomic_path(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*values, strict=True))
