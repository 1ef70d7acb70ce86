"""Halves and doubles every tuned number of the pipeline, and tables what that does to three small sites.

    python benchmarks/sensitivity.py --out sensitivity                       all numbers
    python benchmarks/sensitivity.py --out sensitivity --only sfm/ surface/  those of some files

Tuned numbers are found in the sources: literals in named constants of modules, in defaults of options and arguments,
and unnamed ones inside functions. They are changed in a copy of the sources, and the sites are mapped with that copy in
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

import ast
import itertools
import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from itertools import groupby
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tyro

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "photoclinometry"
NOTHING = 1.0
"""Per cent; a smaller change is of no consequence, even if it is no chance."""
FAINT, DRAWS = 1e-4, 6
"""Noise added to the images, as a share of their brightness, and how many times chance is drawn."""
BEYOND = 3.0
"""A change is no chance beyond so many standard deviations of chance."""
LONGEST_MAP_S = 400.0
"""Wall time after which there is no map, ten times what one takes: a ratio of steps that becomes one makes a search
endless."""
NEARLY_ALL = 0.9
"""Shares from here on up to one, such as how much of a window must be valid: doubled they would never be reached."""
PACKAGES = ("surface", "photometry", "registration", "sfm", "matching", "adjust", "pipeline")
"""Those whose numbers may shape a map."""
NOT_HERE = (
    "adjust/covariance/",  # only sigmas
    "adjust/graph/kernels.py",  # places in compiled rows
    "adjust/graph/product.py",
    "adjust/graph/slot.py",
    "matching/roma.py",  # another matcher
    "matching/warp.py",
    "pipeline/control.py",  # sites without control points, and without pose priors
    "pipeline/refine.py",  # another command
    "pipeline/presets.py",
    "pipeline/run_",  # who writes to a folder
    "pipeline/trust.py",  # warnings
    "sfm/region",  # the sites name theirs
    "registration/",  # maps in frames that are given, and comparison of maps
    # Whole bodies, their products, and the simulator:
    "adjust/bundle.py",
    "sfm/known_poses.py",
    "surface/closed_mesh.py",
    "surface/decimate.py",
    "surface/mass_properties.py",
    "surface/mesh_rays.py",
    "surface/poisson.py",
    "surface/polyhedron_gravity.py",
    "surface/radial_rays.py",
    "surface/surface_gravity.py",
)
"""What does not take part in the maps of these sites."""
ARITHMETIC = {0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 100.0, 180.0, 255.0, 1.4826}
"""Unnamed numbers that are parts of formulas and units."""
STRUCTURE = (
    *("LANES", "STORED", "VIEW_SIZE", "LANDMARK_SIZE", "SIMILARITY", "DEG", "FORMAT", "VERSION"),
    *("BLOCK", "PAIRS_AT_ONCE", "threads", "PROBE", "DEPTH", "NOTHING_AROUND"),
)
"""Named numbers that say how things are stored, how much is treated at a time, or what a unit is."""
FIGURES = {
    "surface_distance_mean_gsd": "surface",
    "normal_error_mean_deg": "normals",
    "camera_relative_rotation_error_mean_deg": "rotations",
    "completeness_percent": "completeness",
}
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


@dataclass(frozen=True)
class Number:
    """A literal in the sources."""

    file: str
    """Below the package, with slashes."""
    line: int
    """From 1."""
    column: int
    text: str
    name: str
    """Of the constant, option or argument; of unnamed ones the function."""
    named: bool

    @property
    def key(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


def tuned_numbers(package: Path) -> Iterator[Number]:
    """The tuned numbers of a package's sources, in the order of files and lines."""
    for path in sorted(f for name in PACKAGES for f in (package / name).rglob("*.py")):
        file = path.relative_to(package).as_posix()
        if not file.startswith(NOT_HERE):
            text = path.read_text(encoding="utf-8")
            yield from _numbers_of(file, text, ast.parse(text), "", named=False)


def _numbers_of(file: str, text: str, node: ast.AST, name: str, *, named: bool) -> Iterator[Number]:
    """Literals below a node; `name` is that of the constant or function around it."""
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        parts = [t for target in targets for t in ast.walk(target) if isinstance(t, ast.Name)]
        name, named = ", ".join(part.id for part in parts) or name, named or not _inside_function(name)
    if isinstance(node, ast.FunctionDef):
        for default in [*node.args.defaults, *node.args.kw_defaults]:
            if default is not None:
                yield from _numbers_of(file, text, default, f"{node.name}()", named=True)
        for child in node.body:
            yield from _numbers_of(file, text, child, f"{node.name}()", named=False)
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        if _is_tuned(node.value, name, named):
            literal = ast.get_source_segment(text, node) or ""
            yield Number(file, node.lineno, node.col_offset, literal, name, named)
        return
    if isinstance(node, ast.Subscript | ast.Slice):
        return
    if isinstance(node, ast.AnnAssign):  # an annotation has the range of an option, not its value
        if node.value is not None:
            yield from _numbers_of(file, text, node.value, name, named=named)
        return
    for child in ast.iter_child_nodes(node):
        yield from _numbers_of(file, text, child, name, named=named)


def _inside_function(name: str) -> bool:
    return name.endswith("()")


def _is_tuned(value: float, name: str, named: bool) -> bool:
    if named:
        return value != 0 and not any(word in STRUCTURE for word in name.strip("_").split(", "))
    return isinstance(value, float) and abs(value) not in ARITHMETIC


def changed_source(text: str, numbers: Sequence[Number], factor: float) -> str:
    """The source with some of its literals times a factor. Integers stay integers, one at least; of a share that is
    nearly all, the rest is divided by the factor."""
    lines = text.split("\n")
    for number in sorted(numbers, key=lambda n: n.column, reverse=True):
        line, end = lines[number.line - 1], number.column + len(number.text)
        if line[number.column : end] != number.text:
            raise ValueError(f"{number.key}: expected {number.text!r}, found {line[number.column : end]!r}")
        before = ast.literal_eval(number.text)
        value = before * factor
        if isinstance(before, int):
            value = max(1, round(value))
        elif NEARLY_ALL <= before < 1.0:
            value = 1.0 - (1.0 - before) / factor
        lines[number.line - 1] = f"{line[: number.column]}{value!r}{line[end:]}"
    return "\n".join(lines)


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


@dataclass
class Results:
    """Figures of all maps so far: by the numbers changed, the factor and the site."""

    file: Path
    figures: dict[tuple[str, float, str], dict[str, float] | None]

    @classmethod
    def read(cls, file: Path) -> Results:
        lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
        rows = [json.loads(line) for line in lines]
        return cls(file, {(row["key"], row["factor"], row["site"]): row["figures"] for row in rows})

    def add(self, key: str, factor: float, site: str, figures: dict[str, float] | None) -> None:
        self.figures[key, factor, site] = figures
        with self.file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"key": key, "factor": factor, "site": site, "figures": figures}) + "\n")

    def changes(self, numbers: Sequence[Number]) -> dict[str, dict[str, float]]:
        """By site, the largest change of each figure in per cent; infinite where there was no map."""
        found: dict[str, dict[str, float]] = {}
        for (key, _, site), figures in self.figures.items():
            if key == key_of(numbers):
                largest, base = found.setdefault(site, dict.fromkeys(FIGURES.values(), 0.0)), self.base(site)
                for name in largest:
                    after = math.inf if figures is None else 100.0 * abs(figures[name] / base[name] - 1.0)
                    largest[name] = max(largest[name], after)
        return found

    def base(self, site: str) -> dict[str, float]:
        """Figures of a site with all numbers as they are."""
        figures = self.figures["base", 1.0, site]
        if figures is None:
            raise RuntimeError(f"the site {site!r} has no map with all numbers as they are")
        return figures

    def counts(self, site: str) -> dict[str, float]:
        """How far each figure of a site must change [%] to count: beyond NOTHING and chance."""
        draws = [figures for (key, _, where), figures in self.figures.items() if (key, where) == ("chance", site)]
        base, maps = self.base(site), [figures for figures in draws if figures is not None]
        spread = {name: math.sqrt(sum((each[name] / base[name] - 1.0) ** 2 for each in maps)) for name in base}
        return {name: max(NOTHING, BEYOND * 100.0 * of / math.sqrt(max(1, len(maps)))) for name, of in spread.items()}

    def change(self, numbers: Sequence[Number]) -> dict[str, float] | None:
        """The largest change of each figure over sites in per cent; None if not measured."""
        changes = self.changes(numbers).values()
        return {name: max(of[name] for of in changes) for name in FIGURES.values()} if changes else None

    def effect(self, numbers: Sequence[Number]) -> dict[str, float]:
        """By site, the largest change of a figure over that which counts."""
        return {
            site: max(change / self.counts(site)[name] for name, change in of.items())
            for site, of in self.changes(numbers).items()
        }


def key_of(numbers: Sequence[Number]) -> str:
    """Of the numbers that are changed together."""
    return " ".join(number.key for number in numbers) or "base"


def groups_of(numbers: Sequence[Number], size: int) -> list[list[Number]]:
    """Up to `size` numbers of the same file each."""
    files = [list(mine) for _, mine in groupby(numbers, key=lambda n: n.file)]
    return [mine[k : k + size] for mine in files for k in range(0, len(mine), size)]


def table(results: Results, groups: Sequence[Sequence[Number]]) -> str:
    """Markdown, a row for all numbers that were changed together and none of them alone, the most influential first."""
    rows = []
    for group in groups:
        alone = [number for number in group if results.change([number]) is not None]
        together = [number for number in group if number not in alone]
        sets = [(changed, changed) for changed in ([number] for number in alone)]
        for shown, changed in [*sets, (together, group)]:
            change = results.change(changed)
            if shown and change is not None:
                rows.append((max(results.effect(changed).values()), shown, change))
    rows.sort(key=lambda row: row[0], reverse=True)
    head = ["file", "numbers", *(f"{figure} [%]" for figure in FIGURES.values()), "effect"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for effect, numbers, change in rows:
        cells = [numbers[0].file, described(numbers)]
        cells += ["no map" if math.isinf(value) else f"{value:.1f}" for value in change.values()]
        cells.append("-" if math.isinf(effect) else f"{effect:.1f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def described(numbers: Sequence[Number]) -> str:
    """Names with their values; those of one statement share a name."""
    values: dict[str, list[str]] = {}
    for number in numbers:
        values.setdefault(number.name, []).append(number.text)
    return ", ".join(f"{name} {' and '.join(texts)}" for name, texts in values.items())


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


def is_compiled(package: Path, numbers: Sequence[Number]) -> bool:
    """Whether a compiled function may hold one of the numbers: its file, or one that has its name, compiles some.
    Functions that call compiled ones keep what was compiled of these, wherever these stand."""
    texts = {file.relative_to(package).as_posix(): file.read_text(encoding="utf-8") for file in package.rglob("*.py")}
    compiled = {name: set(re.findall(r"\w+", text)) for name, text in texts.items() if "njit" in text}
    names = {part for number in numbers if number.named for part in number.name.split(", ")}
    return any(n.file in compiled for n in numbers) or any(names & words for words in compiled.values())


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
