"""The report of a run as a folder for the browser: maps, renderings, figures and options."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from photoclinometry.evaluate.diagnosis import diagnosis
from photoclinometry.evaluate.evaluate import evaluate_scene, view_table
from photoclinometry.evaluate.tables import number, split_unit, words
from photoclinometry.evaluate.unreliable import known_sigmas
from photoclinometry.evaluate.verdict import Judgement
from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.json_file import write_json
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.output.report import page
from photoclinometry.output.report.altimetry import CAPTION, draw_tracks
from photoclinometry.output.report.curves import CONVERGENCE, draw_convergence, draw_renderings
from photoclinometry.output.report.first_screen import first_screen
from photoclinometry.output.report.maps import draw_maps, draw_overview, draw_relit, draw_values
from photoclinometry.output.report.overview import overview
from photoclinometry.output.viewer import write_viewer
from photoclinometry.output.viewer.page import NAME as VIEWER

if TYPE_CHECKING:
    from photoclinometry.adjust import AltimetryFit

log = logging.getLogger(__name__)

Section = tuple[str, str, str]
"""Title, note, and HTML."""
_VIEWS = (
    "Residuals are RMS, angles are medians over the landmarks that the view measures. Sun moved: from its "
    "stated direction to the estimated one."
)
_PARTS = (
    "Medians. Keypoints: by rings of the detector, from the middle outwards; a trend is distortion. Brightness: by "
    "fifths of the observations, the darkest first; a trend is an offset, or a response that is not linear."
)


@dataclass(frozen=True, kw_only=True)
class ReportContent:
    """Content of a report besides the scene and its images. Parts that are left out are computed, or missing in the
    report."""

    metrics: Mapping[str, float] | None = None
    """As `evaluate_scene` gives (computed if left out), joined with `compare`'s where there is a truth."""
    per_view: Sequence[Mapping[str, Any]] | None = None
    """Rows as `evaluate.view_table` gives (computed if left out), with more columns and rows as you like, such as
    "used" (False makes a row red) and "left_out"; units are read from the keys."""
    stages: Sequence[Mapping[str, Any]] = ()
    """One row per stage, such as {"stage": ..., "wall_s": ..., "cpu_s": ..., "peak_memory_gb": ...}."""
    iterations: Sequence[Mapping[str, float]] = ()
    """One row for the first map, and one per relighting iteration."""
    pose_priors: Sequence[Mapping[str, Any]] = ()
    """One row per view that has one; those not "used" are red."""
    known_poses: Mapping[str, PosePrior] = field(default_factory=dict)
    """The priors themselves, by name of view, for the viewer."""
    control: Sequence[Mapping[str, Any]] = ()
    """One row per ground control point."""
    altimetry: Sequence[Mapping[str, Any]] = ()
    """One row per track of a laser altimeter."""
    shots: AltimetryFit | None = None
    """These tracks' shots beside the scene, for the figure."""
    convergence: Sequence[Mapping[str, float]] = ()
    """One per iteration of the solver, the first before any step: cost by type of factor."""
    diagnosis: Mapping[str, Sequence[float | None]] | None = None
    """As `evaluate.diagnosis.diagnosis` gives (computed if left out)."""
    errors: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Per-landmark values (J,) to be drawn as maps, such as `Comparison.errors`."""
    options: Mapping[str, Any] | None = None
    """Of the run, nested as they are."""
    judgement: Judgement | None = None
    """Whether the map is to be trusted: on top. If left out, nothing was warned of, and what to take care of is as
    `evaluate.verdict.why_with_care` gives."""


def write_report(
    folder: Path, scene: Scene, images: Sequence[Image] | None = None, content: ReportContent | None = None
) -> Path:
    """Draw everything, and write `index.html`, `viewer.html` and `summary.json`; returns the page's path.

    The folder appears whole, replacing an older one, or not at all (RunFolderError).

    images: the views' images in any order; without them there are no renderings beside real images.
    """
    images, content = list(images or ()), content or ReportContent()
    rows = view_table(scene, images) if content.per_view is None else [dict(row) for row in content.per_view]
    metrics = evaluate_scene(scene, images, per_view=rows) if content.metrics is None else content.metrics
    with atomic_path(folder) as work:
        work.mkdir()
        write_viewer(work / VIEWER, scene, images, content.known_poses)
        sections = [_summary(work, scene, rows, metrics, content)]
        sections += _map_sections(work, scene, images, content)
        if scene.reflectance is not None:
            sections += _rendering_sections(work, scene, images, rows)
        sections += _estimate_sections(work, scene, content)
        sections.append(("Views", _VIEWS, page.mapping_table(rows)))
        sections.append(("Residuals by place and brightness", _PARTS, _parts_table(scene, content)))
        if content.stages:
            sections.append(("Time and memory", "", page.mapping_table(content.stages)))
        sections.append(("All figures", "", page.metrics_tables(metrics)))
        if content.options:
            sections.append(page.options_section(content.options))
        html = page.page(scene.name, _subtitle(scene), sections)
        (work / "index.html").write_text(html, encoding="utf-8")
        write_json(work / "summary.json", metrics, indent=2)
    log.info("report: %s", folder / "index.html")
    return folder / "index.html"


def _parts_table(scene: Scene, content: ReportContent) -> str:
    """Medians of residuals by ring of the detector and by brightness, one row each."""
    found = diagnosis(scene) if content.diagnosis is None else content.diagnosis
    parts = max(len(values) for values in found.values())
    rows = []
    for name, values in found.items():
        quantity, unit = split_unit(name)
        rows.append((words(quantity), unit, *map(number, values)))
    return page.table(("quantity", "unit", *(str(n + 1) for n in range(parts))), rows)


def _summary(
    work: Path, scene: Scene, rows: Sequence[Mapping[str, Any]], metrics: Mapping[str, float], content: ReportContent
) -> Section:
    """The first screen, with its map drawn into `work`."""
    found = overview(scene, metrics, rows, content.judgement)
    caption = draw_overview(work / "overview.png", scene, found.places)
    link = page.link(VIEWER, "Move the Sun over the map, and measure on it")
    return "Summary", "", first_screen(found, "overview.png", caption) + link


def _map_sections(work: Path, scene: Scene, images: Sequence[Image], content: ReportContent) -> list[Section]:
    """Maps of the landmarks, of their errors where these are known, and of their uncertainties, drawn into `work`."""
    name = scene.views.name[scene.reference]
    reference = next((image for image in images if image.name == name), None)
    maps = page.figures(draw_maps(work, scene, reference))
    sections = [("Map", "On the pixels of the reference image.", maps)]
    found = draw_values(work, scene, content.errors, "difference")
    if found:
        sections.append(("Differences", "Against the reference, after alignment.", page.figures(found)))
    found = draw_values(work, scene, known_sigmas(scene), "uncertainty")
    if found:
        note = "One standard deviation. Errors that all views share count as far as the images show them."
        if scene.frame == BODY_FIXED:
            note += " Position and height include the uncertainty of the map's place on the body."
        sections.append(("Uncertainty", note, page.figures(found)))
    return sections


def _rendering_sections(
    work: Path, scene: Scene, images: Sequence[Image], rows: Sequence[Mapping[str, Any]]
) -> list[Section]:
    """Renderings beside the images, and under another Sun, drawn into `work`."""
    sections = []
    found = draw_renderings(work, scene, {image.name: image for image in images}, rows)
    if found:
        note = "From the best to the worst PSNR. The shadows that the relief casts are drawn."
        sections.append(("Renderings", note, page.figures(found, "grid wide")))
    draw_relit(work / "relit.png", scene)
    caption = "Azimuth counts clockwise from up in the image, elevation from the mean plane; shadows are cast."
    sections.append(("Relit", "", page.figures([("relit.png", caption)], "grid wide")))
    return sections


def _estimate_sections(work: Path, scene: Scene, content: ReportContent) -> list[Section]:
    """The course of the estimate: relighting iterations, priors, and the cost, drawn into `work`."""
    sections = []
    if content.iterations:
        note = "Each iteration renders the map under every view's Sun, matches that, and estimates again."
        sections.append(("Relighting iterations", note, page.mapping_table(content.iterations)))
    if content.pose_priors:
        note = "How far the map's cameras are from what was known of them. Red: left out, as it contradicts the images."
        sections.append(("Pose priors", note, page.mapping_table(content.pose_priors)))
    if content.control:
        note = "Distance of the estimate from the points' known positions and from their pixels (RMS over views)."
        sections.append(("Ground control points", note, page.mapping_table(content.control)))
    if content.altimetry and content.shots is not None:
        draw_tracks(work / "altimetry.png", scene, content.shots)
        shown = page.figures([("altimetry.png", CAPTION)], "grid wide half")
        note = (
            "How far the shots on the map are off after each track was shifted as a whole (RMS; 1 of their sigmas is "
            "right, above 3 is named), and by how much: the length of the shift, its sigma along each axis, and its "
            "size in sigmas (RMS over the axes)."
        )
        sections.append(("Laser altimetry", note, page.mapping_table(content.altimetry) + shown))
    if content.convergence:
        draw_convergence(work / "convergence.png", content.convergence)
        shown = page.figures([("convergence.png", CONVERGENCE)], "grid wide half")
        sections.append(("Convergence", "", shown))
    return sections


def _subtitle(scene: Scene) -> str:
    every = "" if scene.region.stride == 1 else f" at a stride of {scene.region.stride}"
    size = f"{scene.region.width} x {scene.region.height} pixels{every} of {scene.views.name[scene.reference]}"
    frame = "body-fixed frame" if scene.frame == BODY_FIXED else ""
    return ", ".join(
        part for part in (scene.body, size, *page.made_of(scene.reflectance, scene.brightness), frame) if part
    )
