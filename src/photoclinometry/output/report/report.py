"""The report of a run as a folder for the browser: maps, renderings, figures and options."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry import __version__
from photoclinometry.evaluate.evaluate import evaluate_scene, view_table
from photoclinometry.evaluate.sigmas import landmark_sigmas
from photoclinometry.evaluate.tables import json_numbers
from photoclinometry.io.atomic import atomic_path
from photoclinometry.model.scene import BODY_FIXED, Image, Scene
from photoclinometry.output.report import page
from photoclinometry.output.report.curves import draw_convergence, draw_renderings
from photoclinometry.output.report.maps import draw_maps, draw_relit, draw_values

log = logging.getLogger(__name__)


def write_report(
    folder: Path,
    scene: Scene,
    images: Sequence[Image] | None = None,
    *,
    metrics: Mapping[str, float] | None = None,
    per_view: Sequence[Mapping[str, Any]] | None = None,
    stages: Sequence[Mapping[str, Any]] = (),
    rounds: Sequence[Mapping[str, float]] = (),
    pose_priors: Sequence[Mapping[str, Any]] = (),
    convergence: Sequence[Mapping[str, float]] = (),
    errors: Mapping[str, np.ndarray] | None = None,
    options: Mapping[str, Any] | None = None,
    unit: str | None = None,
) -> Path:
    """Draw everything, and write `index.html` and `summary.json`; returns the page's path.

    The folder appears whole, replacing an older one, or not at all (RunFolderError).

    images: the views' images in any order; without them there are no renderings beside real images.
    metrics: as `evaluate_scene` (computed if left out), joined with `compare`'s where there is a truth.
    per_view: rows as `evaluate.view_table` gives (computed if left out), with more columns and rows as you
        like, such as "used" (False makes a row red) and "left_out"; units are read from the keys.
    stages: one mapping per stage, such as {"stage": ..., "wall_s": ..., "cpu_s": ..., "peak_memory_gb": ...}.
    rounds: one mapping per round of matching and adjusting, as `rounds.round_entry` gives.
    pose_priors: one mapping per view that has one, as `pose_priors.prior_table` gives; those not "used" are red.
    convergence: one mapping per iteration, the first before any step: cost by type of factor.
    errors: per-landmark values (J,) to be drawn as maps, such as `Comparison.errors`.
    options: of the run, nested as they are. unit: of frame B, where it means something ("m").
    """
    images = list(images or ())
    rows = view_table(scene, images) if per_view is None else [dict(row) for row in per_view]
    metrics = evaluate_scene(scene, images, per_view=rows) if metrics is None else metrics
    with atomic_path(folder) as work:
        work.mkdir()
        sections = _sections(work, scene, images, rows, stages, rounds, pose_priors, convergence, errors or {}, unit)
        sections.insert(0, ("Summary", "", page.tiles(metrics)))
        sections.append(("All figures", "", page.metrics_tables(metrics)))
        if options:
            text = escape(page.options_text(options))
            sections.append(("Options", "", f'<div class="scroll"><pre>{text}</pre></div>'))
        html = page.page(scene.name, _subtitle(scene), sections, f"Written by photoclinometry {__version__}.")
        (work / "index.html").write_text(html, encoding="utf-8")
        (work / "summary.json").write_text(json.dumps(json_numbers(metrics), indent=2) + "\n", encoding="utf-8")
    log.info("report: %s", folder / "index.html")
    return folder / "index.html"


def _sections(
    work: Path,
    scene: Scene,
    images: Sequence[Image],
    rows: Sequence[Mapping[str, Any]],
    stages: Sequence[Mapping[str, Any]],
    rounds: Sequence[Mapping[str, float]],
    pose_priors: Sequence[Mapping[str, Any]],
    convergence: Sequence[Mapping[str, float]],
    errors: Mapping[str, np.ndarray],
    unit: str | None,
) -> list[tuple[str, str, str]]:
    """The page's sections in order, drawing their figures into `work`."""
    by_name = {image.name: image for image in images}
    reference = by_name.get(scene.views.name[scene.reference])
    sections = [("Map", "On the grid of the reference image.", page.figures(draw_maps(work, scene, reference, unit)))]
    found = draw_values(work, scene, errors, "difference")
    if found:
        sections.append(("Differences", "Against the reference, after alignment.", page.figures(found)))
    found = draw_values(work, scene, landmark_sigmas(scene), "uncertainty")
    if found:
        note = "One standard deviation by measurement noise and smoothness; errors of the models are not included."
        if scene.frame == BODY_FIXED:
            note += " Position and height include the uncertainty of the map's place on the body, from the pose priors."
        sections.append(("Uncertainty", note, page.figures(found)))
    if scene.reflectance is not None:
        found = draw_renderings(work, scene, by_name, rows)
        if found:
            note = "From the best to the worst PSNR, with cast shadows."
            sections.append(("Renderings", note, page.figures(found, "grid wide")))
        draw_relit(work / "relit.png", scene)
        caption = "Azimuth is clockwise from up in the image, elevation is above the mean plane; with cast shadows."
        sections.append(("Relit", "", page.figures([("relit.png", caption)], "grid wide")))
    if rounds:
        note = "Each round renders the map under every view's Sun, matches that, and adjusts again."
        sections.append(("Rounds", note, page.mapping_table(rounds)))
    if pose_priors:
        note = "Distance of the map's cameras from their priors. Red: left out, since it contradicts the images."
        sections.append(("Pose priors", note, page.mapping_table(pose_priors)))
    if convergence:
        draw_convergence(work / "convergence.png", convergence)
        shown = page.figures([("convergence.png", "Cost by type of factor.")], "grid wide half")
        sections.append(("Convergence", "", shown))
    sections.append(("Views", "Residuals are RMS.", page.mapping_table(rows)))
    if stages:
        sections.append(("Time and memory", "", page.mapping_table(stages)))
    return sections


def _subtitle(scene: Scene) -> str:
    model = "geometry alone" if scene.reflectance is None else f"{scene.reflectance.name} reflectance"
    kind = "radiance factor I/F" if scene.brightness == "iof" else "uncalibrated brightness"
    every = "" if scene.region.stride == 1 else f" at a stride of {scene.region.stride}"
    size = f"{scene.region.width} x {scene.region.height} pixels{every} of {scene.views.name[scene.reference]}"
    frame = "body-fixed frame" if scene.frame == BODY_FIXED else ""
    return ", ".join(part for part in (scene.body, size, model, kind, frame) if part)
