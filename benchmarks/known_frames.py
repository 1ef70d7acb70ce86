"""Maps in a known frame: place, attitude and scale by pose priors, laser altimetry or control points, and wrong ones.

    python benchmarks/known_frames.py --out frames --seeds 3

Each site is mapped with pose priors alone, with tracks of an altimeter besides, and with control points in place of
both; then with shots, a track and a point that are wrong. Rows have the error of the map's frame, over the sigma that
the run states in brackets, its surface and normals, and warnings. OUT/table.md grows as the maps are made.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro

import photoclinometry as pcm
from outcomes import accuracy_cells
from photoclinometry.io.altimetry_csv import read_altimetry, write_altimetry
from photoclinometry.io.csv_columns import write_csv
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.geometry import align_similarity, so3_log
from photoclinometry.model.scene import Scene
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.products import RunResult
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.truth import Truth, truth_maps
from photoclinometry.simulate.truth_file import read_truth

SIZE = {"views": 8, "image_size": 256, "region_size": 64}
PLACES = (("demo", "moderate"), ("demo", "strong"), ("ahuna", "moderate"))
SHOT_M, TRACK_M = 5.0, 20.0
"""Standard deviations of a shot's height and of a track's shift, at ground samples of 35 to 61 m."""
WRONG_SHARE, WRONG_M, WRONG_TRACK_M = 0.1, 300.0, 400.0
"""Share of shots that are wrong, by how much, and by how much one track is."""
POINTS, POINT_M, POINT_PX = 6, 10.0, 0.3
"""Control points, and standard deviations of their positions along each axis and of their pixels."""

Options = Callable[[Path, np.random.Generator], RunOptions]
"""Options of a run of a site (its file), with what is drawn at random."""


def shots(spoil: Callable[[AltimeterTracks, np.random.Generator], AltimeterTracks]) -> Options:
    """Altimetry that was changed."""

    def options(site: Path, rng: np.random.Generator) -> RunOptions:
        table = site.with_name("given.csv")
        write_altimetry(table, spoil(read_altimetry(site.with_name("altimetry.csv")), rng))
        return RunOptions(altimetry=table)

    return options


def wrong_shots(tracks: AltimeterTracks, rng: np.random.Generator) -> AltimeterTracks:
    """One shot in ten is off by WRONG_M along z."""
    which = rng.random(len(tracks)) < WRONG_SHARE
    return replace(tracks, position=tracks.position + np.where(which, WRONG_M, 0.0)[:, None] * [0.0, 0.0, 1.0])


def wrong_track(tracks: AltimeterTracks, _: np.random.Generator) -> AltimeterTracks:
    """One track is off by WRONG_TRACK_M along z."""
    wrong = np.where(tracks.track == 2, WRONG_TRACK_M, 0.0)
    return replace(tracks, position=tracks.position + wrong[:, None] * [0.0, 0.0, 1.0])


def points(wrong_m: float) -> Options:
    """Control points in all views, without pose priors; the second is off by `wrong_m` along x."""

    def options(site: Path, rng: np.random.Generator) -> RunOptions:
        truth = read_truth(site.with_name("truth.h5"))
        place = rng.uniform(-0.4, 0.4, (POINTS, 2)) * SIZE["region_size"] * truth.views.gsd(0, np.zeros((1, 3)))
        true = np.column_stack([place, truth.surface.height_at(place)])
        known = true + POINT_M * rng.normal(size=true.shape)
        known[1, 0] += wrong_m
        rows: dict[str, list] = {name: [] for name in ("point", "view", "x_px", "y_px", "x_m", "y_m", "z_m")}
        for n in range(POINTS):
            for k, view in enumerate(truth.views.name):
                x, y = truth.views.project(k, true[n : n + 1])[0] + POINT_PX * rng.normal(size=2)
                for name, value in zip(rows, (f"P{n}", view, x, y, *known[n]), strict=True):
                    rows[name].append(value)
        sigmas = {"sigma_m": [POINT_M] * len(rows["point"]), "sigma_px": [POINT_PX] * len(rows["point"])}
        write_csv(site.with_name("points.csv"), {**rows, **sigmas})
        return RunOptions(control=site.with_name("points.csv"), pose_priors=False)

    return options


CASES: dict[str, Options] = {
    "priors": lambda *_: RunOptions(),
    "altimetry": shots(lambda tracks, _: tracks),
    "a tenth of the shots wrong": shots(wrong_shots),
    "one track wrong": shots(wrong_track),
    "control": points(0.0),
    "one point wrong": points(500.0),
}


def main(out: Path, seeds: int = 3, common: bool = False, only: tuple[str, ...] = ()) -> None:
    """Map sites in known frames.

    Args:
        out: Folder for the table and, meanwhile, sites and runs.
        seeds: Sites of each place and lighting.
        common: Give all pose priors of a site an error in common, of 0.02 degrees and 600 m.
        only: Of the cases only these.
    """
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    lines = ["| site | given | place [m] (sigmas) | attitude [deg] (sigmas) | scale [%] (sigmas) | surface [GSD] | "
             "normals [deg] | PSNR [dB] | warnings |", "|---" * 9 + "|"]  # fmt: skip
    shared = (0.02, 600.0) if common else None
    for seed in range(seeds):
        for preset, lighting in PLACES:
            options = SimulationOptions(
                preset=preset, lighting=lighting, seed=100 + seed, pose_sigma=(0.03, 640.0), pose_common_sigma=shared,
                altimetry=(SHOT_M, TRACK_M), **SIZE,
            )  # fmt: skip
            shutil.rmtree(out / "site", ignore_errors=True)
            site = simulate_site(options, out / "site")
            for case, given in CASES.items():
                if only and case not in only:
                    continue
                result = pcm.run(site, out / "run", options=given(site, np.random.default_rng(seed)), overwrite=True)
                lines.append(f"| {preset} {lighting} {seed} | {case} | {_row(result, site)} |")
                print(lines[-1], flush=True)
                (out / "table.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for name in ("site", "run"):
        shutil.rmtree(out / name, ignore_errors=True)


def _row(result: RunResult, site: Path) -> str:
    codes = " ".join(sorted({warned.code for warned in result.warnings}))
    truth = site.with_name("truth.h5")
    frame = _frame(result.scene, result.metrics, read_truth(truth))
    return f"{frame} | {accuracy_cells(result, truth, site)} | {codes}"


def _frame(scene: Scene, stated: dict[str, float], truth: Truth) -> str:
    """Cells: by how much the landmarks are shifted, turned and scaled from the true places behind their pixels."""
    true = truth_maps(truth, scene.views.name[scene.reference], scene.region).position[scene.cells]
    known = np.isfinite(true).all(1)
    found, true = scene.landmarks.position[known], true[known]
    fit = align_similarity(found, true)
    place = float(np.linalg.norm(found.mean(0) - true.mean(0)))
    turned, scaled = float(np.degrees(np.linalg.norm(so3_log(fit.rotation)))), 100.0 * abs(1.0 / fit.scale - 1.0)
    errors = {"offset": (place, "m", 1), "turn": (turned, "deg", 4), "scale": (scaled, "percent", 4)}
    return " | ".join(
        f"{error:.{digits}f} ({error / stated[f'frame_{name}_sigma_{unit}']:.2f})"
        for name, (error, unit, digits) in errors.items()
    )


if __name__ == "__main__":
    tyro.cli(main)
