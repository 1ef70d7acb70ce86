"""`phomo run`: from site.toml to a map."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.pipeline import RunOptions


def run(
    site: tyro.conf.Positional[Path],
    /,
    out: Path,
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = RunOptions(),  # noqa: B008
) -> None:
    """Map a site: poses, dense landmarks, normals and albedo, with a report.

    A run that was stopped goes on where it was; changed options redo only what depends on them.

    Args:
        site: site.toml, which names the images, the camera and a Sun direction per image.
        out: Folder for the run; new, empty, or that of an earlier run of the same site.
        options: How the map is made.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from photoclinometry import pipeline
    from photoclinometry.io.site import read_site

    read_site(site)  # a mistake there leaves no run folder behind

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:18}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as bars:
        tasks: dict[str, int] = {}

        def progress(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=None)
            bars.update(tasks[what], completed=done, total=total or None)  # pyright: ignore[reportArgumentType]

        with log_to(out, console):
            result = pipeline.run(site, out, options, progress)
    for name in result.left_out:
        console.print(f"not registered, left out: {name}", highlight=False)
    psnr = result.metrics.get("psnr_mean_db")
    quality = f", mean PSNR {psnr:.1f} dB" if psnr is not None else ""
    console.print(f"{len(result.scene.landmarks)} landmarks in {len(result.scene.views)} views{quality}")
    if not result.adjustment.converged:
        console.print(f"the joint estimate has not converged: {result.adjustment.message}")
    print(result.report)


class log_to:
    """While open, the package's log goes to OUT/log (all of it) and to the terminal (stages, warnings)."""

    def __init__(self, out: Path, console):
        self.out, self.console = Path(out), console

    def __enter__(self):
        from photoclinometry.errors import RunFolderError
        from photoclinometry.runfolder import open_run

        self.logger = logging.getLogger("photoclinometry")
        self.level = self.logger.level
        open_run(self.out)
        try:
            file = logging.FileHandler(self.out / "log", encoding="utf-8")
        except OSError as error:
            reason = error.strerror or error
            raise RunFolderError(f"{self.out / 'log'}: cannot be written: {reason}; choose another --out") from error
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        terminal = _Terminal(self.console)
        terminal.setLevel(logging.INFO)
        self.handlers = [file, terminal]
        self.logger.setLevel(logging.DEBUG)
        for handler in self.handlers:
            self.logger.addHandler(handler)
        return self

    def __exit__(self, *exception):
        if exception[0] is not None:
            self.logger.error("stopped: %s: %s", exception[0].__name__, exception[1])
        for handler in self.handlers:
            self.logger.removeHandler(handler)
            handler.close()
        self.logger.setLevel(self.level)


class _Terminal(logging.Handler):
    def __init__(self, console):
        super().__init__()
        self.console = console

    def emit(self, record: logging.LogRecord) -> None:
        self.console.print(record.getMessage(), highlight=False, markup=False)
