"""Halves and doubles every tuned number of the pipeline, and tables what that does to three small sites.

    python benchmarks/sensitivity.py --out sensitivity                       all numbers: a day
    python benchmarks/sensitivity.py --out sensitivity --only adjust/noise   those of one file

Tuned numbers are found in the sources: literals in named constants of modules, in defaults of options and arguments,
and unnamed ones inside functions. Each is changed in a copy of the sources, and the sites are mapped with that copy in
a process of its own, so that compiled functions change, too. Sites: moderate light, strong light, and few views, all of
Hapke's ground. Results are kept in OUT/results.jsonl; a stopped call goes on. OUT/table.md has a row per number: the
largest change of surface distance, normals, relative rotations and completeness over sites and both directions.
"""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import tyro

ROOT = Path(__file__).parents[1]
PACKAGES = ("surface", "photometry", "registration", "sfm", "matching", "adjust", "pipeline")
"""Those whose numbers may shape a map."""
ARITHMETIC = {0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 100.0, 180.0, 255.0, 1.4826}
"""Unnamed numbers that are parts of formulas and units."""
STRUCTURE = ("LANES", "STORED", "CAMERA_SIZE", "LANDMARK_SIZE", "SIMILARITY", "DEG", "FORMAT", "VERSION")
"""Named numbers that say how things are stored or what a unit is."""
FIGURES = {
    "surface_distance_mean_gsd": "surface",
    "normal_error_mean_deg": "normals",
    "camera_relative_rotation_error_mean_deg": "rotations",
    "completeness_percent": "completeness",
}
SITES = {
    "moderate": {"seed": 0},
    "strong": {"seed": 1, "lighting": "strong"},
    "few": {"seed": 2, "views": 7},
}
SIZE = {"views": 10, "image_size": 256, "region_size": 64, "reflectance": "hapke"}
MAP = """
import json, sys
import photoclinometry as pcm
from photoclinometry.matching.densify import DensifyOptions
options = {"densify": DensifyOptions(min_views=4), "adjust": pcm.AdjustOptions(uncertainty=False)}
run = pcm.run(sys.argv[1], sys.argv[2], **options)
print(json.dumps(pcm.evaluate(run, truth=sys.argv[3]).metrics))
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
    for file in sorted(f for name in PACKAGES for f in (package / name).rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        yield from _numbers_of(file.relative_to(package).as_posix(), text, ast.parse(text), "", named=False)


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
    for child in ast.iter_child_nodes(node):
        yield from _numbers_of(file, text, child, name, named=named)


def _inside_function(name: str) -> bool:
    return name.endswith("()")


def _is_tuned(value: float, name: str, named: bool) -> bool:
    if named:
        return value != 0 and not any(word in STRUCTURE for word in name.strip("_").split(", "))
    return isinstance(value, float) and abs(value) not in ARITHMETIC


def changed_source(text: str, number: Number, factor: float) -> str:
    """The source with one literal times a factor; integers stay integers, one at least."""
    lines = text.split("\n")
    line, end = lines[number.line - 1], number.column + len(number.text)
    if line[number.column : end] != number.text:
        raise ValueError(f"{number.key}: expected {number.text!r}, found {line[number.column : end]!r}")
    value = ast.literal_eval(number.text) * factor
    if isinstance(ast.literal_eval(number.text), int):
        value = max(1, round(value))
    lines[number.line - 1] = f"{line[: number.column]}{value!r}{line[end:]}"
    return "\n".join(lines)


def map_site(package: Path, site: Path, out: Path) -> dict[str, float] | None:
    """The figures of a site mapped by a copy of the package; None where it finds no map."""
    environment = {**os.environ, "PYTHONPATH": str(package.parent), "NUMBA_NUM_THREADS": "1"}
    arguments = [sys.executable, "-c", MAP, str(site / "site.toml"), str(out), str(site / "truth.h5")]
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True, check=False)
    shutil.rmtree(out, ignore_errors=True)
    if done.returncode:
        return None
    metrics = json.loads(done.stdout.strip().split("\n")[-1])
    return {short: metrics[name] for name, short in FIGURES.items()}


def table(results: list[dict]) -> str:
    """Markdown, a row per number, the most influential first."""
    base = {r["site"]: r["figures"] for r in results if r["key"] == "base"}
    rows = []
    for key in dict.fromkeys(r["key"] for r in results if r["key"] != "base"):
        mine = [r for r in results if r["key"] == key]
        largest = dict.fromkeys(FIGURES.values(), 0.0)
        failed = any(r["figures"] is None for r in mine)
        for r in (r for r in mine if r["figures"] is not None):
            for figure in largest:
                before = base[r["site"]][figure]
                largest[figure] = max(largest[figure], 100.0 * abs(r["figures"][figure] / before - 1.0), key=abs)
        rows.append((failed, max(largest.values()), mine[0]["number"], largest))
    rows.sort(key=lambda row: (row[0], row[1]), reverse=True)
    head = ["number", "value", *(f"{figure} [%]" for figure in FIGURES.values()), "no map"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for failed, _, number, largest in rows:
        cells = [f"{number['file']}:{number['line']} {number['name']}", number["text"]]
        cells += [f"{value:.1f}" for value in largest.values()] + ["yes" if failed else ""]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main(out: Path, only: str = "") -> None:
    """Change numbers one by one.

    Args:
        out: Folder for sites, results and table.
        only: Numbers whose file and name hold this text.
    """
    from photoclinometry.simulate.options import SimulationOptions
    from photoclinometry.simulate.site import simulate_site

    out = out.resolve()
    for name, options in SITES.items():
        if not (out / name / "site.toml").is_file():
            simulate_site(SimulationOptions(**{**SIZE, **options}), out / name)
    source, copy = ROOT / "src" / "photoclinometry", out / "source" / "photoclinometry"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(source, copy)
    kept = out / "results.jsonl"
    results = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()] if kept.is_file() else []
    known = {(r["key"], r["factor"], r["site"]) for r in results}

    def measure(key: str, factor: float, number: Number | None) -> None:
        for site in SITES:
            if (key, factor, site) not in known:
                figures = map_site(copy, out / site, out / "run")
                content = None if number is None else asdict(number)
                results.append({"key": key, "factor": factor, "site": site, "figures": figures, "number": content})
                with kept.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(results[-1]) + "\n")

    measure("base", 1.0, None)
    chosen = [n for n in tuned_numbers(source) if only in f"{n.file} {n.name}"]
    for place, number in enumerate(chosen):
        text = (source / number.file).read_text(encoding="utf-8")
        for factor in (0.5, 2.0):
            (copy / number.file).write_text(changed_source(text, number, factor), encoding="utf-8")
            measure(number.key, factor, number)
        (copy / number.file).write_text(text, encoding="utf-8")
        (out / "table.md").write_text(table(results), encoding="utf-8")
        print(f"{place + 1} of {len(chosen)}: {number.key} {number.name}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
