"""An evaluation as files: its figures, the alignment, and maps of the differences."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.evaluate.compare import Comparison
from photoclinometry.evaluate.evaluation import Evaluation
from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.io.json_file import write_json
from photoclinometry.io.similarity import write_similarity


def write_evaluation(folder: Path | str, evaluation: Evaluation, *, maps: bool = False) -> None:
    """evaluation.json and evaluation.md; where there was a comparison in a known unit, reference_from_scene.toml too.

    maps: also draw the differences, as PNG files in maps/. Raises RunFolderError.
    """
    folder = Path(folder)
    if evaluation.metres_from_scene is not None:
        write_similarity(folder / "reference_from_scene.toml", evaluation.metres_from_scene)
    if maps and evaluation.comparison is not None:
        draw_differences(folder / "maps", evaluation.comparison)
    write_json(folder / "evaluation.json", evaluation.metrics, indent=2)
    write_text(folder / "evaluation.md", evaluation.markdown())


def draw_differences(folder: Path, found: Comparison) -> None:
    """A map of every kind of error, as PNG; the folder appears whole. Raises RunFolderError."""
    from photoclinometry.output.report.maps import draw_values

    with atomic_path(folder) as work:
        work.mkdir()
        draw_values(work, found.aligned, found.errors, "difference")
