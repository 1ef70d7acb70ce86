"""What a run leaves: the adjusted scene, kept so that it is estimated once, and the files made from it."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.adjust import (
    Adjustment,
    AdjustOptions,
    ImageGradients,
    Iteration,
    Noise,
    PosePriors,
    TiePoints,
    adjust,
)
from photoclinometry.io.options import write_options
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Image, Scene, Views
from photoclinometry.pipeline import result_display
from photoclinometry.pipeline.pose_priors import prior_metrics, prior_table, warn_of_outliers
from photoclinometry.pipeline.run_folder import RunFolder

log = logging.getLogger(__name__)

Progress = Callable[[str, int, int], None]
"""Called as progress(what, done, total); total 0 where it is not known."""


@dataclass(frozen=True)
class RunResult:
    """What a run leaves."""

    scene: Scene
    adjustment: Adjustment
    metrics: dict[str, float]
    report: Path
    """The report's page."""
    left_out: dict[str, str]
    """Names of views that the map was made without, and why."""

    @property
    def folder(self) -> Path:
        """The run folder."""
        return self.report.parent.parent

    def __repr__(self) -> str:
        return result_display.result_line(self)

    def _repr_html_(self) -> str:
        return result_display.result_card(self)


@dataclass(frozen=True, kw_only=True)
class Kept:
    """That the adjusted scene of this key is in scene.h5, and how it was reached."""

    summary: str
    """JSON."""
    more: str
    """JSON of what else belongs to it."""


def adjust_or_read(
    folder: RunFolder,
    key: str,
    scene: Scene,
    options: AdjustOptions,
    progress: Progress,
    anchors: TiePoints | None = None,
) -> Adjustment:
    """The adjusted scene, from the run folder's scene.h5 if that is of this key, else estimated and kept there."""
    return kept_or_made(folder, key, lambda: (adjusted(scene, options, progress, anchors), {}))[0]


def adjusted(
    scene: Scene,
    options: AdjustOptions,
    progress: Progress,
    anchors: TiePoints | None = None,
    pose_priors: PosePriors | None = None,
    reflectance: Reflectance | None = None,
    slopes: ImageGradients | None = None,
) -> Adjustment:
    """`adjust`, with its steps reported."""
    steps = 0

    def count(iteration: Iteration) -> None:
        nonlocal steps
        steps += 1
        progress("adjust", steps, 0)

    return adjust(
        scene,
        options,
        tie_points=anchors,
        pose_priors=pose_priors,
        reflectance=reflectance,
        gradients=slopes,
        progress=count,
    )


def kept_or_made(
    folder: RunFolder, key: str, make: Callable[[], tuple[Adjustment, dict[str, Any]]]
) -> tuple[Adjustment, dict[str, Any]]:
    """The stage "adjust": the adjusted scene that scene.h5 holds if it is of this key, else made and kept there.

    With it goes, and comes back, whatever else can be written as JSON.
    """
    from photoclinometry.io.scene_file import read_scene, write_scene

    file = folder.path / "scene.h5"

    def keep() -> Kept:
        adjustment, more = make()
        # Were the run killed between the two files, the old key must not stand beside the new scene.
        folder.forget("adjust")
        write_scene(file, adjustment.scene)
        summary = {
            "converged": adjustment.converged,
            "message": adjustment.message,
            "log": [asdict(i) for i in adjustment.log],
            "noise": asdict(adjustment.noise),
            "parameter_sigma": adjustment.parameter_sigma.tolist(),
            "pose_priors_used": adjustment.pose_priors_used.tolist(),
        }
        return Kept(summary=json.dumps(summary), more=json.dumps(more))

    has_scene(folder)
    kept = folder.stage("adjust", key, keep, Kept)
    done = json.loads(kept.summary)
    scene = read_scene(file)
    return Adjustment(
        scene,
        done["converged"],
        done["message"],
        tuple(Iteration(**i) for i in done["log"]),
        Noise(**done["noise"]),
        scene.tracks.lit,
        np.array(done["parameter_sigma"]),
        np.array(done["pose_priors_used"], bool),
    ), json.loads(kept.more)


def has_scene(folder: RunFolder) -> bool:
    """Whether an earlier run left a whole scene.h5; a damaged one is warned of. Without, no estimate counts as kept."""
    from photoclinometry.io.scene_file import read_scene

    file = folder.path / "scene.h5"
    if file.is_file():
        try:
            read_scene(file)
        except RunFolderError as error:
            log.warning("%s; the stage is done again", error)
        else:
            return True
    folder.forget("adjust")
    return False


def write_products(
    folder: RunFolder,
    adjustment: Adjustment,
    images: Sequence[Image],
    config: Mapping[str, Any],
    left_out: Mapping[str, str],
    brought_in: Mapping[str, str] | None = None,
    held_out: Views | None = None,
    rounds: Sequence[Mapping[str, float]] = (),
    priors: Mapping[str, PosePrior] | None = None,
) -> RunResult:
    """landmarks.ply, sparse/, metrics.json and the report, of whatever images there are.

    config: what shaped the run, for the report; left_out: views that are not in the scene, and why;
    brought_in: views that are, though light differs too much for plain matching, and how they came in; held_out: views
    that the scene was not made from, in its frame; rounds: what each round of matching and adjusting brought; priors:
    of the poses of views (by name), if the scene is in their frame.
    """
    from photoclinometry.evaluate.evaluate import evaluate_scene, held_out_table, view_table
    from photoclinometry.evaluate.tables import json_numbers
    from photoclinometry.io.atomic import write_text
    from photoclinometry.io.meshes.ply import write_ply
    from photoclinometry.io.models.colmap import write_colmap
    from photoclinometry.output.report import write_report

    scene = adjustment.scene
    with folder.timed("products"):
        write_ply(folder.path / "landmarks.ply", scene, mesh=True)
        write_colmap(folder.path / "sparse", scene)
        rows = view_table(scene, images)
        aside = held_out_table(scene, held_out, images) if held_out else []
        metrics = evaluate_scene(scene, images, per_view=rows, held_out=aside)
        metrics |= {"views_left_out": len(left_out), "converged": float(adjustment.converged)}
        photometric = scene.reflectance is not None
        noise = {name: value for name, value in asdict(adjustment.noise).items() if np.isfinite(value)}
        metrics |= {name: value for name, value in noise.items() if photometric or not name.startswith("brightness")}
        metrics |= _parameter_metrics(adjustment)
        of_priors = prior_table(scene, priors or {}, adjustment.pose_priors_used)
        metrics |= prior_metrics(of_priors)
        warn_of_outliers(of_priors)
    with folder.timed("report"):
        brought_in = brought_in or {}
        how = {name: {"brought_in_by": way} for name, way in brought_in.items()}
        rows = [{"used": True, **row, **how.get(row["name"], {})} for row in rows + aside]
        rows += [{"name": name, "used": False, "left_out": reason} for name, reason in left_out.items()]
        page = write_report(
            folder.path / "report",
            scene,
            images,
            metrics=metrics,
            per_view=rows,
            stages=[asdict(stage) for stage in folder.stages],
            rounds=rounds,
            pose_priors=of_priors,
            convergence=[i.cost for i in adjustment.log if i.accepted],
            options=config,
            unit=scene.unit,
        )
    summary = {
        "metrics": json_numbers(metrics),
        "views": rows,
        "left_out": [{"name": name, "reason": reason} for name, reason in left_out.items()],
        "brought_in": [{"name": name, "by": way} for name, way in brought_in.items()],
        "rounds": [json_numbers(round_) for round_ in rounds],
        "frame": scene.frame,
        "pose_priors": of_priors,
        "stages": [asdict(stage) for stage in folder.stages],
        "message": adjustment.message,
    }
    write_text(folder.path / "metrics.json", json.dumps(summary, indent=2) + "\n")
    return RunResult(scene, adjustment, metrics, page, dict(left_out))


def _parameter_metrics(adjustment: Adjustment) -> dict[str, float]:
    """The reflectance parameters, where they were estimated, and their standard deviations, where these were."""
    metrics, model = {}, adjustment.scene.reflectance
    if model is not None and len(adjustment.parameter_sigma):
        for short, value, sigma in zip(
            model.parameter_names, model.parameters, adjustment.parameter_sigma, strict=True
        ):
            name = f"reflectance_{short}"
            metrics |= {name: float(value)} | ({f"{name}_sigma": float(sigma)} if np.isfinite(sigma) else {})
    return metrics


def write_config(folder: RunFolder, config: Mapping[str, Any]) -> None:
    """config.toml: what was mapped, and every option, defaults included."""
    write_options(folder.path / "config.toml", config)
