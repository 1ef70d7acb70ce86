"""A small simulated site and a run of it, made once for all tests that look at either.

`python tests/runs.py FOLDER` makes both before the suite, and compiled kernels with them; where `SMALL_RUN` names that
folder, processes of the suite take them from there.
"""

from __future__ import annotations

import logging
import pickle
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numba
import pytest

from photoclinometry.cli.stage_lines import StageLines
from photoclinometry.io.site import read_site, write_site
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.products import RunResult
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site

RESULT = "result.pickle"
SITE = SimulationOptions(image_size=192, views=6, region_size=32)


@dataclass(frozen=True)
class Told:
    """What a run lets its user see."""

    lines: tuple[str, ...]
    """On the terminal, one a stage."""
    progress: dict[str, tuple[int, int]]
    """What is done at last of each kind of work, and its total."""


@dataclass(frozen=True)
class Mapped:
    """A finished run; for reading only."""

    site: Path
    """site.toml."""
    truth: Path
    run: Path
    result: RunResult
    told: Told

    def copy(self, folder: Path) -> Path:
        """The run folder again, to spoil."""
        return Path(shutil.copytree(self.run, folder))

    def changed_site(self, folder: Path, **changes: Any) -> Path:
        """A site.toml in a folder of its own, with the same images and something else changed in the site."""
        folder.mkdir()
        (folder / "images").symlink_to(self.site.parent / "images", target_is_directory=True)
        path = folder / "site.toml"
        write_site(path, replace(read_site(self.site), **changes))
        return path


def small_run(folder: Path) -> Mapped:
    """Simulates and maps the small site in `folder`."""
    site = simulate_site(SITE, folder / "site")
    threads = numba.get_num_threads()
    # So small a map spends its time waiting for threads, milliseconds for each step on a busy machine.
    numba.set_num_threads(1)
    try:
        with lines_shown() as lines:
            progress: dict[str, tuple[int, int]] = {}

            def note(what: str, done: int, total: int) -> None:
                progress[what] = done, total

            result = pipeline.run(site, folder / "run", progress=note)
        return _mapped(folder, result, Told(tuple(lines), progress))
    finally:
        numba.set_num_threads(threads)


def small_run_left_in(folder: Path) -> Mapped:
    """What `python tests/runs.py` left in `folder`."""
    return _mapped(folder, *pickle.loads((folder / RESULT).read_bytes()))


@contextmanager
def lines_shown() -> Iterator[list[str]]:
    """Lines that the records of the package's log make on the terminal meanwhile."""
    lines, found = StageLines(), []

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            line = lines.line(record)
            if line is not None:
                found.append(line)

    log, handler = logging.getLogger("photoclinometry"), Handler()
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)
    try:
        yield found
    finally:
        log.removeHandler(handler)
        log.setLevel(level)


def draw_no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs write no report."""
    monkeypatch.setattr("photoclinometry.output.report.write_report", lambda folder, *_, **__: folder / "index.html")


def _mapped(folder: Path, result: RunResult, told: Told) -> Mapped:
    return Mapped(folder / "site" / "site.toml", folder / "site" / "truth.h5", folder / "run", result, told)


def leave_small_run(folder: Path) -> None:
    """For `small_run_left_in`."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    made = small_run(folder)
    (folder / RESULT).write_bytes(pickle.dumps((made.result, made.told)))


if __name__ == "__main__":
    import runs  # whose classes are pickled, not this program's

    runs.leave_small_run(Path(sys.argv[1]).resolve())
