"""Runs a suite of simulated sites and compares accuracy, CPU seconds and memory with the committed baseline.

    python benchmarks/bench.py                    the small suite: minutes
    python benchmarks/bench.py --suite full       the full-size sites: hours
    python benchmarks/bench.py --update           run, and make the outcome the baseline

Exit code: 0 nothing is worse, 1 something is, 2 there is no baseline to compare with.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console
from rich.table import Table

from baseline import Change, compare, kept_figures, machine, write_baseline
from cases import METRICS, SUITES, WARM_UP, Case

FOLDER = Path(__file__).parent / "baselines"
ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1: CPU seconds then mean the same on any number of cores, and sums add up in the same order."""
STAGES = {"sparse": "sparse_cpu_s", "dense": "dense_cpu_s", "last_estimate": "adjust_cpu_s"}


def main(
    suite: Literal["small", "full"] = "small",
    update: bool = False,
    only: tuple[str, ...] = (),
    out: Path | None = None,
) -> int:
    """Run the benchmarks.

    Args:
        suite: small (minutes) or full (hours).
        update: Make the outcome the committed baseline; with --only, of those cases.
        only: Names of the cases to run; default all.
        out: Also write the figures to this JSON file.
    """
    console = Console(width=110, highlight=False)
    cases = {name: case for name, case in SUITES[suite].items() if not only or name in only}
    unknown = set(only) - set(cases)
    if unknown:
        console.print(f"no case {sorted(unknown)[0]!r}; known: {', '.join(SUITES[suite])}")
        return 2
    figures = run_cases(cases, console)
    if out is not None:
        out.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    file = FOLDER / f"{suite}.json"
    known = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None
    if known is not None:
        changes = compare(known, figures, machine())
        show(changes, console)
    if update:
        kept = {} if known is None else kept_figures(known, machine())
        kept = {name: figures.get(name, kept.get(name, {})) for name in SUITES[suite] if name in {*figures, *kept}}
        write_baseline(file, kept)
        console.print(f"baseline: {file}")
        return 0
    if known is None:
        console.print(f"{file}: there is no baseline; make one with --update")
        return 2
    worse = [change for change in changes if change.is_regression]
    for change in worse:
        console.print(f"{change.verdict}: {change.case}: {change.metric}")
    console.print(f"{len(worse)} of {len(changes)} figures are worse than the baseline")
    return 1 if worse else 0


def run_cases(cases: dict[str, Case], console: Console) -> dict[str, dict[str, float]]:
    """Each case in a process of its own, so that memory is its own; the first only compiles."""
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    figures = {}
    for name, case in {"warm-up": WARM_UP, **cases}.items():
        start = time.perf_counter()
        context = multiprocessing.get_context("spawn")
        with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(1, mp_context=context) as pool:
            found = pool.submit(measure, case, Path(folder)).result()
        console.print(f"{name}: {time.perf_counter() - start:.0f} s")
        if name in cases:
            figures[name] = found
    return figures


def measure(case: Case, folder: Path) -> dict[str, float]:
    """Simulates and maps one case; its figures by the names of METRICS. CPU seconds count all threads."""
    from photoclinometry.evaluate.compare import evaluate_against_truth
    from photoclinometry.pipeline import run as pipeline
    from photoclinometry.simulate.site import simulate_site
    from photoclinometry.simulate.truth_file import read_truth

    start = time.process_time()
    site = simulate_site(case.simulation, folder / "site")
    simulated = time.process_time()
    result = pipeline.run(site, folder / "run", case.run)
    done = time.process_time()
    stages = json.loads((folder / "run" / "metrics.json").read_text(encoding="utf-8"))["stages"]
    truth = evaluate_against_truth(result.scene, read_truth(site.with_name("truth.h5"))).metrics
    costs = {"simulate_cpu_s": simulated - start, "run_cpu_s": done - simulated}
    costs |= {STAGES[s["stage"]]: s["cpu_s"] for s in stages if s["stage"] in STAGES}
    costs["peak_memory_gb"] = max(s["peak_memory_gb"] for s in stages)
    found = {**result.metrics, **truth, **costs}
    return {name: float(found[name]) for name in METRICS if name in found}


def show(changes: Sequence[Change], console: Console) -> None:
    """The figures as one table per case."""
    for case in dict.fromkeys(change.case for change in changes):
        table = Table("figure", "unit", "baseline", "now", "", title=case, title_justify="left")
        for c in (change for change in changes if change.case == case):
            shown = ["–" if v is None else f"{v:.4g}" for v in (c.baseline, c.value)]
            table.add_row(c.metric, c.unit, *shown, "" if c.verdict == "same" else c.verdict)
        console.print(table)


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
