"""The tables of docs/explanation/rivals.md: twelve sites, two of them in all figures, four real images, settings.

    python benchmarks/rivals.py --out rivals --vesta SITE      two hours and a half on one core; goes on when stopped

One thread and one process at a time, as the CPU seconds on the page are. Tables are written to OUT/tables.md as they
grow.
"""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from photoclinometry.rivals.compare import METHODS
from photoclinometry.rivals.table import COLUMNS as TABLE

COLUMNS = ("phomo", *METHODS)
PLACES, LIGHTINGS, SEEDS = ("ahuna", "cornelia", "ikapati"), ("moderate", "strong"), (1, 2)
PAIRS = tuple(itertools.product(PLACES, LIGHTINGS))
SIZE = ("--views", "12", "--image-size", "256", "--region-size", "64")
LAMBERT = ("--reflectance", "lunar-lambert")
HELD_OUT = ("--hold-out", "images/003.fits", "images/007.fits", "images/010.fits")
TWO_SITES: dict[str, tuple[str, ...]] = {
    "cornelia, moderate light": ("--preset", "cornelia", "--seed", "1"),
    "ahuna, strong light": ("--preset", "ahuna", "--lighting", "strong", "--seed", "2"),
}
SETTINGS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("splat", ("--splat.iterations", "300")),
    ("splat", ()),
    ("splat", ("--splat.iterations", "3000")),
    ("splat", ("--splat.iterations", "10000")),
    ("splat", ("--splat.degree", "0")),
    ("splat", ("--splat.degree", "2")),
    ("splat", ("--splat.growth", "1")),
    ("splat-reflectance", ("--splat.iterations", "300")),
    ("splat-reflectance", ()),
    ("splat-reflectance", ("--splat.iterations", "3000")),
    ("splat-reflectance", ("--splat.growth", "1")),
    ("ngp", ("--ngp.iterations", "500")),
    ("ngp", ()),
    ("ngp", ("--ngp.levels", "6")),
    ("ngp", ("--ngp.table-log2", "12")),
    ("spc", ("--spc.window", "9")),
    ("spc", ()),
    ("spc", ("--spc.window", "33")),
    ("spc", ("--spc.poses", "fixed")),
)
"""Settings that are varied, and no option for the default, of the six sites of seed 1."""
FIGURES = {
    "psnr_mean_db": ("PSNR, views used [dB]", 1),
    "psnr_held_out_mean_db": ("PSNR, held out [dB]", 1),
    "ssim_mean": ("SSIM, views used", 1),
    "ssim_held_out_mean": ("SSIM, held out", 1),
    "view_error_mean_percent": ("photometric error, views used [%]", -1),
    "view_error_held_out_mean_percent": ("photometric error, held out [%]", -1),
    "surface_distance_mean_gsd": ("distance to the surface [GSD]", -1),
    "normal_error_mean_deg": ("normals [°]", -1),
    "albedo_error_mean_percent": ("albedo [%]", -1),
    "coverage_percent": ("coverage [%]", 0),
    "cpu_s": ("CPU time [s]", 0),
    "peak_memory_gb": ("memory [GB]", 0),
}
"""Name by key, and whether the greatest (1) or the least (-1) is the best; decimals are those of `phomo rivals`."""
DIGITS = {key: digits for _, key, digits in TABLE}
Figures = dict[str, dict[str, float | None]]


def main(out: Path, vesta: Path | None = None, settings: bool = True) -> None:
    """Map sites by all methods, and write the tables.

    Args:
        out: Folder for sites, runs and tables.
        vesta: site.toml of the four real images, each of which is held out once.
        settings: Also vary the rivals' settings.
    """
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    tables: list[str] = []

    def write(title: str, lines: Sequence[str]) -> None:
        tables.append("\n".join((f"## {title}", "", *lines)))
        (out / "tables.md").write_text("\n\n".join(tables) + "\n", encoding="utf-8")

    sites = {key: _figures(out / "study/runs" / _run_of(*key) / "rivals") for key in _twelve(out / "study")}
    write("PSNR of the views held out [dB]", _psnr_table(sites))
    write("Surface [GSD] and normals [°]", _surface_table(sites))
    for number, (name, options) in enumerate(TWO_SITES.items()):
        write(name, _all_figures(_one_site(out, number, options)))
    if vesta:
        found = {image.name: _vesta(out, vesta, image) for image in sorted((vesta.parent / "images").iterdir())}
        write("Vesta, one image held out at a time", _vesta_table(found))
        write("Vesta, all images used", _all_figures(_vesta(out, vesta, None)))
    if settings:
        write("Settings", _settings_table(out))


def _phomo(*arguments: str | Path) -> None:
    """`phomo` in one thread; ends with its output where it fails."""
    one = {name: "1" for name in ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")}
    command = [str(Path(sys.executable).with_name("phomo")), *map(str, arguments)]
    done = subprocess.run(command, env={**os.environ, **one}, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}:\n{done.stdout}\n{done.stderr}")


def _figures(folder: Path) -> Figures:
    """The figures of each method in a folder of results."""
    content: dict[str, Any] = json.loads((folder / "rivals.json").read_text(encoding="utf-8"))
    return content["figures"]


def _run_of(place: str, lighting: str, seed: int) -> str:
    return f"{place}-{lighting}-hapke-{seed}/lunar-lambert"


def _twelve(study: Path) -> list[tuple[str, str, int]]:
    """The sites of the study, mapped."""
    seeds = tuple(map(str, SEEDS))
    what = ("--models", "lunar-lambert", "--surfaces", "hapke", "--lightings", *LIGHTINGS, "--seeds", *seeds)
    how = ("--no-geometry-alone", *SIZE, "--hold-out-every", "4", "--rivals", *METHODS)
    _phomo("study", "--out", study, *what, *how)
    return [(*pair, seed) for pair in PAIRS for seed in SEEDS]


def _compared(run: Path, to: Path, *options: str | Path) -> Figures:
    """The figures of a comparison, made unless its folder has them."""
    if not (to / "rivals.json").is_file():
        _phomo("rivals", run, "--out", to, *options)
    return _figures(to)


def _one_site(out: Path, number: int, options: Sequence[str]) -> Figures:
    site, run = out / f"site-{number}", out / f"run-{number}"
    if not (site / "site.toml").is_file():
        _phomo("simulate", "--out", site, "--reflectance", "hapke", *SIZE, *options)
    _phomo("run", site / "site.toml", "--out", run, *LAMBERT, *HELD_OUT)
    return _compared(run, run / "rivals", "--truth", site / "truth.h5")


def _vesta(out: Path, site: Path, image: Path | None) -> Figures:
    run = out / f"vesta-{image.stem if image else 'all'}"
    held_out = ("--hold-out", f"images/{image.name}") if image else ()
    _phomo("run", site, "--out", run, "--densify.min-views", "3", "--region.size-px", "100", "100", *held_out)
    return _compared(run, run / "rivals")


def _heads(first: str, columns: Sequence[str]) -> list[str]:
    return [f"| {first} | {' | '.join(columns)} |", "|---|" + "---:|" * len(columns)]


def _row(name: str, values: Sequence[float | None], digits: int, best: int) -> str:
    """A row of a table, the greatest (`best` 1) or least (-1) value bold."""
    texts = ["–" if value is None else f"{value:.{digits}f}" for value in values]
    known = [float(text) for text in texts if text != "–"]
    if best and known:
        winner = max(known) if best > 0 else min(known)
        texts = [f"**{text}**" if text != "–" and float(text) == winner else text for text in texts]
    return f"| {name} | {' | '.join(texts)} |"


def _of_seeds(sites: dict[tuple[str, str, int], Figures], pair: tuple[str, str], key: str) -> np.ndarray:
    """(methods, seeds) of a figure."""
    return np.array([[sites[(*pair, seed)][method][key] for seed in SEEDS] for method in COLUMNS], float)


def _psnr_table(sites: dict[tuple[str, str, int], Figures]) -> list[str]:
    lines, means = _heads("", COLUMNS), []
    for pair in PAIRS:
        values = _of_seeds(sites, pair, "psnr_held_out_mean_db")
        mean, spread = values.mean(axis=1), values.std(axis=1, ddof=1)
        cells = [f"{m:.2f} ± {s:.2f}" for m, s in zip(mean, spread, strict=True)]
        best = int(mean.argmax())
        cells[best] = f"**{mean[best]:.2f}** ± {spread[best]:.2f}"
        lines.append(f"| {', '.join(pair)} | {' | '.join(cells)} |")
        means.append(mean)
    return [*lines, _row("average", list(np.mean(means, axis=0)), 2, 1)]


def _surface_table(sites: dict[tuple[str, str, int], Figures]) -> list[str]:
    lines = _heads("", COLUMNS)
    for pair in PAIRS:
        surface = _of_seeds(sites, pair, "surface_distance_mean_gsd").mean(axis=1)
        normals = _of_seeds(sites, pair, "normal_error_mean_deg").mean(axis=1)
        bold = [["**" if value == row.min() else "" for value in row] for row in (surface, normals)]
        cells = (f"{a}{s:.3f}{a}, {b}{n:.2f}{b}" for s, n, a, b in zip(surface, normals, bold[0], bold[1], strict=True))
        lines.append(f"| {', '.join(pair)} | {' | '.join(cells)} |")
    return lines


def _all_figures(figures: Figures) -> list[str]:
    lines = _heads("", COLUMNS)
    for key, (name, best) in FIGURES.items():
        values = [figures[method].get(key) for method in COLUMNS]
        if any(value is not None for value in values):
            lines.append(_row(name, values, DIGITS[key], best))
    return lines


def _vesta_table(found: dict[str, Figures]) -> list[str]:
    lines = _heads("", COLUMNS)
    for name, figures in found.items():
        lines.append(_row(f"`{name}`", [figures[method]["psnr_held_out_mean_db"] for method in COLUMNS], 2, 1))
    for key, (name, best) in itertools.islice(FIGURES.items(), 6):
        values = np.array([[figures[method][key] for figures in found.values()] for method in COLUMNS], float)
        means = values.mean(axis=1).tolist()
        lines.append(_row(f"mean: {name}", means, DIGITS[key], best))
    return lines


def _settings_table(out: Path) -> list[str]:
    """Means of the six sites of seed 1 with each setting."""
    lines = _heads("", ("used [dB]", "held out [dB]", "surface [GSD]", "normals [°]"))
    for method, options in SETTINGS:
        found = []
        for pair in PAIRS:
            run = out / "study/runs" / _run_of(*pair, 1)
            truth = out / "study/sites" / f"{pair[0]}-{pair[1]}-hapke-1" / "truth.h5"
            to = out / "settings" / "-".join((method, *pair, *options)).replace("--", "")
            compared = ("--methods", method, "--truth", truth, *options)
            found.append((_compared(run, to, *compared) if options else _figures(run / "rivals"))[method])
        keys = ("psnr_mean_db", "psnr_held_out_mean_db", "surface_distance_mean_gsd", "normal_error_mean_deg")
        used, held_out, surface, normals = (np.mean([each[key] for each in found]) for key in keys)
        name = f"`{method}`" + (f", `{' '.join(options)}`" if options else " (defaults)")
        lines.append(f"| {name} | {used:.2f} | {held_out:.2f} | {surface:.3f} | {normals:.2f} |")
    return lines


if __name__ == "__main__":
    tyro.cli(main)
