"""Effects of changed numbers on the figures of maps: kept in a file as they come, and as a table."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tuned_numbers import Number

NOTHING = 1.0
"""Per cent; a smaller change is of no consequence, even if it is no chance."""
BEYOND = 3.0
"""A change is significant beyond this many standard deviations of chance."""
FIGURES = {
    "surface_distance_mean_gsd": "surface",
    "normal_error_mean_deg": "normals",
    "camera_relative_rotation_error_mean_deg": "rotations",
    "completeness_percent": "completeness",
}


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
        """Least change of each figure of a site that counts [%]: beyond NOTHING and chance."""
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
