"""Halves and doubles every tuned number of the pipeline, and tables what that does to three small sites.

    python benchmarks/sensitivity.py --out sensitivity                       all numbers
    python benchmarks/sensitivity.py --out sensitivity --only sfm/ surface/  those of some files

Tuned numbers (`tuned_numbers.py`) are changed in a copy of the sources, and the sites are mapped with that copy in
a process of its own, so that compiled functions change, too. Sites: moderate light, strong light, and few views, all of
Hapke's ground.

Each figure of a site has its chance: how far it moves when the images get noise of FAINT of their brightness, far below
the detector's. A change of less than BEYOND times that, or of less than NOTHING per cent, is none.

Most numbers shape nothing. So the numbers of a file are first changed together, `--group` at a time, on all sites.
Where no figure changes, each of the group has that row. The numbers of the other groups are then changed one by one, on
the site that the group changed most, those of the most influential group first. Results are kept in OUT/results.jsonl
as they come, and a call goes on where the last was stopped. OUT/table.md has a row for each number that was changed
alone, and one for the others of a group: the largest change over sites and both directions, and the same in units of
what counts as one. With `--group 1` all are changed alone, on all sites.
"""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tyro

from sensitivity_results import FIGURES, Results, key_of, table
from tuned_numbers import SOURCE, Number, changed_source, groups_of, is_compiled, tuned_numbers

FAINT, DRAWS = 1e-4, 6
"""Noise added to the images, as a share of their brightness, and how many times chance is drawn."""
LONGEST_MAP_S = 400.0
"""Wall time after which there is no map, ten times what one takes: a ratio of steps that becomes one makes a search
endless."""
SITES = {
    "few": {"seed": 2, "views": 7},
    "moderate": {"seed": 0},
    "strong": {"seed": 4, "lighting": "strong", "views": 12, "region_size": 80},
}
SIZE = {"views": 10, "image_size": 256, "region_size": 64, "reflectance": "hapke"}
MAP = """
import json, sys
import photoclinometry as pcm
from photoclinometry.pipeline import run
run.write_products = lambda folder, summary: summary.adjustment.scene
site, out, truth = sys.argv[1:]
scene = pcm.run(site, out, adjust=pcm.AdjustOptions(uncertainty=False))
print(json.dumps(pcm.evaluate(scene, truth=truth, site=site).metrics))
"""


def with_faint_noise(site: Path, out: Path, seed: int) -> None:
    """A copy of the site whose images have noise of FAINT of their brightness."""
    from astropy.io import fits

    shutil.copytree(site, out)
    rng = np.random.default_rng(seed)
    for file in sorted((out / "images").iterdir()):
        with fits.open(file, mode="update") as content:
            data = content[0].data
            data[...] = data * (1.0 + FAINT * rng.standard_normal(data.shape))


def name_region(file: Path) -> None:
    """Writes into a site.toml which region a run maps: what is chosen anew may change with the faintest noise."""
    import photoclinometry as pcm
    from photoclinometry.io.site import RegionRequest, write_site

    site = pcm.read_site(file)
    scene = pcm.run(file, file.parent / "first").scene
    region = scene.region
    shutil.rmtree(file.parent / "first")
    center = (region.col + region.width / 2, region.row + region.height / 2)
    size = (region.width, region.height)
    write_site(file, replace(site, region=RegionRequest(scene.views.name[scene.reference], center, size, None)))


def map_site(package: Path, site: Path, out: Path) -> dict[str, float] | None:
    """The figures of a site mapped by a copy of the package; None where it finds no map."""
    path = os.pathsep.join([str(package.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    arguments = [sys.executable, "-c", MAP, str(site / "site.toml"), str(out), str(site / "truth.h5")]
    try:
        done = subprocess.run(
            arguments, env=environment, capture_output=True, text=True, check=False, timeout=LONGEST_MAP_S
        )
    except subprocess.TimeoutExpired:
        return None
    finally:
        shutil.rmtree(out, ignore_errors=True)
    if done.returncode:
        return None
    metrics = json.loads(done.stdout.strip().split("\n")[-1])
    return {short: metrics[name] for name, short in FIGURES.items()}


@dataclass(frozen=True)
class Laboratory:
    """Maps the sites with changed copies of the sources, some at once."""

    out: Path
    results: Results
    processes: int

    @property
    def unchanged(self) -> Path:
        """The sources as they are, with what was compiled of them."""
        return self.out / "source" / "photoclinometry"

    def measure(self, sets: Sequence[Sequence[Number]], sites: Sequence[Sequence[str]] | None = None) -> None:
        """Maps sites with the numbers of each set halved and doubled, all of one site before those of the next.

        Args:
            sets: Numbers that are changed together.
            sites: Of each set; all if not given.
        """
        of_sets = [tuple(SITES)] * len(sets) if sites is None else sites
        self._map(
            [
                (numbers, factor, site)
                for site in SITES
                for numbers, mine in zip(sets, of_sets, strict=True)
                if site in mine
                for factor in (0.5, 2.0)
            ]
        )

    def measure_unchanged(self) -> None:
        """Maps all sites as they are, one after the other so that functions are compiled once, and then with faint
        noise in their images, DRAWS times."""
        for site in SITES:
            if ("base", 1.0, site) not in self.results.figures:
                figures = map_site(self.unchanged, self.out / site, self.out / "run")
                self.results.add("base", 1.0, site, figures)
        todo = [
            (float(draw), site)
            for draw, site in itertools.product(range(DRAWS), SITES)
            if ("chance", float(draw), site) not in self.results.figures
        ]
        with ThreadPoolExecutor(self.processes) as pool:
            for (draw, site), figures in zip(todo, pool.map(self._map_of_chance, todo), strict=True):
                self.results.add("chance", draw, site, figures)

    def _map_of_chance(self, draw_and_site: tuple[float, str]) -> dict[str, float] | None:
        draw, site = draw_and_site
        with TemporaryDirectory(dir=self.out) as scratch:
            with_faint_noise(self.out / site, Path(scratch, "site"), seed=int(draw))
            return map_site(self.unchanged, Path(scratch, "site"), Path(scratch, "run"))

    def _map(self, changes: Sequence[tuple[Sequence[Number], float, str]]) -> None:
        """Maps what has no results yet; each result is kept as soon as it is there."""
        todo = [change for change in changes if (key_of(change[0]), *change[1:]) not in self.results.figures]
        with ThreadPoolExecutor(self.processes) as pool:
            maps = {pool.submit(self._map_of_change, *change): change for change in todo}
            for done in as_completed(maps):
                numbers, factor, site = maps[done]
                self.results.add(key_of(numbers), factor, site, done.result())

    def _map_of_change(self, numbers: Sequence[Number], factor: float, site: str) -> dict[str, float] | None:
        with TemporaryDirectory(dir=self.out) as scratch:
            package = Path(scratch, "photoclinometry")
            uncompiled = shutil.ignore_patterns("*.nbi", "*.nbc") if is_compiled(self.unchanged, numbers) else None
            shutil.copytree(self.unchanged, package, ignore=uncompiled)
            for file in {n.file for n in numbers}:
                text = (package / file).read_text(encoding="utf-8")
                changed = changed_source(text, [n for n in numbers if n.file == file], factor)
                (package / file).write_text(changed, encoding="utf-8")
            return map_site(package, self.out / site, Path(scratch, "run"))


def prepare(site: Path) -> None:
    """Simulates one of SITES and names its region."""
    from photoclinometry.simulate.options import SimulationOptions
    from photoclinometry.simulate.site import simulate_site

    if not (site / "site.toml").is_file():
        simulate_site(SimulationOptions(**{**SIZE, **SITES[site.name]}), site)
        name_region(site / "site.toml")


def main(out: Path, only: tuple[str, ...] = ("",), group: int = 5, processes: int = 1) -> None:
    """Change numbers, group by group, then one by one.

    Args:
        out: Folder for sites, results and table.
        only: Numbers whose file and name hold one of these texts.
        group: How many numbers are changed together at first.
        processes: How many maps are made at once.
    """
    out = out.resolve()
    with ProcessPoolExecutor(min(processes, len(SITES)), mp_context=get_context("spawn")) as pool:
        list(pool.map(prepare, [out / name for name in SITES]))
    laboratory = Laboratory(out, Results.read(out / "results.jsonl"), processes)
    shutil.copytree(SOURCE, laboratory.unchanged, dirs_exist_ok=True)  # what was compiled is kept
    groups = groups_of([n for n in tuned_numbers(SOURCE) if any(text in f"{n.file} {n.name}" for text in only)], group)

    laboratory.measure_unchanged()
    print({site: laboratory.results.counts(site) for site in SITES}, flush=True)
    laboratory.measure(groups)
    effects = [laboratory.results.effect(numbers) for numbers in groups]
    ordered = sorted(zip(groups, effects, strict=True), key=lambda pair: -max(pair[1].values()))
    alone = [
        ([number], [max(effect, key=effect.__getitem__)])
        for numbers, effect in ordered
        if max(effect.values()) > 1.0 and len(numbers) > 1
        for number in numbers
    ]
    laboratory.measure([numbers for numbers, _ in alone], [sites for _, sites in alone])
    (out / "table.md").write_text(table(laboratory.results, groups), encoding="utf-8")


if __name__ == "__main__":
    tyro.cli(main)
