"""`phomo refine`: from a text model to a better one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.cli.bars import progress_bars
from photoclinometry.cli.terminal import log_to, say_result
from photoclinometry.pipeline.refine import RefineOptions


def refine(
    model: tyro.conf.Positional[Path],
    /,
    out: Path,
    overwrite: bool = False,
    options: Annotated[RefineOptions, tyro.conf.arg(name="")] = RefineOptions(),  # noqa: B008
) -> None:
    """Refine a model in the text format of the paper's authors by the joint estimate alone.

    The folder gets the refined model, in model/, and what `phomo run` leaves: landmarks.ply, sparse/, scene.h5,
    metrics.json and a report. The images are not needed.

    Args:
        model: Folder with cameras.txt, images.txt and points3D.txt.
        out: Folder for the result; new, empty, or that of an earlier run of the same model.
        overwrite: Remove what the folder holds of another model; without it, such a folder is refused.
        options: What the files do not say, and how the estimate is made.
    """
    from rich.console import Console

    from photoclinometry.pipeline import refine as library
    from photoclinometry.pipeline.folder.run_folder import check_run
    from photoclinometry.pipeline.folder.run_owner import owner_of_model

    start = library.read_start(model, options)  # a mistake there leaves no run folder behind
    check_run(out, owner_of_model(model, start.model.scene), overwrite=overwrite)
    console = Console(stderr=True)
    with progress_bars(console) as progress, log_to(out, console, progress, overwrite=overwrite):
        result = library.refine(start, out, options, progress, overwrite)
    say_result(console, result)
