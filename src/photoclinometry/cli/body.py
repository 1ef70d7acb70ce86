"""`phomo body`: from site.toml to the closed surface of a whole body."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from photoclinometry.body.options import BodyOptions
from photoclinometry.cli.bars import progress_bars
from photoclinometry.cli.site_path import site_file
from photoclinometry.cli.terminal import log_to, say_ending
from photoclinometry.model.warning import few_of_each

if TYPE_CHECKING:
    from rich.console import Console

    from photoclinometry.body.products import BodyResult
    from photoclinometry.body.tile import BodyModel


def body(
    site: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    overwrite: bool = False,
    plan_only: bool = False,
    tile: int | None = None,
    print_tasks: bool = False,
    workers: Annotated[int, tyro.conf.arg(metavar="INT")] = 1,
    scheduler: str | None = None,
    options: Annotated[BodyOptions, tyro.conf.arg(name="")] = BodyOptions(),  # noqa: B008
    words: tyro.conf.Suppress[tuple[str, ...]] = (),
) -> None:
    """Map a whole body: one sparse model, a coarse shape, a plan of overlapping tiles, their maps, one closed surface.

    A map that was stopped goes on where it was. Every tile is a run folder in OUT/tiles, as `phomo run` makes them.

    Args:
        site: site.toml, which names the images, the camera and a Sun direction per image; or the folder with it.
        out: Folder for the map; new, empty, or that of an earlier call for the same site. Default: body/ by site.toml.
        overwrite: Remove what the folder holds of another site; without it, such a folder is refused.
        plan_only: End with the plan: tiles, coverage and resolution, before anything costly is computed.
        tile: Map this tile of the plan alone. The same command without it then finds the tile done. Range:
            0 to the plan's last.
        print_tasks: Make the plan, and print the command of each tile that is not mapped yet, one a line.
        workers: Processes that map tiles, one thread each. Range: 1 or more.
        scheduler: Address of a Dask scheduler whose workers map the tiles (needs the extra `cluster`).
        options: How the body is mapped.
        words: The command's own words, as typed.
    """
    from rich.console import Console

    from photoclinometry.body import run as library
    from photoclinometry.body.tile import tile_folder
    from photoclinometry.io.site import read_site
    from photoclinometry.model.errors import InputError
    from photoclinometry.pipeline.folder.run_folder import check_run

    if workers < 1:
        raise InputError(f"--workers is {workers}; give a whole number, 1 or more")
    if sum((plan_only, print_tasks, tile is not None)) > 1:
        raise InputError("--plan-only, --print-tasks and --tile do one part of the work each: give one of them")
    site = site_file(site)
    described = read_site(site)
    out = out or site.parent / "body"
    if tile is not None:
        library.map_one_tile(site, out, options, tile)
        print(tile_folder(out, tile), flush=True)
        return
    check_run(out, library.owner_of_body(described), overwrite=overwrite)
    console = Console(stderr=True)
    with progress_bars(console) as progress, log_to(out, console, progress, overwrite=overwrite):
        if plan_only:
            model = library.plan_body(site, out, options, progress, overwrite=overwrite)
            _say_plan(console, model, options.run.region.stride)
            print(out, flush=True)
            return
        if print_tasks:
            for number in library.tiles_to_map(site, out, options, progress, overwrite=overwrite):
                print(shlex.join(["phomo", "body", *_of_every_task(words), "--tile", str(number)]), flush=True)
            return
        found = library.map_body(
            site, out, options, progress, workers=workers, scheduler=scheduler, overwrite=overwrite
        )
    _say_result(console, found)


def prepared(words: Sequence[str]) -> Callable[..., Any]:
    """`body` that knows how it was called."""
    from photoclinometry.cli.arguments import with_defaults

    return with_defaults(body, "words", tuple(words))


def _of_every_task(words: Sequence[str]) -> Iterator[str]:
    """A command's words without those that the commands of single tiles do not have."""
    of_the_last = ""
    for word in words:
        name = word.partition("=")[0].replace("_", "-")
        is_value = of_the_last in ("--workers", "--scheduler")
        of_the_last = "" if is_value else word.replace("_", "-")
        if not is_value and name not in ("--print-tasks", "--overwrite", "--workers", "--scheduler"):
            yield word


def _say_plan(console: Console, model: BodyModel, stride: int) -> None:
    """What would be mapped, at what resolution, and what it costs."""
    from photoclinometry.body.plan import cost_of

    plan, unit = model.plan.value, model.unit or "units"
    gsd = sorted(tile.gsd for tile in plan.tiles)
    cost = cost_of(plan, stride)
    share = {name: f"{100 * value:.1f} %" for name, value in plan.area.items()}
    for line in (
        f"{len(plan.tiles)} tiles, {cost.landmarks:,} landmarks, ground sample distance {gsd[0]:.3g} to "
        f"{gsd[-1]:.3g} {unit}",
        f"of the surface: {share['planned']} planned, {share['dark']} seen but not lit, {share['unseen']} too seldom",
        f"about {cost.cpu_s / 60:.0f} CPU minutes, {cost.memory_gb:.1f} GB a worker",
    ):
        console.print(line, highlight=False)


def _say_result(console: Console, found: BodyResult) -> None:
    """The size of the map and its shortcomings on the console, and as `say_ending`."""
    metrics = found.metrics
    console.print(
        f"{metrics['facets']:,.0f} facets, {metrics['mapped_percent']:.1f} % of the surface mapped, in "
        f"{metrics['tiles_mapped']:.0f} of {metrics['tiles']:.0f} tiles",
        highlight=False,
    )
    console.print(
        f"{metrics['images_registered']:.0f} of {metrics['images']:.0f} images share points, "
        f"{metrics['images_placed_by_surface']:.0f} more are placed by the surface",
        highlight=False,
    )
    say_ending(console, found, few_of_each(found.warnings))
