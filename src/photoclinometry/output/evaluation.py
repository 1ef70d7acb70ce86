"""An evaluation as files: its figures, the alignment, and maps of the differences."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.evaluate.compare import Comparison
from photoclinometry.evaluate.evaluation import Evaluation
from photoclinometry.io.atomic import atomic_path, unwritable, write_text
from photoclinometry.io.json_file import write_json
from photoclinometry.io.similarity import write_similarity

FIGURES = "evaluation.json"
ALIGNMENT = "reference_from_scene.toml"
MAPS = "maps"
_DIFFERENCE = "difference"
"""The maps' file names begin with this."""


def write_evaluation(folder: Path | str, evaluation: Evaluation, *, maps: bool = False) -> None:
    """evaluation.json and evaluation.md; where there was a comparison in a known unit, reference_from_scene.toml too.

    maps: also draw the differences, as PNG files in maps/. The alignment and the maps of an earlier evaluation in the
    folder, perhaps of another map, are removed where this one has none. Raises RunFolderError.
    """
    folder = Path(folder)
    _remove_earlier(folder)
    if evaluation.metres_from_scene is not None:
        write_similarity(folder / ALIGNMENT, evaluation.metres_from_scene)
    if maps and evaluation.comparison is not None:
        draw_differences(folder / MAPS, evaluation.comparison)
    write_json(folder / FIGURES, evaluation.metrics, indent=2)
    write_text(folder / "evaluation.md", evaluation.markdown())


def draw_differences(folder: Path, found: Comparison) -> None:
    """A map of every kind of error, as PNG; the folder appears whole. Raises RunFolderError."""
    from photoclinometry.output.report.maps import draw_values

    with atomic_path(folder) as work:
        work.mkdir()
        draw_values(work, found.aligned, found.errors, _DIFFERENCE)


def _remove_earlier(folder: Path) -> None:
    """Removes the alignment and the maps that an earlier evaluation left. Raises RunFolderError."""
    if not (folder / FIGURES).is_file():
        return
    maps = folder / MAPS
    try:
        (folder / ALIGNMENT).unlink(missing_ok=True)
        for picture in maps.glob(f"{_DIFFERENCE}_*.png"):
            picture.unlink()
        if maps.is_dir() and not maps.is_symlink() and not any(maps.iterdir()):
            maps.rmdir()
    except OSError as error:
        raise unwritable(folder, error) from error
