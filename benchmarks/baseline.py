"""Committed figures, and whether new ones are worse."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from cases import METRICS, Metric
from photoclinometry import __version__

Figures = Mapping[str, Mapping[str, float]]
"""Values by case and metric."""

COSTS = ("_cpu_s", "_gb")
"""Endings of metrics that depend on the machine."""


@dataclass(frozen=True)
class Change:
    """One figure beside its baseline."""

    case: str
    metric: str
    unit: str
    baseline: float | None
    value: float | None
    verdict: str
    """"same", "better", "WORSE", "MISSING" (there was one), "new", or "other machine"."""

    @property
    def is_regression(self) -> bool:
        return self.verdict in ("WORSE", "MISSING")


def machine() -> str:
    """The processor, and how many of them this process may use."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].split(":", 1)[1].strip() if lines else model
    return f"{model}, {len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()} cores"


def write_baseline(path: Path, figures: Figures) -> None:
    """The figures with unit, direction and tolerance of each, as JSON that reads well in a diff."""
    cases = {
        case: {
            name: {"value": float(f"{value:.5g}"), **asdict(METRICS[name])}
            for name, value in values.items()
            if name in METRICS and math.isfinite(value)
        }
        for case, values in figures.items()
    }
    content = {"version": __version__, "machine": machine(), "cases": cases}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def kept_figures(baseline: Mapping, here: str) -> dict[str, dict[str, float]]:
    """A baseline's figures; of another machine than `here` without the costs, which a new baseline would take for its
    own machine's."""
    same = here == baseline["machine"]
    return {
        case: {name: entry["value"] for name, entry in values.items() if same or not name.endswith(COSTS)}
        for case, values in baseline["cases"].items()
    }


def compare(baseline: Mapping, figures: Figures, here: str) -> list[Change]:
    """Every figure of the cases that were run beside its baseline, by the tolerances that the baseline states.

    CPU time and memory are judged only on the machine that the baseline was made on (`here` is this one).
    """
    changes = []
    for case, values in figures.items():
        known = baseline["cases"].get(case, {})
        for name in dict.fromkeys([*known, *(n for n in values if n in METRICS)]):
            entry, value = known.get(name), values.get(name)
            value = None if value is None or not math.isfinite(value) else value
            if entry is None:
                if value is not None:
                    changes.append(Change(case, name, METRICS[name].unit, None, value, "new"))
                continue
            limits = Metric(**{key: entry[key] for key in ("unit", "direction", "relative", "absolute")})
            verdict = judge(limits, entry["value"], value)
            if name.endswith(COSTS) and here != baseline["machine"] and value is not None:
                verdict = "other machine"
            changes.append(Change(case, name, limits.unit, entry["value"], value, verdict))
    return changes


def judge(metric: Metric, baseline: float, value: float | None) -> str:
    """ "same" within the tolerance, else "better" or "WORSE"; "MISSING" without a value."""
    if value is None:
        return "MISSING"
    worse = value - baseline if metric.direction == "lower" else baseline - value
    tolerance = max(metric.relative * abs(baseline), metric.absolute)
    return "same" if abs(worse) <= tolerance else "WORSE" if worse > 0 else "better"
