"""Accuracy of the forecasts of `phomo plan`: plans from geometry alone, compared with the sigmas and errors of runs.

    python benchmarks/plan.py --out plans                    six small sites, an hour on a busy core, then minutes
    python benchmarks/plan.py --out plans --only few hapke

Sites are simulated, mapped and measured once, in OUT/NAME. The plan has their true poses and Suns, and no images. Its
ground is a fractal with craters and boulders of an assumed slope, the true one is another: part of a big crater or a
dome. It is planned twice, with the default slope, and with the RMS slope that the mapped ground has.

For heights, normals and albedos: medians over the map of the planned sigma, of the sigma that the run states, and the
plan over the run; then the median error against the truth over what the planned sigma makes one expect (0.674 of a
sigma along one axis, 0.833 of that of a direction, in both of its axes). 1 is right, TARGET the aim. Heights in the
frame of pose priors have no such error: an evaluation measures them after the best alignment.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tyro

import photoclinometry as pcm
from photoclinometry.evaluate.sigmas import landmark_sigmas
from photoclinometry.io.json_file import write_json
from photoclinometry.io.site import Site, read_site
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Scene
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.plan.forecast import KINDS
from photoclinometry.plan.options import PlanOptions
from photoclinometry.plan.run import Plan, plan_site
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.truth import Truth, truth_maps
from photoclinometry.simulate.truth_file import read_truth

TARGET = 0.3
"""A plan is to be within this share of the run."""
ERRORS = {
    "height": ("position_error_along_normal_median_gsd", 0.6745),
    "normal": ("normal_error_median_deg", 0.8326),
    "albedo": ("albedo_error_median_percent", 0.6745),
}
"""Median errors of an evaluation, and what a median error of Gaussian errors is over their sigma."""
_SIZE = {"image_size": 256, "region_size": 64}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One site and its run."""

    simulation: SimulationOptions
    run: RunOptions = field(default_factory=RunOptions)


CASES = {
    "moderate": Case(simulation=SimulationOptions(**_SIZE, views=10)),
    "strong": Case(simulation=SimulationOptions(**_SIZE, views=10, seed=1, lighting="strong")),
    "few": Case(simulation=SimulationOptions(**_SIZE, views=6, seed=2), run=pcm.preset("few-views")),
    "hapke": Case(simulation=SimulationOptions(**_SIZE, views=10, seed=3, preset="ahuna", reflectance="hapke")),
    "hapke-strong": Case(
        simulation=SimulationOptions(
            **_SIZE, views=9, seed=4, preset="cornelia", reflectance="hapke", lighting="strong"
        )
    ),
    "priors": Case(simulation=SimulationOptions(**_SIZE, views=8, seed=5, pose_sigma=(0.01, 50.0))),
}


def geometry_of(site: Site, truth: Truth) -> Site:
    """The site with its true poses and Suns, known as well as its priors are."""
    views = []
    for k, view in enumerate(site.views):
        pose, prior = truth.views.body_from_cam[k], view.pose_prior
        sigmas = (np.inf, np.inf) if prior is None else (prior.rotation_sigma_rad, prior.translation_sigma)
        views.append(
            replace(view, sun=truth.views.sun[k] @ pose.rotation, pose_prior=PosePrior(pose.inverse(), *sigmas))
        )
    return replace(site, views=tuple(views))


def slope_of(truth: Truth, scene: Scene) -> float:
    """RMS slope of the mapped ground against its mean plane, pixel by pixel [deg]."""
    maps = truth_maps(truth, scene.views.name[scene.reference], scene.region)
    normal = maps.normal_mean[maps.hit]
    slope = normal[:, :2] / normal[:, 2:]
    return float(np.degrees(np.arctan(np.sqrt(np.mean(np.sum((slope - slope.mean(0)) ** 2, -1))))))


def planned(case: Case, site: Site, truth: Truth, slope_deg: float) -> Plan:
    """The plan at the origin of the site's frame, of ground with the reflectance that is simulated."""
    options = PlanOptions(
        point=(0.0, 0.0, 0.0),
        normal=(0.0, 0.0, 1.0),
        slope_deg=slope_deg,
        ground=case.simulation.reflectance,
        min_views=case.run.densify.min_views,
    )
    return plan_site(geometry_of(site, truth), options, with_candidates=False)


def medians(plan: Plan) -> dict[str, float]:
    """Planned sigmas by kind, in the frame of the priors where there are such, as the run states them."""
    found = plan.forecast.in_frame or plan.forecast.sigmas()
    return {kind: float(np.median(values)) for kind, values in found.items()}


def mapped(folder: Path, case: Case) -> tuple[Path, Path]:
    """The site and the run, made where they are missing."""
    site, run = folder / "site" / "site.toml", folder / "run"
    if not site.is_file():
        pcm.simulate(case.simulation, site.parent)
    if not (run / "evaluation" / "evaluation.json").is_file():
        pcm.run(site, run, options=case.run)
        metrics = pcm.evaluate(run, truth=site.parent / "truth.h5", images=False).metrics
        write_json(run / "evaluation" / "evaluation.json", metrics)
    return site, run


def compared(folder: Path, case: Case) -> dict[str, dict[str, float]]:
    """By assumed slope ("default", "true"): planned and stated medians by kind, and errors over expected ones."""
    site_file, run = mapped(folder, case)
    site, truth, scene = read_site(site_file), read_truth(site_file.parent / "truth.h5"), pcm.read_scene(run)
    errors = json.loads((run / "evaluation" / "evaluation.json").read_text())
    stated = {kind: float(np.median(landmark_sigmas(scene)[name])) for kind, name in KINDS.items()}
    out = {}
    for which, slope in (("default", PlanOptions().slope_deg), ("true", slope_of(truth, scene))):
        plan = planned(case, site, truth, slope)
        row = {"slope_deg": slope}
        for kind, value in medians(plan).items():
            name, share = ERRORS[kind]
            row |= {f"{kind}_plan": value, f"{kind}_run": stated[kind], f"{kind}_ratio": value / stated[kind]}
            in_frame = plan.forecast.pose_priors is not None
            row[f"{kind}_error_ratio"] = np.nan if in_frame and kind == "height" else errors[name] / (share * value)
        out[which] = row
    return out


def table(found: dict[str, dict[str, dict[str, float]]]) -> list[str]:
    """Lines of 79 columns; ratios outside of the target are marked (*)."""
    lines = [
        f"{'':21}{'height [GSD]':^19}{'normal [deg]':^20}{'albedo [%]':^19}",
        f"{'site':13}{'slope':>6}  " + "".join(f"{'plan':>6}{'/run':>6}{'err':>6}  " for _ in KINDS),
    ]
    for name, rows in found.items():
        for row in rows.values():
            cells = "".join(
                f"{row[f'{kind}_plan']:6.3g}{row[f'{kind}_ratio']:5.2f}{_mark(row[f'{kind}_ratio'])}"
                f"{_number(row[f'{kind}_error_ratio'])}  "
                for kind in KINDS
            )
            lines.append(f"{name:13}{row['slope_deg']:6.1f}  {cells}")
    return lines


def _number(value: float) -> str:
    return f"{value:6.2f}" if np.isfinite(value) else f"{'-':>6}"


def _mark(ratio: float) -> str:
    return " " if 1.0 - TARGET <= ratio <= 1.0 + TARGET else "*"


def main(out: Path, only: Sequence[str] = tuple(CASES)) -> None:
    """Plans the sites and prints the table; OUT/plan.json has its numbers."""
    found = {}
    for name in only:
        found[name] = compared(out / name, CASES[name])
        print("\n".join(table({name: found[name]})[(0 if name == only[0] else 2) :]), flush=True)
    write_json(out / "plan.json", found)


if __name__ == "__main__":
    tyro.cli(main)
