"""What the map of a body leaves: its surface, the poses, figures and a report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.body.merge import MergedSurface
from photoclinometry.body.tile import BodyModel, TileMap
from photoclinometry.evaluate.metrics import spread
from photoclinometry.evaluate.tables import json_numbers
from photoclinometry.io.atomic import write_text
from photoclinometry.io.meshes.shape_ply import write_shape_ply
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.model.warning import Warned
from photoclinometry.output.report.body_report import BodyContent, write_body_report
from photoclinometry.pipeline.run_folder import RunFolder
from photoclinometry.pipeline.stage import Keyed
from photoclinometry.surface.closed_mesh import area_vectors, signed_volume

BODY_FILE = "body.ply"
"""The surface, in the body's folder."""


@dataclass(frozen=True, kw_only=True)
class BodyResult:
    """What the map of a body leaves."""

    folder: Path
    model: BodyModel
    surface: MergedSurface
    metrics: dict[str, float]
    report: Path
    """The report's page."""
    warnings: tuple[Warned, ...]

    @property
    def shape(self) -> ShapeModel:
        """The surface in the body's frame, as in body.ply."""
        return shape_model(self.surface, self.model.unit)


def shape_model(surface: MergedSurface, unit: str | None) -> ShapeModel:
    """The merged surface as other programs take it."""
    return ShapeModel(
        vertices=surface.vertices,
        faces=surface.faces,
        normals=surface.normals,
        albedo=surface.albedo,
        sigma={"height": surface.height_sigma, "normal": surface.normal_sigma, "albedo": surface.albedo_sigma},
        views=surface.views,
        tile=surface.tile,
        unit=unit,
    )


def write_body_products(
    folder: RunFolder,
    model: BodyModel,
    tiles: tuple[Keyed[TileMap], ...],
    surface: MergedSurface,
    config: Mapping[str, Any],
) -> BodyResult:
    """body.ply, metrics.json and the report."""
    shape = shape_model(surface, model.unit)
    metrics = _metrics(model, tiles, surface)
    rows, views = _tile_rows(model, tiles, surface), _view_rows(model)
    with folder.timed("products"):
        write_shape_ply(folder.path / BODY_FILE, shape)
    with folder.timed("report"):
        content = BodyContent(
            name=model.site.name,
            metrics=metrics,
            tiles=rows,
            views=views,
            stages=[asdict(cost) for cost in folder.costs if not cost.stage.startswith("tile_")],
            options=config,
            warnings=[f"{warned.words} [{warned.code}]" for warned in folder.warnings],
        )
        page = write_body_report(folder.path / "report", shape, surface.gsd, surface.step, content)
    document = {
        "warnings": [warned.as_row() for warned in folder.warnings],
        "metrics": json_numbers(metrics),
        "tiles": rows,
        "views": views,
        "stages": [asdict(cost) for cost in folder.costs],
    }
    write_text(folder.path / "metrics.json", json.dumps(document, indent=2) + "\n")
    return BodyResult(
        folder=folder.path, model=model, surface=surface, metrics=metrics, report=page, warnings=folder.warnings
    )


def _metrics(model: BodyModel, tiles: tuple[Keyed[TileMap], ...], surface: MergedSurface) -> dict[str, float]:
    registered = model.posed.sparse.value.registered
    area = np.linalg.norm(area_vectors(surface.vertices, surface.faces), axis=-1)
    mapped = (surface.views[surface.faces] > 0).all(1)
    volume = signed_volume(surface.vertices, surface.faces)
    overlap = surface.step[np.isfinite(surface.step)] / surface.gsd
    found = {
        "images": len(registered),
        "images_registered": int(registered.sum()),
        "sparse_reprojection_px": model.posed.sparse.value.mean_reprojection_px,
        "tiles": len(tiles),
        "tiles_mapped": sum(1 for tile in tiles if not tile.value.failure),
        "tiles_untrusted": sum(1 for tile in tiles if tile.value.distrust),
        "landmarks": sum(len(tile.value.views) for tile in tiles),
        "facets": len(surface.faces),
        "mapped_percent": 100.0 * float(area[mapped].sum() / area.sum()),
        "mean_radius": float(np.cbrt(0.75 / np.pi * volume)),
        "volume": volume,
        "area": float(area.sum()),
        "gsd": surface.gsd,
        "height_sigma_median_gsd": float(np.nanmedian(surface.height_sigma) / surface.gsd),
    }
    return found | (spread(overlap, "step_between_tiles", "gsd") if len(overlap) else {})


def _tile_rows(model: BodyModel, tiles: tuple[Keyed[TileMap], ...], surface: MergedSurface) -> list[dict[str, Any]]:
    rows = []
    for number, (tile, found) in enumerate(zip(model.plan.value.tiles, tiles, strict=True)):
        region = tile.region
        rows.append(
            {
                "tile": number,
                "reference": model.site.views[tile.reference].name,
                "region": f"{region.width} x {region.height} at ({region.col}, {region.row})",
                "views": len(tile.views),
                "gsd": round(tile.gsd, 4),
                "landmarks": len(found.value.views),
                "albedo_factor": round(float(surface.albedo_factor[number]), 4),
                "used": not found.value.failure,
                "why_not": "; ".join([found.value.failure, *found.value.distrust]).strip("; "),
            }
        )
    return rows


def _view_rows(model: BodyModel) -> list[dict[str, Any]]:
    sparse = model.posed.sparse.value
    why = sparse.why_unregistered()
    points = np.bincount(sparse.point_view, minlength=len(sparse.registered))
    used_by = np.zeros(len(points), int)
    for tile in model.plan.value.tiles:
        used_by[tile.views] += 1
    return [
        {
            "name": view.name,
            "used": bool(sparse.registered[k]),
            "sparse_points": int(points[k]),
            "tiles": int(used_by[k]),
            "left_out": why.get(k, ""),
        }
        for k, view in enumerate(model.site.views)
    ]
