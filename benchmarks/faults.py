"""Maps clean sites with faults put into them, and tabulates which faults spoil a map, and whether the run warns of it.

    python benchmarks/faults.py --out faults                              thirteen faults on six simulated sites
    python benchmarks/faults.py --out faults --vesta SITE_FOLDER --draws 3    and on a site of real images

A fault is silent where the relief of the map is more than OFF beside that of the clean map, and no warning was given
that the clean map lacks. So is one that calibration could take out (CALIBRATED) where the surface is more than WORSE
times as far from the truth. Results are kept in
OUT/results.jsonl, so that a stopped call goes on; OUT/table.md has the table.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

import photoclinometry as pcm
from image_faults import FAULTS, read_images, write_spoiled
from outcomes import keep_outcome, read_outcomes, warning_codes
from photoclinometry.io.site import RegionRequest, read_site
from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.scene import Scene
from photoclinometry.pipeline.checks.relief_check import relief_by_parallax
from photoclinometry.sfm.options import SfmOptions
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site

OFF = 0.05
"""Share of relief."""
WORSE = 1.5
"""Times the surface's distance from the truth."""
CALIBRATED = ("gamma", "distortion", "vignetting", "focal", "gradient")
SIZE = {"views": 10, "image_size": 320, "region_size": 96, "reflectance": "hapke"}
SITES = {
    "moderate": SimulationOptions(**SIZE, seed=11),
    "strong": SimulationOptions(**SIZE, seed=12, lighting="strong"),
    "ceres": SimulationOptions(**SIZE, seed=13, preset="ahuna"),
    "crater": SimulationOptions(**SIZE, seed=14, preset="cornelia", lighting="strong"),
    "uncalibrated": SimulationOptions(**SIZE, seed=15, brightness="dn"),
    "few": SimulationOptions(**(SIZE | {"views": 6}), seed=16),
}
VESTA_REGION_PX = 220
CLEAN = "clean"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Quality of one map."""

    site: str
    fault: str
    draw: int
    relief: float | None = None
    """Over that of the clean map; None where there is no map."""
    surface_gsd: float | None = None
    """Mean distance of the surface from the truth [GSD]; None without truth."""
    normals_deg: float | None = None
    psnr_db: float | None = None
    heights_nees: float | None = None
    normals_nees: float | None = None
    """Mean squares of the errors over those stated, 1 where sigmas hold; None without truth."""
    warnings: tuple[str, ...] = ()
    """Their codes, and after a colon the view's name."""
    trusted: bool = False
    error: str = ""
    """Why there is no map."""

    @property
    def key(self) -> tuple[str, str, int]:
        return self.site, self.fault, self.draw


def main(
    out: Path, vesta: Path | None = None, draws: int = 1, only_sites: str = "", only_faults: tuple[str, ...] = ()
) -> None:
    """Map sites with faults.

    Args:
        out: Folder for sites, results and table.
        vesta: Folder of a site of real images, such as four of Vesta.
        draws: How often each fault is drawn on the real site; on simulated ones once.
        only_sites: Only the site of this name.
        only_faults: Only these faults.
    """
    out = out.resolve()
    file = out / "results.jsonl"
    out.mkdir(parents=True, exist_ok=True)
    known = {outcome.key: outcome for outcome in (Outcome(**row) for row in read_outcomes(file))}
    for name in [*SITES, *(["vesta"] if vesta else [])]:
        if only_sites in ("", name):
            folder = _simulated(out, name) if name in SITES else vesta
            assert folder is not None
            for fault in (CLEAN, *(only_faults or FAULTS)):
                for draw in range(draws if name == "vesta" and fault != CLEAN else 1):
                    if (name, fault, draw) not in known:
                        outcome = spoiled_map(name, folder.resolve(), fault, draw, out)
                        known[outcome.key] = outcome
                        keep_outcome(file, outcome)
                        (out / "table.md").write_text(table(list(known.values())), encoding="utf-8")
                        print(_row(outcome, known), flush=True)


def spoiled_map(name: str, folder: Path, fault: str, draw: int, out: Path) -> Outcome:
    """The map of a site with a fault, compared with that of the clean site."""
    run, spoiled = out / "runs" / name / f"{fault}-{draw}", out / "spoiled" / name
    site_file, mapped = folder / "site.toml", None if fault == CLEAN else _clean_map(out, name)
    if fault != CLEAN or name not in SITES:
        site = read_site(site_file)
        images = read_images(site)
        if fault != CLEAN:
            images = FAULTS[fault](images, np.random.default_rng([draw, *map(ord, fault)]))
        whole = RegionRequest(size_px=(VESTA_REGION_PX, VESTA_REGION_PX))
        site_file = write_spoiled(images, site, spoiled, whole if mapped is None else region_of(mapped))
    try:
        result = pcm.run(
            site_file,
            run,
            sfm=SfmOptions(threads=1),  # reproducible
            densify=DensifyOptions(min_views=3 if name == "vesta" else 4),
            overwrite=True,
        )
    except ReconstructionError as error:
        return Outcome(site=name, fault=fault, draw=draw, error=str(error))
    scene, figures = result.scene, {}
    truth = folder / "truth.h5"
    if truth.is_file():
        figures = pcm.evaluate(scene, truth=truth, site=folder / "site.toml").metrics
    clean = scene if mapped is None else mapped
    relief = relief_by_parallax(scene, clean.landmarks.position, clean.landmarks.pixel)
    outcome = Outcome(
        site=name,
        fault=fault,
        draw=draw,
        relief=None if relief is None else relief.ratio,
        surface_gsd=figures.get("surface_distance_mean_gsd"),
        normals_deg=figures.get("normal_error_mean_deg"),
        psnr_db=result.metrics["psnr_mean_db"],
        heights_nees=figures.get("height_sigma_nees"),
        normals_nees=figures.get("normal_sigma_nees"),
        warnings=warning_codes(result),
        trusted=result.trusted,
    )
    if fault != CLEAN:
        shutil.rmtree(run)
    shutil.rmtree(spoiled, ignore_errors=True)
    return outcome


def table(outcomes: list[Outcome]) -> str:
    """Markdown, a row per map."""
    known = {outcome.key: outcome for outcome in outcomes}
    head = ["site", "fault", "relief", "surface [GSD]", "normals [deg]", "PSNR [dB]"]
    head += ["NEES of heights", "of normals", "warnings", "verdict"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *(_row(outcome, known) for outcome in outcomes)]) + "\n"


def verdict(outcome: Outcome, clean: Outcome) -> str:
    """Whether a fault mattered, and whether the run warned of it."""
    if outcome.error:
        return "no map"
    spoilt = outcome.relief is None or abs(outcome.relief - 1.0) > OFF
    if outcome.fault in CALIBRATED and outcome.surface_gsd is not None and clean.surface_gsd is not None:
        spoilt |= outcome.surface_gsd > WORSE * clean.surface_gsd
    warned = bool(set(outcome.warnings) - set(clean.warnings)) or (clean.trusted and not outcome.trusted)
    if outcome.fault == CLEAN:
        return "false alarm" if outcome.warnings else "sound"
    return {(True, True): "warned", (True, False): "SILENT", (False, True): "harmless, warned"}.get(
        (spoilt, warned), "harmless"
    )


def _row(outcome: Outcome, known: dict[tuple[str, str, int], Outcome]) -> str:
    cells = [outcome.site, outcome.fault + (f" {outcome.draw}" if outcome.draw else "")]
    cells += [
        "–" if value is None else f"{value:.{digits}f}"
        for value, digits in (
            (outcome.relief, 3),
            (outcome.surface_gsd, 3),
            (outcome.normals_deg, 2),
            (outcome.psnr_db, 1),
            (outcome.heights_nees, 2),
            (outcome.normals_nees, 2),
        )
    ]
    cells.append(", ".join(outcome.warnings) + ("" if outcome.trusted or outcome.error else "; not trusted"))
    cells.append(verdict(outcome, known[outcome.site, CLEAN, 0]))
    return "| " + " | ".join(cells) + " |"


def _clean_map(out: Path, name: str) -> Scene:
    return pcm.read_scene(out / "runs" / name / f"{CLEAN}-0")


def _simulated(out: Path, name: str) -> Path:
    folder = out / name
    if not (folder / "site.toml").is_file():
        simulate_site(SITES[name], folder)
    return folder


def region_of(mapped: Scene) -> RegionRequest:
    """The region of a map, so that another map of the site has the same."""
    region = mapped.region
    return RegionRequest(
        reference=mapped.views.name[mapped.reference],
        center_px=(region.col + region.width / 2.0, region.row + region.height / 2.0),
        size_px=(region.width, region.height),
        stride=region.stride,
    )


if __name__ == "__main__":
    tyro.cli(main)
