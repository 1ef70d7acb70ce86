"""The products of a run: scene, map, poses, figures and report."""

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
from photoclinometry.io.run_files import (
    HELD_OUT_FILE,
    LANDMARKS_FILE,
    METRICS_FILE,
    POSES_FOLDER,
    REPORT_FOLDER,
    SCENE_FILE,
)
from photoclinometry.model.control import ControlPoint
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Scene, Views
from photoclinometry.model.warning import Warned
from photoclinometry.pipeline import result_display
from photoclinometry.pipeline.checks.blurred_views import warn_of_blurred_views
from photoclinometry.pipeline.checks.dark_level_check import warn_of_dark_level
from photoclinometry.pipeline.checks.moved_suns import warn_of_suns
from photoclinometry.pipeline.checks.relief_check import ReliefCheck, warn_of_relief
from photoclinometry.pipeline.checks.rendering_check import OFF, warn_of_renderings
from photoclinometry.pipeline.folder.run_folder import RunFolder
from photoclinometry.pipeline.frame.altimetry import (
    TrackRow,
    altimetry_metrics,
    altimetry_table,
    warn_of_altimetry,
    write_shots,
)
from photoclinometry.pipeline.frame.control import ControlRow, control_metrics, control_table, warn_of_contradictions
from photoclinometry.pipeline.frame.pose_priors import (
    PriorRow,
    changes_beside_priors,
    prior_metrics,
    prior_table,
    warn_of_outliers,
)
from photoclinometry.pipeline.relighting import IterationFigures
from photoclinometry.pipeline.response_check import ResponseCheck
from photoclinometry.pipeline.trust import brightness_off, change_explained, why_untrusted

log = logging.getLogger(__name__)

Row = dict[str, Any]
"""Of a table, by name of column."""


@dataclass(frozen=True)
class RunResult(Judged):
    """The products of a run."""

    scene: Scene
    """The map, as in `scene.h5`."""
    adjustment: Adjustment
    """Of the last estimate."""
    metrics: dict[str, float]
    """As in `metrics.json`, where units end the names."""
    report: Path
    """The report's page."""
    left_out: dict[str, str]
    """Names of views that were left out of the map, and why."""
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
    """Names of views in the scene whose light differs too much for plain matching, and how they were brought in."""
    held_out: Views | None = None
    """Views that were held out of the scene, in its frame."""
    iterations: Sequence[IterationFigures] = ()
    """Of the first map and of each relighting iteration."""
    pose_priors: Mapping[str, PosePrior] = field(default_factory=dict)
    """Of views (by name), if the scene is in their frame."""
    control: Sequence[ControlPoint] = ()
    """Ground control points."""
    altimetry: bool = False
    """Whether the run was given laser altimetry."""
    relief: ReliefCheck | None = None
    """Relief of the map compared with the parallax of the images; None where it was not checked."""
    psf_sigma_px: float | None = None
    """Standard deviation of the point-spread function with which fine relief was restored; None where it was not."""
    response: ResponseCheck | None = None
    """Whether images are linear; None where it was not checked."""


@dataclass(frozen=True, kw_only=True)
class _Tables:
    """The tables of a run, a row for each view, pose prior, control point and altimeter track."""

    used: list[Row]
    """Views that the map was made from."""
    held_out: list[Row]
    pose_priors: list[PriorRow]
    control: list[ControlRow]
    altimetry: list[TrackRow]


@dataclass(frozen=True, kw_only=True)
class _Findings:
    """What the report and metrics.json say of a run."""

    tables: _Tables
    views: list[Row]
    """All of the site: used, held out, and left out."""
    metrics: dict[str, float]
    judgement: Judgement
    diagnosis: Diagnosis


def write_products(folder: RunFolder, summary: RunSummary) -> RunResult:
    """scene.h5, config.toml, landmarks.ply, sparse/, held_out.json of views held out, altimetry.csv of altimetry, the
    report, and last metrics.json."""
    from photoclinometry.io.meshes.ply import write_ply
    from photoclinometry.io.models.colmap import write_colmap
    from photoclinometry.io.scene_file import write_scene

    adjustment, scene = summary.adjustment, summary.adjustment.scene
    folder.reopen()
    with folder.timed("products"):
        write_scene(folder.path / SCENE_FILE, scene)
        folder.write_config(summary.config)
        write_ply(folder.path / LANDMARKS_FILE, scene, mesh=True)
        write_colmap(folder.path / POSES_FOLDER, scene)
        write_shots(folder.path, adjustment.altimetry)
        _write_held_out(folder.path / HELD_OUT_FILE, summary.held_out)
        found = _findings(folder, summary)
    with folder.timed("report"):
        page = _write_report(folder, summary, found)
    _write_metrics(folder, summary, found)
    log_verdict(found.judgement)
    return RunResult(
        scene=scene,
        adjustment=adjustment,
        metrics=found.metrics,
        report=page,
        left_out=dict(summary.left_out),
        judgement=found.judgement,
    )


def _write_held_out(file: Path, views: Views | None) -> None:
    """Writes the held-out views; removes an older file where no view was held out."""
    from photoclinometry.io.held_out import write_held_out

    if views is None:
        file.unlink(missing_ok=True)
    else:
        write_held_out(file, views)


def log_verdict(judgement: Judgement) -> None:
    """The verdict on a map, and its reasons, in the log."""
    log.info("verdict: %s", judgement.verdict)
    for reason in judgement.reasons:
        log.info("%s: %s", judgement.verdict, reason)


def _findings(folder: RunFolder, summary: RunSummary) -> _Findings:
    """All findings about the map; doubtful ones are warned of and enter the judgement."""
    tables = _tables(summary)
    metrics = _metrics(summary, tables)
    _warn(summary, tables, metrics)
    return _Findings(
        tables=tables,
        views=_all_views(summary, tables),
        metrics=metrics,
        judgement=_judgement(summary, metrics, folder.warnings),
        diagnosis=diagnosis(summary.adjustment.scene),
    )


def _tables(summary: RunSummary) -> _Tables:
    from photoclinometry.evaluate.evaluate import held_out_table, view_table

    adjustment, scene, images = summary.adjustment, summary.adjustment.scene, summary.images
    return _Tables(
        used=view_table(scene, images),
        held_out=held_out_table(scene, summary.held_out, images) if summary.held_out else [],
        pose_priors=prior_table(scene, summary.pose_priors, adjustment.pose_priors_used),
        control=control_table(summary.control, adjustment.control, scene.views),
        altimetry=altimetry_table(adjustment.altimetry),
    )


def _metrics(summary: RunSummary, tables: _Tables) -> dict[str, float]:
    """All figures of the map."""
    adjustment = summary.adjustment
    found = _map_metrics(summary, tables)
    found |= {"views_left_out": len(summary.left_out), "converged": float(adjustment.converged)}
    found |= _noise_metrics(adjustment) | _parameter_metrics(adjustment) | prior_metrics(tables.pose_priors)
    found |= control_metrics(tables.control) | _frame_metrics(adjustment.frame_covariance)
    priors = adjustment.scene, summary.pose_priors, adjustment.pose_priors_used
    if any(row.used for row in tables.control):
        found |= changes_beside_priors(*priors, "control")
    if adjustment.altimetry is not None:
        found |= altimetry_metrics(adjustment.altimetry, *priors)
    if summary.relief is not None:
        found |= summary.relief.metrics()
    if summary.psf_sigma_px is not None:
        found["psf_sigma_px"] = summary.psf_sigma_px
    if summary.response is not None:
        found |= summary.response.metrics()
    return found


def _map_metrics(summary: RunSummary, tables: _Tables) -> dict[str, float]:
    """Figures of the scene by itself and compared with its images."""
    from photoclinometry.evaluate.evaluate import evaluate_scene

    scene = summary.adjustment.scene
    found = evaluate_scene(scene, summary.images, per_view=tables.used, held_out=tables.held_out)
    if scene.reflectance is not None:
        found["brightness_change_explained_percent"] = 100.0 * change_explained(scene)
        found[OFF] = 100.0 * brightness_off(scene)
    return found


def _warn(summary: RunSummary, tables: _Tables, metrics: Mapping[str, float]) -> None:
    """Warns of doubtful properties of the finished map."""
    scene = summary.adjustment.scene
    warn_of_outliers(tables.pose_priors)
    warn_of_contradictions(tables.control)
    warn_of_altimetry(tables.altimetry, given=summary.altimetry)
    warn_of_suns(scene)
    warn_of_relief(summary.relief)
    warn_of_blurred_views(scene)
    warn_of_dark_level(scene, summary.images)
    warn_of_renderings(metrics)


def _all_views(summary: RunSummary, tables: _Tables) -> list[Row]:
    how = {name: {"brought_in_by": way} for name, way in summary.brought_in.items()}
    views = [{"used": True, **row, **how.get(row["name"], {})} for row in tables.used + tables.held_out]
    return views + [{"name": name, "used": False, "left_out": reason} for name, reason in summary.left_out.items()]


def _judgement(summary: RunSummary, metrics: Mapping[str, float], warnings: tuple[Warned, ...]) -> Judgement:
    """warnings: all of the run."""
    adjustment = summary.adjustment
    return Judgement(
        warnings=warnings,
        distrust=why_untrusted(adjustment, len(summary.left_out), warnings, summary.relief),
        care=tuple(why_with_care(adjustment.scene, metrics)),
    )


def _write_report(folder: RunFolder, summary: RunSummary, found: _Findings) -> Path:
    from photoclinometry.output import report
    from photoclinometry.output.report.curves import cost_by_reweighting

    content = report.ReportContent(
        metrics=found.metrics,
        per_view=found.views,
        stages=[asdict(cost) for cost in folder.costs],
        iterations=[figures.as_row() for figures in summary.iterations],
        pose_priors=_rows(found.tables.pose_priors),
        known_poses=summary.pose_priors,
        control=_rows(found.tables.control),
        altimetry=_rows(found.tables.altimetry),
        shots=summary.adjustment.altimetry,
        convergence=cost_by_reweighting(summary.adjustment.log),
        options=summary.config,
        judgement=found.judgement,
        diagnosis=found.diagnosis,
    )
    return report.write_report(folder.path / REPORT_FOLDER, summary.adjustment.scene, summary.images, content)


def _write_metrics(folder: RunFolder, summary: RunSummary, found: _Findings) -> None:
    from photoclinometry.io.json_file import write_json

    content = {
        **found.judgement.as_json(),
        "metrics": found.metrics,
        "diagnosis": found.diagnosis,
        "views": found.views,
        "left_out": [{"name": name, "reason": reason} for name, reason in summary.left_out.items()],
        "brought_in": [{"name": name, "by": way} for name, way in summary.brought_in.items()],
        "relighting_iterations": [figures.as_row() for figures in summary.iterations],
        "frame": summary.adjustment.scene.frame,
        "pose_priors": _rows(found.tables.pose_priors),
        "control_points": _rows(found.tables.control),
        "altimetry": _rows(found.tables.altimetry),
        "stages": [asdict(cost) for cost in folder.costs],
        "message": summary.adjustment.message,
    }
    write_json(folder.path / METRICS_FILE, content, indent=2)


def _rows(table: Sequence[PriorRow | ControlRow | TrackRow]) -> list[Row]:
    """A table as files and pages have it."""
    return [asdict(row) for row in table]


def _frame_metrics(covariance: np.ndarray) -> dict[str, float]:
    """Standard deviations of the map's place, attitude and scale in a known frame. covariance: (7, 7), or empty."""
    if not covariance.size:
        return {}
    variance = np.diag(covariance)
    return {
        "frame_turn_sigma_deg": float(np.degrees(np.sqrt(variance[:3].sum()))),
        "frame_offset_sigma_m": float(np.sqrt(variance[3:6].sum())),
        "frame_scale_sigma_percent": 100.0 * float(np.sqrt(variance[6])),
    }


def _noise_metrics(adjustment: Adjustment) -> dict[str, float]:
    """The estimated errors of the measurements; those of brightness only where it was used."""
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
