"""`phomo ingest`: a site from what archives hold."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.ingest.options import IngestOptions


def ingest(
    files: tyro.conf.Positional[tuple[Path, ...]],
    /,
    out: Path,
    options: Annotated[IngestOptions, tyro.conf.arg(name="")] = IngestOptions(),  # noqa: B008
) -> None:
    """Make a site (site.toml and images) of PDS3, PDS4, ISIS, FITS, PNG or TIFF files.

    Labels, SPICE kernels, ISIS's tables, SUMFILEs, a table of known cameras or you say what the cameras were, and where
    the Sun stood. What is missing is said for each file.

    Args:
        files: Images, or labels of images; a label and its image count once.
        out: Folder for the site; new or empty.
        options: What the files do not say.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from photoclinometry.ingest.ingest import ingest as library

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:30}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("ingest", total=None)

        def progress(what: str, done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, description=what[-30:])

        result = library(files, out, options, progress)
    for reason in result.refused:
        console.print(f"left out: {reason}", highlight=False, markup=False)
    _say_sources(console, result)
    print(result.site)


def _say_sources(console, result) -> None:
    """One line for each image: what it is, and where its camera, Sun and pose are from."""
    for e in result.exposures:
        height, width = e.image.valid.shape
        masked = 100.0 * (1.0 - e.image.valid.mean())
        origin = "; ".join(f"{what}: {source.split(':')[0]}" for what, source in e.sources.items())
        line = f"{e.path.name}: {width} x {height}, {e.brightness}, {masked:.2f} % masked; {origin}"
        console.print(line, highlight=False, markup=False, soft_wrap=True)
