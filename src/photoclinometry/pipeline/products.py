"""What a run leaves: scene, map, poses, figures and report."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.adjust import Adjustment
from photoclinometry.evaluate.diagnosis import Diagnosis, diagnosis
from photoclinometry.evaluate.verdict import Judged, Judgement, why_with_care
from photoclinometry.io.run_files import LANDMARKS_FILE, METRICS_FILE, POSES_FOLDER, REPORT_FOLDER, SCENE_FILE
from photoclinometry.model.control import ControlPoint
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Image, Scene, Views
from photoclinometry.pipeline import result_display
from photoclinometry.pipeline.altimetry import (
    altimetry_metrics,
    altimetry_table,
    warn_of_altimetry,
    write_shots,
)
from photoclinometry.pipeline.blurred_views import warn_of_blurred_views
from photoclinometry.pipeline.control import control_metrics, control_table, warn_of_contradictions
from photoclinometry.pipeline.dark_level_check import warn_of_dark_level
from photoclinometry.pipeline.moved_suns import warn_of_suns
from photoclinometry.pipeline.pose_priors import (
    changes_beside_priors,
    prior_metrics,
    prior_table,
    warn_of_outliers,
)
from photoclinometry.pipeline.relief_check import ReliefCheck, warn_of_relief
from photoclinometry.pipeline.relighting import IterationFigures
from photoclinometry.pipeline.rendering_check import OFF, warn_of_renderings
from photoclinometry.pipeline.response_check import ResponseCheck
from photoclinometry.pipeline.run_folder import RunFolder
from photoclinometry.pipeline.trust import brightness_off, change_explained, why_untrusted

log = logging.getLogger(__name__)

Row = dict[str, Any]
"""Of a table, by name of column."""


@dataclass(frozen=True)
class RunResult(Judged):
    """What a run leaves."""

    scene: Scene
    """The map, as in `scene.h5`."""
    adjustment: Adjustment
    """Of the last estimate."""
    metrics: dict[str, float]
    """As in `metrics.json`, where units end the names."""
    report: Path
    """The report's page."""
    left_out: dict[str, str]
    """Names of views that the map was made without, and why."""
    judgement: Judgement
    """Whether the map is to be trusted; its parts are attributes of the result, too."""

    @property
    def folder(self) -> Path:
        """The run folder."""
        return self.report.parent.parent

    def __repr__(self) -> str:
        return result_display.result_line(self)

    def _repr_html_(self) -> str:
        return result_display.result_card(self)


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """What is known of a run when its map is finished. Without images there are no renderings beside them."""

    adjustment: Adjustment
    images: Sequence[Image] = ()
    config: Mapping[str, Any]
    """What shaped the run."""
    left_out: Mapping[str, str]
    """Names of views that are not in the scene, and why."""
    brought_in: Mapping[str, str] = field(default_factory=dict)
    """Names of views that are, though light differs too much for plain matching, and how they came in."""
    held_out: Views | None = None
    """Views that the scene was not made from, in its frame."""
    iterations: Sequence[IterationFigures] = ()
    """Of the first map and of each relighting iteration."""
    pose_priors: Mapping[str, PosePrior] = field(default_factory=dict)
    """Of views (by name), if the scene is in their frame."""
    control: Sequence[ControlPoint] = ()
    """Ground control points."""
    altimetry: bool = False
    """Whether the run was given laser altimetry."""
    relief: ReliefCheck | None = None
    """Of the map beside the parallax of the images; None where it was not looked at."""
    psf_sigma_px: float | None = None
    """Standard deviation of the point-spread function with which fine relief was restored; None where it was not."""
    response: ResponseCheck | None = None
    """Whether images are linear; None where it was not looked at."""


@dataclass(frozen=True, kw_only=True)
class _Tables:
    """The figures of a run: all in all, per view, per pose prior, per control point, per altimeter track."""

    metrics: dict[str, float]
    views: list[Row]
    pose_priors: list[Row]
    control: list[Row]
    altimetry: list[Row]
    judgement: Judgement
    diagnosis: Diagnosis


def write_products(folder: RunFolder, summary: RunSummary) -> RunResult:
    """scene.h5, landmarks.ply, sparse/, altimetry.csv of altimetry, metrics.json and the report."""
    from photoclinometry.io.meshes.ply import write_ply
    from photoclinometry.io.models.colmap import write_colmap
    from photoclinometry.io.scene_file import write_scene

    adjustment, scene = summary.adjustment, summary.adjustment.scene
    with folder.timed("products"):
        write_scene(folder.path / SCENE_FILE, scene)
        write_ply(folder.path / LANDMARKS_FILE, scene, mesh=True)
        write_colmap(folder.path / POSES_FOLDER, scene)
        write_shots(folder.path, adjustment.altimetry)
        tables = _tables(folder, summary)
    with folder.timed("report"):
        page = _write_report(folder, summary, tables)
    _write_metrics(folder, summary, tables)
    log_verdict(tables.judgement)
    return RunResult(
        scene=scene,
        adjustment=adjustment,
        metrics=tables.metrics,
        report=page,
        left_out=dict(summary.left_out),
        judgement=tables.judgement,
    )


def log_verdict(judgement: Judgement) -> None:
    """The verdict on a map, and its reasons, in the log."""
    log.info("verdict: %s", judgement.verdict)
    for reason in judgement.reasons:
        log.info("%s: %s", judgement.verdict, reason)


def _tables(folder: RunFolder, summary: RunSummary) -> _Tables:
    from photoclinometry.evaluate.evaluate import evaluate_scene, held_out_table, view_table

    adjustment, scene, images = summary.adjustment, summary.adjustment.scene, summary.images
    used = view_table(scene, images)
    aside = held_out_table(scene, summary.held_out, images) if summary.held_out else []
    of_priors = prior_table(scene, summary.pose_priors, adjustment.pose_priors_used)
    warn_of_outliers(of_priors)
    of_control = control_table(summary.control, adjustment.control, scene.views)
    warn_of_contradictions(of_control)
    of_altimetry = altimetry_table(adjustment.altimetry)
    warn_of_altimetry(of_altimetry, given=summary.altimetry)
    warn_of_suns(scene)
    warn_of_relief(summary.relief)
    warn_of_blurred_views(scene)
    warn_of_dark_level(scene, images)
    metrics = evaluate_scene(scene, images, per_view=used, held_out=aside)
    if scene.reflectance is not None:
        metrics["brightness_change_explained_percent"] = 100.0 * change_explained(scene)
        metrics[OFF] = 100.0 * brightness_off(scene)
    warn_of_renderings(metrics)
    metrics |= {"views_left_out": len(summary.left_out), "converged": float(adjustment.converged)}
    metrics |= _noise_metrics(adjustment) | _parameter_metrics(adjustment) | prior_metrics(of_priors)
    metrics |= control_metrics(of_control) | _frame_metrics(adjustment.frame_covariance)
    if any(row["used"] for row in of_control):
        metrics |= changes_beside_priors(scene, summary.pose_priors, adjustment.pose_priors_used, "control")
    if adjustment.altimetry is not None:
        metrics |= altimetry_metrics(adjustment.altimetry, scene, summary.pose_priors, adjustment.pose_priors_used)
    if summary.relief is not None:
        metrics |= summary.relief.metrics()
    if summary.psf_sigma_px is not None:
        metrics["psf_sigma_px"] = summary.psf_sigma_px
    if summary.response is not None:
        metrics |= summary.response.metrics()
    how = {name: {"brought_in_by": way} for name, way in summary.brought_in.items()}
    views = [{"used": True, **row, **how.get(row["name"], {})} for row in used + aside]
    views += [{"name": name, "used": False, "left_out": reason} for name, reason in summary.left_out.items()]
    warnings = folder.warnings
    return _Tables(
        metrics=metrics,
        views=views,
        pose_priors=of_priors,
        control=of_control,
        altimetry=of_altimetry,
        judgement=Judgement(
            warnings=warnings,
            distrust=why_untrusted(adjustment, len(summary.left_out), warnings, summary.relief),
            care=tuple(why_with_care(scene, metrics)),
        ),
        diagnosis=diagnosis(scene),
    )


def _write_report(folder: RunFolder, summary: RunSummary, tables: _Tables) -> Path:
    from photoclinometry.output import report
    from photoclinometry.output.report.curves import cost_by_reweighting

    content = report.ReportContent(
        metrics=tables.metrics,
        per_view=tables.views,
        stages=[asdict(cost) for cost in folder.costs],
        iterations=[figures.as_row() for figures in summary.iterations],
        pose_priors=tables.pose_priors,
        known_poses=summary.pose_priors,
        control=tables.control,
        altimetry=tables.altimetry,
        shots=summary.adjustment.altimetry,
        convergence=cost_by_reweighting(summary.adjustment.log),
        options=summary.config,
        judgement=tables.judgement,
        diagnosis=tables.diagnosis,
    )
    return report.write_report(folder.path / REPORT_FOLDER, summary.adjustment.scene, summary.images, content)


def _write_metrics(folder: RunFolder, summary: RunSummary, tables: _Tables) -> None:
    from photoclinometry.io.json_file import write_json

    content = {
        **tables.judgement.as_json(),
        "metrics": tables.metrics,
        "diagnosis": tables.diagnosis,
        "views": tables.views,
        "left_out": [{"name": name, "reason": reason} for name, reason in summary.left_out.items()],
        "brought_in": [{"name": name, "by": way} for name, way in summary.brought_in.items()],
        "relighting_iterations": [figures.as_row() for figures in summary.iterations],
        "frame": summary.adjustment.scene.frame,
        "pose_priors": tables.pose_priors,
        "control_points": tables.control,
        "altimetry": tables.altimetry,
        "stages": [asdict(cost) for cost in folder.costs],
        "message": summary.adjustment.message,
    }
    write_json(folder.path / METRICS_FILE, content, indent=2)


def _frame_metrics(covariance: np.ndarray) -> dict[str, float]:
    """How well the map's place, attitude and scale in a known frame are known. covariance: (7, 7), or empty."""
    if not covariance.size:
        return {}
    variance = np.diag(covariance)
    return {
        "frame_turn_sigma_deg": float(np.degrees(np.sqrt(variance[:3].sum()))),
        "frame_offset_sigma_m": float(np.sqrt(variance[3:6].sum())),
        "frame_scale_sigma_percent": 100.0 * float(np.sqrt(variance[6])),
    }


def _noise_metrics(adjustment: Adjustment) -> dict[str, float]:
    """What the errors of measurements were found to be; those of brightness only where it was used."""
    photometric = adjustment.scene.reflectance is not None
    noise = {name: value for name, value in asdict(adjustment.noise).items() if np.isfinite(value)}
    return {name: value for name, value in noise.items() if photometric or not name.startswith("brightness")}


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
