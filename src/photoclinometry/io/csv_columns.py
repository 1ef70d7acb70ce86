"""CSV: columns with a line of names, numbers as short as they read back exactly (RFC 4180, lines end in LF)."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photoclinometry.io.atomic import atomic_path

Columns = dict[str, np.ndarray | Sequence[str]]


def write_csv(path: Path | str, columns: Columns) -> None:
    """Columns of one length by name, in their order. Raises RunFolderError."""
    values = [column.tolist() if isinstance(column, np.ndarray) else column for column in columns.values()]
    with atomic_path(path) as temporary, open(temporary, "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*values, strict=True))
