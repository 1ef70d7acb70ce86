"""A small simulated site and a run of it, made once for all tests that look at either.

`python tests/runs.py` makes both and forgets them: what remains are compiled kernels.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numba

from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.products import RunResult
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site

SITE = SimulationOptions(image_size=192, views=6, region_size=32)


@dataclass(frozen=True)
class Mapped:
    """A finished run; for reading only."""

    site: Path
    """site.toml."""
    truth: Path
    run: Path
    result: RunResult

    def copy(self, folder: Path) -> Path:
        """The run folder again, to spoil."""
        return Path(shutil.copytree(self.run, folder))


def map_small_site(folder: Path) -> Mapped:
    """Simulates and maps the small site in `folder`."""
    site = simulate_site(SITE, folder / "site")
    threads = numba.get_num_threads()
    # So small a map spends its time waiting for threads, milliseconds for each step on a busy machine.
    numba.set_num_threads(1)
    try:
        result = pipeline.run(site, folder / "run")
    finally:
        numba.set_num_threads(threads)
    return Mapped(site, site.with_name("truth.h5"), folder / "run", result)


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        map_small_site(Path(folder))
