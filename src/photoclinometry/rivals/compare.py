"""A run and its rivals: the same images, poses, pixels and figures."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

from photoclinometry.evaluate.same_site import read_truth_of
from photoclinometry.evaluate.spread import Table
from photoclinometry.io import run_files
from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.io.json_file import write_json
from photoclinometry.io.reference import Reference, read_reference
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.ranges import Ranged
from photoclinometry.model.warning import warn
from photoclinometry.rivals.figure import draw_comparison
from photoclinometry.rivals.measure import common_masks, image_figures, map_figures
from photoclinometry.rivals.mvs import run_mvs
from photoclinometry.rivals.ngp import NgpOptions, run_ngp
from photoclinometry.rivals.outcome import Outcome, costed, rendered_map
from photoclinometry.rivals.problem import Problem, read_problem
from photoclinometry.rivals.spc import SpcOptions, run_spc
from photoclinometry.rivals.splat import SplatOptions, run_splat
from photoclinometry.rivals.splat_reflectance import run_splat_reflectance
from photoclinometry.rivals.table import comparison_table
from photoclinometry.simulate.truth import Truth

log = logging.getLogger(__name__)

OURS = "phomo"
"""The name of the run itself in tables."""
RIVALS_FIGURE = "rivals.png"
"""The figure's name in the folder of a comparison."""
NOT_THE_MAP = ("products", "report", "held_out")
"""Stages of a run whose time is not counted: no rival writes a report, or places views."""

Method = Literal["spc", "mvs", "splat", "splat-reflectance", "ngp"]
METHODS: tuple[Method, ...] = get_args(Method)


@dataclass(frozen=True, kw_only=True)
class RivalOptions(Ranged):
    """What the rivals do."""

    spc: SpcOptions = field(default_factory=SpcOptions)
    splat: SplatOptions = field(default_factory=SplatOptions)
    ngp: NgpOptions = field(default_factory=NgpOptions)


@dataclass(frozen=True, kw_only=True)
class RivalComparison:
    """A run and its rivals on the same images."""

    folder: Path
    """Where rivals.json, rivals.md and rivals.png are."""
    figures: Mapping[str, Mapping[str, float | None]]
    """Figures of each method by name, the run's own first; their names end in the unit."""
    outcomes: Sequence[Outcome]
    """Predictions, and maps where a method has one."""
    table: Table

    def __str__(self) -> str:
        return self.table.terminal()


def compare_rivals(
    run: str | Path,
    *,
    methods: Sequence[Method] = METHODS,
    predict: Sequence[str] = (),
    truth: str | Path | None = None,
    reference: str | Path | None = None,
    unit: str = "m",
    site: str | Path | None = None,
    out: str | Path | None = None,
    options: RivalOptions | None = None,
    progress: Progress = no_progress,
) -> RivalComparison:
    """Map a finished run's region by other published methods, and compare all on the same views.

    Args:
        run: Folder of a finished run with a reflectance model.
        methods: "spc" (classic stereophotoclinometry), "mvs" (geometry alone), "splat" (Gaussian splatting),
            "splat-reflectance" (Gaussian splatting with a reflectance model) and "ngp" (a neural radiance field).
        predict: Which of the views that the run held out are to be predicted. Default: all of them.
        truth: truth.h5 of a simulated site, to compare surface, normals and albedos with.
        reference: Another map to compare with, as for `evaluate`.
        unit: Unit of length of the reference map.
        site: The site.toml, if it has moved since the run.
        out: Folder for the results. Default: rivals/ in the run folder.
        options: What the methods do.
        progress: Called as progress(what, done, total).

    Returns:
        The figures of every method, their predictions and maps, and the table, which is what is printed. A method that
        finds no map is left out, with a warning.

    Raises:
        InputError: Files are missing, the run has no reflectance model, or it has used a view that is to be predicted.
    """
    run, given = Path(run), None if site is None else Path(site)
    if truth is not None and reference is not None:
        raise InputError("truth and reference are both given; compare with one at a time")
    folder, options = Path(out) if out is not None else run / run_files.RIVALS_FOLDER, options or RivalOptions()
    other = None if reference is None else read_reference(reference)
    problem = read_problem(run, given, predict)
    true = None if truth is None else read_truth_of(truth, problem.scene)
    makers: dict[str, Callable[[], Outcome]] = {
        "spc": lambda: run_spc(problem, options.spc, progress),
        "mvs": lambda: run_mvs(problem, run, folder / "mvs", given, progress),
        "splat": lambda: run_splat(problem, options.splat, progress),
        "splat-reflectance": lambda: run_splat_reflectance(problem, options.splat, progress),
        "ngp": lambda: run_ngp(problem, options.ngp, progress),
    }
    _check(methods, makers)
    outcomes = [_own(problem, run)]
    for name in dict.fromkeys(methods):
        log.info("%s ...", name)
        try:
            outcomes.append(costed(makers[name]))
        except ReconstructionError as error:
            warn(log, "rival-failed", "%s finds no map, and is left out of the table: %s", name, error)
    masks = common_masks(problem, outcomes)
    figures: dict[str, dict[str, float | None]] = {}
    for outcome in outcomes:
        found: dict[str, Any] = image_figures(problem, outcome, masks)
        found |= _map_figures(outcome, true, other, unit)
        figures[outcome.name] = found | {"cpu_s": outcome.cpu_s, "peak_memory_gb": outcome.peak_memory_gb}
    table = comparison_table(figures, f"{problem.scene.name}: {_views(problem)}")
    comparison = RivalComparison(folder=folder, figures=figures, outcomes=outcomes, table=table)
    _write(comparison, problem, masks)
    return comparison


def _map_figures(outcome: Outcome, truth: Truth | None, reference: Reference | None, unit: str) -> dict[str, float]:
    """Figures of a method's map; none of a rival's that lies so far off that it cannot be compared.

    Raises InputError where the run's own cannot be.
    """
    try:
        return map_figures(outcome.scene, truth, reference, unit)
    except InputError as error:
        if outcome.name == OURS:
            raise
        warn(log, "rival-failed", "%s: its surface is not compared: %s", outcome.name, error)
        return {}


def _check(methods: Sequence[str], known: Mapping[str, Any]) -> None:
    """Raises InputError for a method that there is not, or none."""
    unknown = [name for name in methods if name not in known]
    if unknown or not methods:
        what = f"there is no method {unknown[0]!r}" if unknown else "no method is given"
        raise InputError(f"{what}; known: {', '.join(known)}")


def _own(problem: Problem, run: Path) -> Outcome:
    """The run's own map, with what its stages took; without that where they were read back from an earlier run."""
    rendered, covered = rendered_map(problem, problem.scene)
    found = Outcome(name=OURS, rendered=rendered, covered=covered, knows_light=True, scene=problem.scene)
    return replace(found, **run_cost(run_files.read_metrics(run).get("stages", ())))


def run_cost(stages: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """CPU seconds and peak memory of a run's stages; nothing where one was read back that the run had not made."""
    counted = [stage for stage in stages if stage["stage"] not in NOT_THE_MAP]
    made = {stage["stage"] for stage in counted if not stage["resumed"]}
    if not made or any(stage["stage"] not in made for stage in counted):
        return {}
    memory = [stage["peak_memory_gb"] for stage in counted]
    peak = None if None in memory else max(memory)
    return {"cpu_s": sum(stage["cpu_s"] for stage in counted), "peak_memory_gb": peak}


def _views(problem: Problem) -> str:
    held = len(problem.views) - problem.train
    return f"{problem.train} views used, {held} held out"


def _write(comparison: RivalComparison, problem: Problem, masks: Sequence[Any]) -> None:
    """rivals.json, rivals.md and rivals.png. Raises RunFolderError."""
    content = {
        "views": list(problem.scene.views.name),
        "held_out": [] if problem.held_out is None else list(problem.held_out.name),
        "figures": comparison.figures,
        "history": {outcome.name: list(outcome.history) for outcome in comparison.outcomes if len(outcome.history)},
    }
    write_json(comparison.folder / "rivals.json", content)
    write_text(comparison.folder / "rivals.md", comparison.table.markdown() + f"\n![The views]({RIVALS_FIGURE})\n")
    with atomic_path(comparison.folder / RIVALS_FIGURE) as temporary:
        draw_comparison(temporary, problem, comparison.outcomes, masks)
