"""`phomo run`: from site.toml to a map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from photoclinometry.cli.bars import progress_bars
from photoclinometry.cli.site_path import site_file
from photoclinometry.cli.terminal import log_to, say_result
from photoclinometry.pipeline.presets import PRESETS, preset
from photoclinometry.pipeline.run import RunOptions

if TYPE_CHECKING:
    PresetName = str
else:
    PresetName = Literal[*PRESETS]


def run(
    site: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    overwrite: bool = False,
    preset: PresetName | None = None,
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = RunOptions(),  # noqa: B008
) -> None:
    """Map a site: poses, dense landmarks, normals and albedo, with a report.

    A run that was stopped goes on where it was; changed options redo only what depends on them.

    Args:
        site: site.toml, which names the images, the camera and a Sun direction per image; or the folder with it.
        out: Folder for the run; new, empty, or that of an earlier run of the same site. Default: run/ beside site.toml.
        overwrite: Remove what the folder holds of another site; without it, such a folder is refused.
        preset: Defaults for a common case, which other options replace. {presets}.
        options: How the map is made.
    """
    from rich.console import Console

    from photoclinometry.io.site import read_site
    from photoclinometry.pipeline import run as pipeline
    from photoclinometry.pipeline.choices import choose
    from photoclinometry.pipeline.folder.run_folder import check_run
    from photoclinometry.pipeline.folder.run_owner import owner_of_site

    site = site_file(site)
    described = read_site(site)  # a mistake here leaves no run folder behind
    choose(described, options)  # nor does an option that does not fit the site
    out = out or site.parent / "run"
    check_run(out, owner_of_site(described), overwrite=overwrite)

    console = Console(stderr=True)
    with progress_bars(console) as progress, log_to(out, console, progress, overwrite=overwrite):
        result = pipeline.run(site, out, options, progress, overwrite)
    say_result(console, result)


_ABOUT = "; ".join(f"{name}: {each.about}" for name, each in PRESETS.items())
run.__doc__ = (run.__doc__ or "").replace("{presets}", _ABOUT)


def prepared(words: Sequence[str]) -> Callable[..., Any]:
    """`run` with the defaults of the preset that is among the command's words."""
    from photoclinometry.cli.arguments import with_defaults

    given = [after for word, after in pairwise(words) if word == "--preset"]
    given += [word.partition("=")[2] for word in words if word.startswith("--preset=")]
    known = [name for name in given if name in PRESETS]  # others are refused when the words are parsed
    return with_defaults(run, "options", preset(known[-1])) if known else run
