"""`phomo evaluate`: how good a run is, against its images, a simulation's truth, or another map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from photoclinometry.evaluate.evaluation import Evaluation


def evaluate(
    run: Path,
    /,
    truth: Path | None = None,
    reference: Path | None = None,
    cameras: Path | None = None,
    unit: str = "m",
    site: Path | None = None,
    images: bool = True,
    maps: bool = False,
    out: Path | None = None,
) -> dict[str, float]:
    """Measure a run: photometric error, PSNR and completeness, and how far it is from truth or another map.

    Writes evaluation.json and evaluation.md, and prints the same as tables. Each figure's name ends in its
    unit; GSD is the ground sample distance, one reference pixel on the ground. The alignment with a truth or map in
    metres or kilometres is kept in reference_from_scene.toml: `phomo export --transform` takes it. What an earlier
    evaluation left in the folder is replaced.

    Args:
        run: Folder of a finished run.
        truth: truth.h5 of the simulated site: compares surface, normals, albedos, poses, Suns and keypoints. That of
            another site is refused.
        reference: Another map of the place, to compare surface, normals and albedos with: a PLY file (mesh or
            points), a GeoTIFF of heights (needs the extra `geo`), another run's folder, or its scene.h5. Of a whole
            body: a mesh (PLY, OBJ).
        cameras: COLMAP model folder with poses in the frame of the reference map. Its views, matched by name,
            give the first alignment; another run brings its own. Without any the run must be in the map's frame.
        unit: Length unit of the reference map, for the names of the figures.
        site: The site.toml, if it has moved since the run.
        images: Read the images too, for PSNR and completeness.
        maps: Also draw what differs from the truth or the other map, one picture for each kind of error.
        out: Folder for the files. Default: evaluation/ in the run folder.
    """
    import photoclinometry as pcm
    from photoclinometry.io.run_files import EVALUATION_FOLDER
    from photoclinometry.output.evaluation import write_evaluation

    found = pcm.evaluate(run, truth=truth, reference=reference, cameras=cameras, unit=unit, site=site, images=images)
    folder = out or run / EVALUATION_FOLDER
    write_evaluation(folder, found, maps=maps)
    show(found, folder)
    return found.metrics


def show(evaluation: Evaluation, folder: Path) -> None:
    """The figures as two tables on the terminal, and where they were written."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from photoclinometry.evaluate.tables import metric_rows

    console = Console()
    spreads, singles = metric_rows(evaluation.metrics)
    table = Table(title=Text(evaluation.name, "table.title"), title_justify="left")
    for head in ("quantity", "unit", "mean", "median", "RMS", "90 %"):
        table.add_column(head, justify="left" if head in ("quantity", "unit") else "right")
    for row in spreads:
        table.add_row(*row)
    console.print(table)
    table = Table(show_header=False)
    table.add_column()
    table.add_column(justify="right")
    for row in singles:
        table.add_row(*row)
    console.print(table)
    Console(stderr=True).print(f"written: {folder}/evaluation.json, .md", soft_wrap=True, highlight=False, markup=False)
