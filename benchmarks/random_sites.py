"""Maps of sites drawn at random, with default options: how good they are, whether sigmas hold, and warnings are right.

    python benchmarks/random_sites.py --out random --count 40 --workers 2

Places, lighting, reflectance, detectors, fields of view, number of views and errors of Suns are drawn (`drawn`). Site i
is the same in every call. Results are kept in OUT/results.jsonl, so that a stopped call goes on; OUT/table.md has a row
per site and what they come to. A map counts as bad beyond BAD_SURFACE_GSD or BAD_NORMALS_DEG. It should warn; a map
that is not bad should not. Views that were not registered are named, too; that is no warning of the map.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro

import photoclinometry as pcm
from outcomes import keep_outcome, read_outcomes, warning_codes
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.pipeline.checks.relief_check import relief_by_parallax
from photoclinometry.pipeline.products import RunResult
from photoclinometry.sfm.options import SfmOptions
from photoclinometry.simulate.camera_model import Detector
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.truth import truth_maps
from photoclinometry.simulate.truth_file import read_truth

SEED = 77_000
"""Of site 0; that of site i is i more."""
NO_ALARM = "view-unregistered"
"""Code of a warning that does not concern the map."""
BAD_SURFACE_GSD, BAD_NORMALS_DEG = 0.15, 4.0
"""Mean errors from which on a map counts as bad: two to three times those of typical sites."""
FIGURES = {
    "surface_distance_mean_gsd": ("surface [GSD]", 3),
    "normal_error_mean_deg": ("normals [deg]", 2),
    "albedo_error_mean_percent": ("albedo [%]", 2),
    "completeness_percent": ("complete [%]", 0),
    "height_sigma_within_68_percent": ("heights in 68 % [%]", 0),
    "height_sigma_within_95_percent": ("in 95 %", 0),
    "normal_sigma_within_68_percent": ("normals in 68 %", 0),
    "normal_sigma_within_95_percent": ("in 95 %", 0),
    "albedo_relative_sigma_within_68_percent": ("albedos in 68 %", 0),
    "height_sigma_nees": ("NEES of heights", 2),
    "normal_sigma_nees": ("of normals", 2),
    "relief_error_percent": ("relief over parallax, error [%]", 2),
    "relief_error_sigmas": ("in sigmas", 2),
    "psnr_mean_db": ("PSNR [dB]", 1),
}
"""Columns of the table, with heading and digits."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Quality of one map."""

    site: int
    simulation: str
    """The properties that were drawn, in short."""
    figures: dict[str, float] = field(default_factory=dict)
    """By the names of `phomo evaluate` and metrics.json; empty where there is no map."""
    warnings: tuple[str, ...] = ()
    """Their codes, and after a colon the view's name."""
    trusted: bool = False
    error: str = ""
    """Why there is no map."""
    cpu_s: float = 0.0

    @property
    def is_bad(self) -> bool:
        return not (
            self.figures.get("surface_distance_mean_gsd", np.inf) <= BAD_SURFACE_GSD
            and self.figures.get("normal_error_mean_deg", np.inf) <= BAD_NORMALS_DEG
        )

    @property
    def verdict(self) -> str:
        if self.error:
            return "no map"
        warned = any(not code.startswith(NO_ALARM) for code in self.warnings)
        if self.is_bad:
            return "warned" if warned else "SILENT"
        return "false alarm" if warned else "sound"


def drawn(i: int) -> SimulationOptions:
    """Options of site i."""
    rng = np.random.default_rng(SEED + i)

    def one_of(*choices):
        return choices[int(rng.integers(len(choices)))]

    size, seed = int(rng.integers(224, 337)), int(rng.integers(10**6))
    preset = one_of("demo", "cornelia", "ahuna", "ikapati")
    lighting = one_of("moderate", "moderate", "strong", "strong", "harsh")
    reflectance = one_of("hapke", "hapke", "hapke", "hapke", "minnaert", "akimov+", "mcewen")
    views, region = int(rng.integers(7, 14)), int(rng.integers(44, 76))
    brightness = one_of("iof", "dn")
    sun_sigma, sun_common_sigma = one_of(0.0573, 0.0573, 0.3), one_of(0.0, 0.0, 0.3)
    emission = one_of(15.0, 25.0, 35.0, 45.0)
    focal = one_of(9000.0, 9000.0, 4000.0, 2000.0, 20000.0)
    return SimulationOptions(
        preset=preset,
        lighting=lighting,
        seed=seed,
        views=views,
        image_size=size,
        region_size=region,
        intrinsics=(focal, focal, size / 2.0, size / 2.0),
        reflectance=reflectance,
        brightness=brightness,
        max_emission_deg=emission,
        sun_sigma_deg=sun_sigma,
        sun_common_sigma_deg=sun_common_sigma,
        detector=Detector(
            psf_sigma_px=one_of(0.5, 0.5, 0.7, 1.0),
            full_well_e=one_of(150_000.0, 40_000.0, 10_000.0),
            bits=one_of(14, 12, 10),
            hot_pixels=one_of(0.0, 0.0, 1e-3),
            smear_px=one_of(0.0, 0.0, 0.7),
        ),
    )


def in_short(options: SimulationOptions) -> str:
    """The properties that were drawn, for a cell of the table."""
    detector = options.detector
    assert options.intrinsics is not None
    parts = [
        f"{options.preset} {options.lighting} {options.reflectance} {options.brightness}",
        f"{options.views} x {options.image_size} px, f {options.intrinsics[0]:.0f}",
        f"emission {options.max_emission_deg:.0f}",
        f"PSF {detector.psf_sigma_px:g}, smear {detector.smear_px:g}, {detector.full_well_e / 1000:.0f} ke, "
        f"{detector.bits} bits",
        f"Suns {options.sun_sigma_deg:.2f}, {options.sun_common_sigma_deg:.2f}",
    ]
    return "; ".join(parts)


def mapped(i: int, out: Path, keep: bool) -> Outcome:
    """Site i simulated, mapped and compared with its truth."""
    options, folder = drawn(i), out / "sites" / f"{i:04d}"
    shutil.rmtree(folder, ignore_errors=True)
    simulate_site(options, folder / "site")
    begin = time.process_time()
    try:
        result = pcm.run(folder / "site" / "site.toml", folder / "run", sfm=SfmOptions(threads=1))  # reproducible
    except ReconstructionError as error:
        return Outcome(site=i, simulation=in_short(options), error=str(error))
    spent = time.process_time() - begin
    figures = _figures(result, folder)
    if not keep:
        shutil.rmtree(folder)
    return Outcome(
        site=i,
        simulation=in_short(options),
        figures=figures,
        warnings=warning_codes(result),
        trusted=result.trusted,
        cpu_s=round(spent, 1),
    )


def _figures(result: RunResult, folder: Path) -> dict[str, float]:
    """Those of FIGURES; none of a map that lies nowhere near the true ground."""
    truth = folder / "site" / "truth.h5"
    try:
        found = pcm.evaluate(folder / "run", truth=truth).metrics
    except InputError:
        return {}
    found |= result.metrics | _relief(result, truth)
    return {name: float(value) for name, value in found.items() if name in FIGURES}


def _relief(result: RunResult, truth_file: Path) -> dict[str, float]:
    """Difference between the relief over that of the parallax, as the run states it, and the relief over the true
    one."""
    scene, truth = result.scene, read_truth(truth_file)
    true = truth_maps(truth, scene.views.name[scene.reference], scene.region).position[scene.cells]
    known = np.isfinite(true).all(1)
    check = relief_by_parallax(scene, true[known], scene.landmarks.pixel[known])
    stated = result.metrics.get("relief_over_parallax_sigma")
    if check is None or stated is None:
        return {}
    error = result.metrics["relief_over_parallax"] - check.ratio
    return {"relief_error_percent": 100.0 * error, "relief_error_sigmas": error / stated}


def table(outcomes: list[Outcome]) -> str:
    """Markdown: a row per map, medians, and alarms."""
    head = ["site", *(heading for heading, _ in FIGURES.values()), "CPU s", "verdict", "warnings", "what was drawn"]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(FIGURES) + 1) + "---|" * 3]
    for each in sorted(outcomes, key=lambda outcome: outcome.site):
        cells = [str(each.site), *_cells(each.figures), f"{each.cpu_s:.0f}", each.verdict]
        codes = ", ".join(each.warnings) + ("" if each.trusted or each.error else "; not trusted")
        lines.append("| " + " | ".join([*cells, codes or each.error, each.simulation]) + " |")
    found = {
        name: [each.figures.get(name, np.nan) for each in outcomes if each.figures] or [np.nan] for name in FIGURES
    }
    for name, share in (("median", 50), ("90 %", 90), ("10 %", 10)):
        figures = {figure: float(np.percentile(values, share)) for figure, values in found.items()}
        lines.append("| " + " | ".join([name, *_cells(figures), "", "", "", ""]) + " |")
    verdicts = [each.verdict for each in outcomes]
    counts = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in sorted(set(verdicts)))
    name = "relief_error_sigmas"
    off = np.abs([each.figures[name] for each in outcomes if name in each.figures] or [np.nan])
    relief = f"right within its sigma in {np.mean(off <= 1):.0%}, within two in {np.mean(off <= 2):.0%}"
    return "\n".join(lines) + f"\n\n{len(outcomes)} sites: {counts}. Relief over parallax is {relief}.\n"


def _cells(figures: dict[str, float]) -> list[str]:
    return [f"{figures.get(name, np.nan):.{digits}f}" for name, (_, digits) in FIGURES.items()]


def main(out: Path, first: int = 0, count: int = 40, workers: int = 1, keep: bool = False) -> None:
    """Map sites drawn at random.

    Args:
        out: Folder for results, table and, meanwhile, sites and runs.
        first: The first site.
        count: How many sites.
        workers: Processes, of one thread each.
        keep: Keep sites and runs.
    """
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    file = out / "results.jsonl"
    known = {row["site"]: Outcome(**row) for row in read_outcomes(file)}
    wanted = [i for i in range(first, first + count) if i not in known]
    os.environ |= {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        for done in as_completed([pool.submit(mapped, i, out, keep) for i in wanted]):
            outcome = done.result()
            known[outcome.site] = outcome
            keep_outcome(file, outcome)
            (out / "table.md").write_text(table(list(known.values())), encoding="utf-8")
            print(f"{outcome.site}: {outcome.verdict}; {' '.join(_cells(outcome.figures))}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
