"""`phomo simulate`: images of a simulated place or body, with the exact truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import check_site_folder, simulate_site


@dataclass(frozen=True, kw_only=True)
class Simulate:
    """Simulate a place or a whole body: images with shadows, optics and noise, site.toml, and truth.h5."""

    out: Path
    """Folder for the site; new or empty."""
    overwrite: bool = False
    """Replace a simulated site in that folder, with all that the folder holds."""
    options: Annotated[SimulationOptions, tyro.conf.arg(name="")] = field(default_factory=SimulationOptions)


def simulate(arguments: Annotated[Simulate, tyro.conf.arg(name="")]) -> Path:
    """Simulate a place or a whole body: images with shadows, optics and noise, site.toml, and truth.h5.

    Prints the path of its site.toml.
    """
    from rich.console import Console

    from photoclinometry.cli.bars import progress_bars

    check_site_folder(arguments.out, arguments.overwrite)
    console = Console(stderr=True)
    with progress_bars(console) as progress:
        path = simulate_site(arguments.options, arguments.out, progress, arguments.overwrite)
    said = f"site: {path}\ntruth: {path.with_name('truth.h5')}"
    console.print(said, soft_wrap=True, highlight=False, markup=False)
    return path
