"""The tuned numbers of the pipeline's sources, and sources with some of them changed.

They are literals in named constants of modules, in defaults of options and arguments, and unnamed ones in functions.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "photoclinometry"
NEARLY_ALL = 0.9
"""Shares from here on up to one, such as how much of a window must be valid: doubled they would never be reached."""
PACKAGES = ("surface", "photometry", "registration", "sfm", "matching", "adjust", "pipeline")
"""Those whose numbers may shape a map."""
NOT_HERE = (
    "adjust/altimeter_tracks.py",  # sites without an altimeter
    "adjust/covariance/",  # only sigmas
    "adjust/graph/kernels.py",  # places in compiled rows
    "adjust/graph/product.py",
    "adjust/graph/slot.py",
    "matching/roma.py",  # another matcher
    "matching/warp.py",
    "pipeline/calibrate.py",  # another command
    "pipeline/checks/dark_level_check.py",  # warnings
    "pipeline/checks/moved_suns.py",
    "pipeline/checks/rendering_check.py",
    "pipeline/frame/",  # sites without control points, and without pose priors
    "pipeline/refine.py",  # another command
    "pipeline/presets.py",
    "pipeline/folder/",  # files, locks and owners of folders
    "pipeline/trust.py",  # warnings
    "sfm/region",  # the sites name theirs
    "sfm/self_calibration.py",  # warnings, and `phomo calibrate`
    "surface/measure.py",  # another command
    "registration/",  # maps in frames that are given, and comparison of maps
    # Whole bodies, their products, and the simulator:
    "adjust/bundle.py",
    "sfm/known_poses.py",
    "surface/closed_mesh.py",
    "surface/decimate.py",
    "surface/mass_properties.py",
    "surface/mesh_rays.py",
    "surface/polyhedron_gravity.py",
    "surface/radial_rays.py",
    "surface/surface_gravity.py",
)
"""Modules that do not take part in the maps of these sites."""
ARITHMETIC = {0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 100.0, 180.0, 255.0, 1.4826}
"""Unnamed numbers that are parts of formulas and units."""
STRUCTURE = (
    *("LANES", "STORED", "VIEW_SIZE", "LANDMARK_SIZE", "SIMILARITY", "DEG", "FORMAT", "VERSION"),
    *("BLOCK", "PAIRS_AT_ONCE", "threads", "PROBE", "DEPTH", "NOTHING_AROUND"),
)
"""Named numbers that say how things are stored, how much is treated at a time, or what a unit is."""


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


def groups_of(numbers: Sequence[Number], size: int) -> list[list[Number]]:
    """Up to `size` numbers of the same file each."""
    files = [list(mine) for _, mine in groupby(numbers, key=lambda n: n.file)]
    return [mine[k : k + size] for mine in files for k in range(0, len(mine), size)]


def is_compiled(package: Path, numbers: Sequence[Number]) -> bool:
    """Whether a compiled function may hold one of the numbers: its file, or one that has its name, compiles some.
    Functions that call compiled ones keep what was compiled of these, wherever these stand."""
    texts = {file.relative_to(package).as_posix(): file.read_text(encoding="utf-8") for file in package.rglob("*.py")}
    compiled = {name: set(re.findall(r"\w+", text)) for name, text in texts.items() if "njit" in text}
    names = {part for number in numbers if number.named for part in number.name.split(", ")}
    return any(n.file in compiled for n in numbers) or any(names & words for words in compiled.values())
