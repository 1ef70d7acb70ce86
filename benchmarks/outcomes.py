"""Outcomes of maps, kept in a file a line each, so that a stopped call goes on."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import photoclinometry as pcm
from photoclinometry.pipeline.products import RunResult


def accuracy_cells(result: RunResult, truth: Path, site_file: Path) -> str:
    """Cells of a table: a map's surface [GSD], normals [deg] and PSNR [dB]."""
    found = pcm.evaluate(result.scene, truth=truth, site=site_file).metrics
    surface, normals = found["surface_distance_mean_gsd"], found["normal_error_mean_deg"]
    return f"{surface:.3f} | {normals:.2f} | {result.metrics['psnr_mean_db']:.1f}"


def warning_codes(result: RunResult) -> tuple[str, ...]:
    """Codes of a run's warnings, and after a colon the view's name."""
    return tuple(sorted(f"{each.code}:{each.view}" if each.view else each.code for each in result.warnings))


def read_outcomes(file: Path) -> list[dict[str, Any]]:
    """The fields of each outcome; none where there is no file yet. `warnings` are a tuple again."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    return [{**row, "warnings": tuple(row["warnings"])} for row in map(json.loads, lines)]


def keep_outcome(file: Path, outcome: Any) -> None:
    """Adds an outcome, a dataclass with `warnings`."""
    with file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(asdict(outcome)) + "\n")
