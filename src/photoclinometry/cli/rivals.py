"""`phomo rivals`: comparison of a run with other published methods, on the same images and views."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.cli.site_path import site_file
from photoclinometry.io.run_files import is_map
from photoclinometry.rivals.compare import METHODS, Method, RivalOptions


def rivals(
    path: Path,
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
    """Map the region of a run by other published methods, and compare all on the same views.

    The rivals have the run's images, poses, Suns and reflectance parameters. Writes rivals.json, rivals.md and
    rivals.png, and prints the table.

    Args:
        path: Folder of a finished run with a reflectance model. Or a site.toml, or the folder with it: it is mapped
            first, in run/ beside it, as by `phomo run`.
        methods: spc: classic stereophotoclinometry. mvs: geometry alone, textured with the mean brightness.
            splat: Gaussian splatting. splat-reflectance: Gaussian splatting with a reflectance model.
            ngp: instant-NGP, a neural radiance field.
        hold_out: Views to be predicted: of a run, some of those that it held out (default: all of them); of a site,
            those that its map is to hold out.
        truth: truth.h5 of a simulated site: compares surface, normals and albedos.
        reference: Another map of the place, to compare surface, normals and albedos with; as for `phomo evaluate`.
        unit: Length unit of the reference map.
        site: The site.toml, if it has moved since the run.
        out: Folder for the results. Default: rivals/ in the folder of the run.
        options: What the methods do.
    """
    from rich.console import Console

    from photoclinometry.cli.bars import progress_bars
    from photoclinometry.rivals.compare import compare_rivals

    run = _mapped(path, hold_out) if _is_site(path) else path
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
    console.print(f"written: {found.folder}/rivals.json, .md, .png", soft_wrap=True, highlight=False, markup=False)
    return {name: dict(figures) for name, figures in found.figures.items()}


def _is_site(path: Path) -> bool:
    """Whether a path names a site, not a run."""
    return path.suffix == ".toml" or ((path / "site.toml").is_file() and not is_map(path))


def _mapped(path: Path, hold_out: tuple[str, ...]) -> Path:
    """The folder of the run that maps a site."""
    from photoclinometry.cli.run import run
    from photoclinometry.pipeline.run import RunOptions

    site = site_file(path)
    folder = site.parent / "run"
    run(site, out=folder, options=RunOptions(hold_out=hold_out))
    return folder
