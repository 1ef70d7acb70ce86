"""`phomo rivals`: a run beside other published methods, on the same images and views."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.rivals.compare import METHODS, Method, RivalOptions


def rivals(
    run: Path,
    /,
    methods: tuple[Method, ...] = METHODS,
    hold_out: tuple[str, ...] = (),
    truth: Path | None = None,
    reference: Path | None = None,
    unit: str = "m",
    site: Path | None = None,
    out: Path | None = None,
    options: Annotated[RivalOptions, tyro.conf.arg(name="")] = RivalOptions(),  # noqa: B008
) -> dict[str, dict[str, float | None]]:
    """Map the region of a finished run by other published methods, and compare all on the same views.

    The rivals have the run's images, poses, Suns and reflectance parameters. Writes rivals.json, rivals.md and
    rivals.png, and prints the table.

    Args:
        run: Folder of a finished run with a reflectance model.
        methods: spc: classic stereophotoclinometry. mvs: geometry alone, textured with the mean brightness.
            splat: Gaussian splatting. splat-reflectance: Gaussian splatting with a reflectance model.
            ngp: instant-NGP, a neural radiance field.
        hold_out: Which of the views that the run held out are to be predicted. Default: all of them.
        truth: truth.h5 of a simulated site: compares surface, normals and albedos.
        reference: Another map of the place, to compare surface, normals and albedos with; as for `phomo evaluate`.
        unit: Length unit of the reference map.
        site: The site.toml, if it has moved since the run.
        out: Folder for the results. Default: rivals/ in the run folder.
        options: What the methods do.
    """
    from rich.console import Console

    from photoclinometry.cli.bars import progress_bars
    from photoclinometry.rivals.compare import compare_rivals

    console = Console(stderr=True)
    with progress_bars(console) as progress:
        found = compare_rivals(
            run,
            methods=methods,
            predict=hold_out,
            truth=truth,
            reference=reference,
            unit=unit,
            site=site,
            out=out,
            options=options,
            progress=progress,
        )
    print(found.table.terminal(console.width if console.is_terminal else 80))
    console.print(f"written: {found.folder}/rivals.json, .md, .png", soft_wrap=True, highlight=False)
    return {name: dict(figures) for name, figures in found.figures.items()}
