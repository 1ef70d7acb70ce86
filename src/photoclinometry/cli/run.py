"""`phomo run`: from site.toml to a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.cli.terminal import log_to, progress_bars, say_result
from photoclinometry.pipeline.run import RunOptions


def run(
    site: tyro.conf.Positional[Path],
    /,
    out: Path,
    overwrite: bool = False,
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = RunOptions(),  # noqa: B008
) -> None:
    """Map a site: poses, dense landmarks, normals and albedo, with a report.

    A run that was stopped goes on where it was; changed options redo only what depends on them.

    Args:
        site: site.toml, which names the images, the camera and a Sun direction per image.
        out: Folder for the run; new, empty, or that of an earlier run of the same site.
        overwrite: Remove what the folder holds of another site; without it, such a folder is refused.
        options: How the map is made.
    """
    from rich.console import Console

    from photoclinometry.io.site import read_site
    from photoclinometry.pipeline import run as pipeline
    from photoclinometry.pipeline.run_folder import check_run
    from photoclinometry.pipeline.run_owner import owner_of_site

    described = read_site(site)  # a mistake here leaves no run folder behind
    pipeline.first_matcher(options)
    check_run(out, owner_of_site(described), overwrite=overwrite)

    console = Console(stderr=True)
    with progress_bars(console) as progress, log_to(out, console, overwrite=overwrite):
        result = pipeline.run(site, out, options, progress, overwrite)
    say_result(console, result)
