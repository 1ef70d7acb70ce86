"""The report of a whole body: six sides, maps of the uncertainties, its tiles and views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.evaluate.verdict import Judgement
from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.json_file import write_json
from photoclinometry.model.image import Image
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.report import page
from photoclinometry.output.report.body_overview import body_overview
from photoclinometry.output.report.first_screen import first_screen
from photoclinometry.output.report.sides import draw_numbered_sides, draw_sides
from photoclinometry.output.viewer import ViewedBody, write_body_viewer
from photoclinometry.output.viewer.page import NAME as VIEWER
from photoclinometry.surface.mesh_rays import MeshRays


@dataclass(frozen=True, kw_only=True)
class BodyContent:
    """Content of a body's report besides its surface."""

    name: str
    metrics: Mapping[str, float]
    """As in the body's metrics.json."""
    tiles: Sequence[Mapping[str, Any]]
    """One row per tile; those not "used" are red."""
    views: Sequence[Mapping[str, Any]]
    """One row per image; those not "used" are red."""
    stages: Sequence[Mapping[str, Any]]
    options: Mapping[str, Any]
    judgement: Judgement
    """Whether the map of the body is to be trusted."""


def write_body_report(
    folder: Path, body: ViewedBody, step: np.ndarray, content: BodyContent, images: Sequence[Image] = ()
) -> Path:
    """`index.html` with its figures, `viewer.html`, and `summary.json`; returns the path of the first.

    step: (V,) standard deviation of heights between tiles, NaN where there is but one, in the shape's unit of length.
    images: of the body's views, for the viewer. The folder appears whole, replacing an older one, or not at all
    (RunFolderError).
    """
    shape = body.shape
    with atomic_path(folder) as work:
        work.mkdir()
        write_body_viewer(work / VIEWER, body, images)
        rays = MeshRays(shape.vertices, shape.faces, _spacing(shape))
        sections = [
            ("Summary", "", _summary(work, body, rays, step, content)),
            (
                "Six sides",
                f"Orthographic; {_way_up(body)}.",
                _sides(work, shape, rays),
            ),
            ("What is known where", "Grey: nothing was mapped.", _figures(work, body, rays, step)),
            ("Tiles", "Each is the folder of a run, with a report of its own.", page.mapping_table(content.tiles)),
            ("Images", "", page.mapping_table(content.views)),
            ("Stages", "", page.mapping_table(content.stages)),
            ("All figures", "", page.metrics_tables(content.metrics)),
            page.options_section(content.options),
        ]
        html = page.page(f"{content.name}: the whole body", _subtitle(body), sections)
        (work / "index.html").write_text(html, encoding="utf-8")
        summary = {
            "metrics": content.metrics,
            "warnings": [warned.line for warned in content.judgement.warnings],
        }
        write_json(work / "summary.json", summary, indent=2)
    return Path(folder) / "index.html"


def _summary(work: Path, body: ViewedBody, rays: MeshRays, step: np.ndarray, content: BodyContent) -> str:
    """The first screen, with its six sides drawn into `work`."""
    found = body_overview(body, step, content.metrics, content.judgement)
    draw_numbered_sides(work / "overview.png", rays, body.shape, [place.vertex for place in found.places])
    numbered = " Numbers: the worst places." if found.places else ""
    caption = f"The surface from six sides; {_way_up(body)}.{numbered}"
    link = page.link(VIEWER, "Move the Sun over the body, and measure on it")
    return first_screen(found, "overview.png", caption) + link


def _way_up(body: ViewedBody) -> str:
    """Of pictures of the six sides."""
    if body.body_fixed:
        return "north is up, 0° E is up in the views of the poles"
    return (
        "z is up, x is up in the views along z. The axes are those of the model: "
        "images alone do not determine the poles"
    )


def _subtitle(body: ViewedBody) -> str:
    frame = "body-fixed frame" if body.body_fixed else ""
    made_of = page.made_of(body.reflectance, body.brightness)
    return ", ".join(part for part in (body.body, *made_of, frame) if part)


def _sides(work: Path, shape: ShapeModel, rays: MeshRays) -> str:
    draw_sides(work / "sides.png", rays, shape, "Shaded by its normals")
    return page.figures([("sides.png", "The surface, shaded by the normals at its vertices.")], "grid wide")


def _figures(work: Path, body: ViewedBody, rays: MeshRays, step: np.ndarray) -> str:
    shape, gsd = body.shape, body.gsd
    albedo = "Normal albedo" if body.brightness == "iof" else "Relative albedo"
    none = np.full(len(shape.vertices), np.nan)
    views = none if shape.views is None else np.where(shape.views > 0, shape.views, np.nan)
    tile = none if shape.tile is None else np.where(shape.tile >= 0, shape.tile, np.nan)
    drawn = (
        ("albedo", albedo, none if shape.albedo is None else shape.albedo, "gray"),
        ("height_sigma", "Standard deviation of height [GSD]", shape.sigma.get("height", none) / gsd, "viridis"),
        ("normal_sigma", "Standard deviation of normals [°]", np.degrees(shape.sigma.get("normal", none)), "viridis"),
        ("step", "Scatter of heights between overlapping tiles [GSD]", step / gsd, "magma"),
        ("views", "Images per vertex", views, "viridis"),
        ("tile", "Tile", tile, "prism"),
    )
    shown = []
    for name, title, values, cmap in drawn:
        if np.isfinite(values).any():
            draw_sides(work / f"{name}.png", rays, shape, title, values, cmap)
            shown.append((f"{name}.png", title))
    return page.figures(shown)


def _spacing(shape: ShapeModel) -> float:
    a, b = shape.vertices[shape.faces[:, 0]], shape.vertices[shape.faces[:, 1]]
    return float(np.mean(np.linalg.norm(a - b, axis=-1)))
