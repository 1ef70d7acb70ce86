"""The stored result of a cell: its metrics, and the arrays that its figures need."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from photoclinometry.evaluate.compare import Comparison, evaluate_against_truth
from photoclinometry.io.arrays import read_arrays, write_arrays
from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.json_file import read_json, write_json
from photoclinometry.model.warning import warn
from photoclinometry.photometry.predict import phase_of_views
from photoclinometry.pipeline.products import RunResult
from photoclinometry.simulate.truth import Truth
from photoclinometry.study.plan import Cell

log = logging.getLogger(__name__)

ARRAYS = ("height", "true_height", "spacing", "scale", "phase")
"""Arrays in the record of a map (`Record.arrays`)."""


@dataclass(frozen=True)
class Record:
    """The result of one cell."""

    cell: Cell
    metrics: dict[str, float]
    """As `phomo evaluate --truth` computes them; empty if the run failed."""
    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    """height, true_height (h, w) and their spacing () [m], NaN without a landmark; scale, phase (K,): -, rad."""
    failure: str = ""
    """The reason why there is no map; empty if there is one."""
    rivals: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    """Figures of the run and its rivals on the same pixels, as `RivalComparison.figures`; empty without rivals."""


def measure(cell: Cell, result: RunResult, truth: Truth) -> tuple[Record, Comparison]:
    """The metrics of a run on a simulated site, and the comparison from which they come."""
    found = evaluate_against_truth(result.scene, truth)
    aligned = found.aligned
    position = aligned.landmarks.position
    arrays = {
        "height": aligned.grid(position[:, 2]),
        "true_height": aligned.grid(truth.surface.height_at(position[:, :2])),
        "spacing": np.array(aligned.spacing),
        "scale": aligned.views.scale,
        "phase": phase_of_views(aligned),
    }
    return Record(cell, {**result.metrics, **found.metrics}, arrays), found


def write_record(folder: Path, record: Record, key: str, draw: Callable[[Path], object] | None = None) -> None:
    """The record as a folder that appears whole; draw(folder) adds figures. Raises RunFolderError."""
    results = {"metrics": record.metrics, "rivals": record.rivals}
    content = {"key": key, "failure": record.failure, **results}
    with atomic_path(folder) as work:
        work.mkdir()
        write_arrays(work / "values.npz", record.arrays)
        if draw is not None:
            draw(work)
        write_json(work / "record.json", content)


def read_record(folder: Path, cell: Cell, key: str) -> Record | None:
    """The record of this key; None if there is none, if it is damaged, or if its run failed."""
    if not (folder / "record.json").is_file():
        return None
    try:
        content = read_json(folder / "record.json", "repeat the study")
        if content["key"] != key or content["failure"]:
            return None
        arrays = read_arrays(folder / "values.npz")
        metrics = {name: float("nan") if value is None else float(value) for name, value in content["metrics"].items()}
        missing = [name for name in ARRAYS if name not in arrays]
        if missing:
            raise ValueError(f"values.npz has no {missing[0]}")
        return Record(cell, metrics, arrays, rivals=content["rivals"])
    # A damaged archive raises nearly every built-in exception.
    except Exception as error:
        warn(log, "file-damaged", "%s: damaged (%s); the cell is measured again", folder, error)
        return None
