"""`phomo ingest`: a site from archived images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import tyro

from photoclinometry.ingest.options import IngestOptions


def ingest(
    files: tyro.conf.Positional[tuple[Path, ...]],
    /,
    out: Path,
    options: Annotated[IngestOptions, tyro.conf.arg(name="")] = IngestOptions(),  # noqa: B008
) -> None:
    """Make a site (site.toml and images) of PDS3, PDS4, ISIS, FITS, PNG or TIFF files.

    Cameras, Suns and poses come from labels, SPICE kernels, ISIS's tables, SUMFILEs, a table of known cameras, or the
    options. If something is missing, the error lists it for each file.

    Args:
        files: Images, or labels of images; a label and its image count once.
        out: Folder for the site; new or empty.
        options: Facts that the files do not hold.
    """
    from rich.console import Console

    from photoclinometry.cli.bars import progress_bars
    from photoclinometry.ingest.ingest import ingest as library

    console = Console(stderr=True)
    with progress_bars(console) as bars:
        result = library(files, out, options, lambda _, done, total: bars("files", done, total))
    for reason in result.refused:
        console.print(f"left out: {reason}", highlight=False, markup=False)
    _print_sources(console, result)
    print(result.site)


def _print_sources(console: Any, result: Any) -> None:
    """One line for each image: size, brightness, and the sources of camera, Sun and pose."""
    for e in result.exposures:
        height, width = e.image.valid.shape
        masked = 100.0 * (1.0 - e.image.valid.mean())
        origin = "; ".join(f"{what}: {source.split(':')[0]}" for what, source in e.sources.items())
        line = f"{e.path.name}: {width} x {height}, {e.brightness}, {masked:.2f} % masked; {origin}"
        console.print(line, highlight=False, markup=False, soft_wrap=True)
