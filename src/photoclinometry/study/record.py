"""What a study keeps of each cell: its figures, and the few arrays that its pictures need."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.evaluate.compare import Comparison, evaluate_against_truth
from photoclinometry.evaluate.tables import json_numbers
from photoclinometry.io.atomic import atomic_path
from photoclinometry.photometry.predict import phase_of_views
from photoclinometry.pipeline.products import RunResult
from photoclinometry.simulate.truth import Truth
from photoclinometry.study.plan import Cell

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Record:
    """One cell's outcome."""

    cell: Cell
    metrics: dict[str, float]
    """As `phomo evaluate --truth` gives them; empty where the run failed."""
    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    """height, true_height (h, w) and their spacing () [m], NaN without a landmark; scale, phase (K,): -, rad."""
    failure: str = ""
    """Why there is no map, in words."""


def measure(cell: Cell, result: RunResult, truth: Truth) -> tuple[Record, Comparison]:
    """The figures of a run on a simulated site."""
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


def write_record(folder: Path, record: Record, key: str, draw: Callable[[Path], None] | None = None) -> None:
    """The record as a folder that appears whole; draw(folder) may add pictures. Raises RunFolderError."""
    content = {"key": key, "failure": record.failure, "metrics": json_numbers(record.metrics)}
    with atomic_path(folder) as work:
        work.mkdir()
        with open(work / "values.npz", "wb") as stream:
            np.savez_compressed(stream, **record.arrays)  # pyright: ignore[reportArgumentType]
        if draw is not None:
            draw(work)
        (work / "record.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_record(folder: Path, cell: Cell, key: str) -> Record | None:
    """What `write_record` wrote under this key; None where there is none, or it is damaged, or of a failed run."""
    if not (folder / "record.json").is_file():
        return None
    try:
        content: dict[str, Any] = json.loads((folder / "record.json").read_text(encoding="utf-8"))
        if content["key"] != key or content["failure"]:
            return None
        with np.load(folder / "values.npz") as stored:
            arrays = {name: stored[name] for name in stored}
        metrics = {name: float("nan") if value is None else value for name, value in content["metrics"].items()}
        return Record(cell, metrics, arrays)
    # zipfile meets damage with nearly every built-in exception.
    except Exception as error:
        log.warning("%s: damaged (%s); the cell is measured again", folder, error)
        return None
