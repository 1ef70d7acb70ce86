"""`phomo photometry`: which reflectance model the images ask for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from photoclinometry.evaluate.model_ranking import RankingOptions

if TYPE_CHECKING:
    from photoclinometry.evaluate.model_ranking import ModelFit, ModelRanking


def photometry(
    run: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    options: Annotated[RankingOptions, tyro.conf.arg(name="")] = RankingOptions(),  # noqa: B008
) -> None:
    """Rank reflectance models by how well they predict images that they were not fitted to.

    Each model is fitted to most of a map's views, with normals and albedos of its own, and predicts the others. Prints
    a table, and writes photometry.json (parameters with standard deviations, errors of every view) and photometry.png
    (phase curve, disk function, residuals by incidence, emission and phase). The map stays as it is:
    `phomo run --reflectance` makes one with another model.

    Args:
        run: Folder of a finished run.
        out: Folder for the files. Default: photometry/ in the run folder.
        options: Which models, and how they are compared.
    """
    from rich.console import Console

    import photoclinometry as pcm
    from photoclinometry.cli.bars import progress_bars
    from photoclinometry.io.run_files import PHOTOMETRY_FOLDER
    from photoclinometry.output.photometry import write_photometry

    with progress_bars(Console(stderr=True)) as progress:
        ranking = pcm.rank_reflectance(run, options=options, progress=progress)
    folder = out or (run.parent if run.is_file() else run) / PHOTOMETRY_FOLDER
    write_photometry(folder, ranking)
    show(ranking)
    console = Console(stderr=True)
    console.print(f"written: {folder}/photometry.json, .png", soft_wrap=True, highlight=False, markup=False)


def show(ranking: ModelRanking) -> None:
    """The ranking as a table on the terminal, and the limits of the images' information."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table(title="error on images kept out", title_justify="left")
    for head in ("model", "error", "level", "parameters"):
        table.add_column(head, justify="right" if head in ("error", "level") else "left")
    for fit in ranking.fits:
        mark = " *" if ranking.is_as_good(fit) else ""
        errors = (f"{fit.error_percent:.2f} %", f"{fit.level_percent:.2f} %")
        table.add_row(fit.reflectance.name + mark, *errors, _parameters(fit))
    console.print(table)
    console.print("level: the part of the error that whole images share; 0 where models or images leave it open")
    console.print("* the best, or as good as it; (in brackets) the images know it no better than its prior")
    low, high = ranking.best.phases_seen_deg
    console.print(f"Phases seen: {low:.0f} to {high:.0f} degrees; phase functions beyond are guesses.")
    for name, reason in ranking.left_out.items():
        console.print(f"{name}: left out, {reason}", markup=False)


def _parameters(fit: ModelFit) -> str:
    model = fit.reflectance
    rows = zip(model.parameter_names, model.values, fit.parameter_sigma, fit.determined, strict=True)
    shown = (
        f"{name} {value:.3g} ± {sigma:.1g}" if known else f"({name} {value:.3g} ± {sigma:.1g})"
        for name, value, sigma, known in rows
    )
    return ", ".join(shown) or "none"
