"""The products of a body's map: its surface, the poses, figures and a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.adjust.bundle import landmarks_of, tracks_of
from photoclinometry.body.cameras import SharedCameras
from photoclinometry.body.finished_surface import reflectance_of_tiles
from photoclinometry.body.merge import MergedSurface
from photoclinometry.body.placement import PlacedViews
from photoclinometry.body.renderings import RenderingQuality
from photoclinometry.body.surface_figures import surface_figures
from photoclinometry.body.tile import BodyModel
from photoclinometry.body.tile_map import TileMap
from photoclinometry.body.trust import MOST_TILES, why_untrusted
from photoclinometry.evaluate.verdict import Judged, Judgement, why_body_with_care
from photoclinometry.io.json_file import write_json
from photoclinometry.io.meshes.shape_ply import write_shape_ply
from photoclinometry.io.models.colmap import write_colmap
from photoclinometry.io.run_files import BODY_FILE, METRICS_FILE, POSES_FOLDER, REPORT_FOLDER
from photoclinometry.matching.triangulation import triangulate_tracks
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.region import Region
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.model.sparse import of_views
from photoclinometry.model.warning import Warned
from photoclinometry.output.report.body_overview import views_per_vertex
from photoclinometry.output.report.body_report import BodyContent, write_body_report
from photoclinometry.output.viewer import ViewedBody
from photoclinometry.pipeline.folder.run_folder import RunFolder
from photoclinometry.pipeline.folder.stage import Keyed
from photoclinometry.pipeline.products import log_verdict
from photoclinometry.pipeline.response_check import CODE as RESPONSE


@dataclass(frozen=True, kw_only=True)
class BodyResult(Judged):
    """The products of a body's map."""

    folder: Path
    model: BodyModel
    surface: MergedSurface
    metrics: dict[str, float]
    report: Path
    """The report's page."""
    judgement: Judgement
    """Whether the map is to be trusted; its parts are attributes of the result, too."""

    @property
    def shape(self) -> ShapeModel:
        """The surface in the body's frame, as in body.ply."""
        return shape_model(self.surface, self.model.unit)


@dataclass(frozen=True, kw_only=True)
class BodyParts:
    """The parts from which the body's surface is made."""

    tiles: tuple[Keyed[TileMap], ...]
    cameras: SharedCameras
    surface: MergedSurface
    placed: PlacedViews
    renderings: RenderingQuality

    @property
    def poses(self) -> Rigid:
        """(K,) of all views: those that the tiles share, and those by the surface."""
        return self.placed.body_from_cam


def shape_model(surface: MergedSurface, unit: str | None) -> ShapeModel:
    """The merged surface in the form for other programs."""
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


def write_body_products(folder: RunFolder, model: BodyModel, made: BodyParts, config: Mapping[str, Any]) -> BodyResult:
    """body.ply, config.toml, sparse/, the report, and last metrics.json."""
    folder.reopen()
    surface = made.surface
    shape = shape_model(surface, model.unit)
    metrics, warnings = _metrics(model, made), _of_the_body(folder.warnings, model, made.placed)
    rows, views = _tile_rows(model, made), _view_rows(model, made)
    judgement = Judgement(
        warnings=warnings,
        distrust=why_untrusted([tile.value for tile in made.tiles], made.renderings.explained, warnings),
        care=tuple(why_body_with_care(metrics, rows, views_per_vertex(shape))),
    )
    with folder.timed("products"):
        write_shape_ply(folder.path / BODY_FILE, shape)
        folder.write_config(config)
        write_colmap(folder.path / POSES_FOLDER, _poses(model, made))
    viewed = _viewed(model, made, shape)
    with folder.timed("report"):
        content = BodyContent(
            name=model.site.name,
            metrics=metrics,
            tiles=rows,
            views=views,
            stages=[asdict(cost) for cost in folder.costs if not cost.stage.startswith("tile_")],
            options=config,
            judgement=judgement,
        )
        images = model.posed.inputs.value.images
        page = write_body_report(folder.path / REPORT_FOLDER, viewed, surface.step, content, images)
    document = {
        **judgement.as_json(),
        "metrics": metrics,
        "reflectance": reflectance_json(viewed.reflectance),
        "tiles": rows,
        "views": views,
        "stages": [asdict(cost) for cost in folder.costs],
    }
    write_json(folder.path / METRICS_FILE, document, indent=2)
    log_verdict(judgement)
    return BodyResult(
        folder=folder.path,
        model=model,
        surface=surface,
        metrics=metrics,
        report=page,
        judgement=judgement,
    )


def reflectance_json(reflectance: Reflectance | None) -> dict[str, Any] | None:
    """A model with its parameters by name, for metrics.json; None of geometry alone."""
    if reflectance is None:
        return None
    named = zip(reflectance.parameter_names, reflectance.values, strict=True)
    return {"name": reflectance.name, "parameters": dict(named)}


def _viewed(model: BodyModel, made: BodyParts, shape: ShapeModel) -> ViewedBody:
    """The body for its page: views that have a pose, and brightness by the reflectance of the tiles."""
    used = np.flatnonzero(model.posed.sparse.value.registered | made.placed.placed)
    views = model.posed.views.at_poses(made.poses)[used]
    gain = made.renderings.gain[used]
    return ViewedBody(
        name=model.site.name,
        body=model.site.body,
        shape=shape,
        views=replace(views, scale=np.where(np.isfinite(gain), gain, 1.0)),
        reflectance=reflectance_of_tiles([tile.value for tile in made.tiles]),
        gsd=made.surface.gsd,
        brightness=model.site.brightness,
        body_fixed=model.posed.frame == BODY_FIXED,
        pose_priors=model.site.pose_priors,
    )


def _of_the_body(warnings: Sequence[Warned], model: BodyModel, placed: PlacedViews) -> tuple[Warned, ...]:
    """The warnings that concern the body as a whole. Not among them: warnings of left-out views that the surface has
    placed, of renderings of tiles, and of images that are not linear by some tiles only.

    Renderings of tiles are in the tiles' own reports: tiles of sound bodies have 25 to 35 dB. For the body whole disks
    are compared.
    """
    unsaid = {"renderings-differ"}
    if sum(warned.code == RESPONSE for warned in warnings) <= MOST_TILES * len(model.plan.value.tiles):
        unsaid.add(RESPONSE)
    names = {model.site.views[k].name for k in np.flatnonzero(placed.placed)}
    return tuple(
        warned
        for warned in warnings
        if warned.code not in unsaid and (warned.code != "view-unregistered" or warned.view not in names)
    )


def _poses(model: BodyModel, made: BodyParts) -> Scene:
    """All views that have a pose, and the sparse points, triangulated by the poses that tiles share."""
    whole = replace(model.posed.sparse.value, body_from_cam=made.poses)
    used = np.flatnonzero(whole.registered | made.placed.placed)
    sparse = of_views(whole, used)
    views = replace(model.posed.views[used], body_from_cam=sparse.body_from_cam)
    tracks = tracks_of(sparse, 1.0)
    points = triangulate_tracks(tracks, views)
    points = np.where(np.isfinite(points), points, sparse.points)
    return Scene(
        name=model.site.name,
        body=model.site.body,
        brightness=model.site.brightness,
        reflectance=None,
        views=views,
        landmarks=landmarks_of(replace(sparse, points=points)),
        tracks=tracks,
        reference=0,
        region=Region(row=0, col=0, height=1, width=1),
        frame=model.posed.frame,
    )


def _metrics(model: BodyModel, made: BodyParts) -> dict[str, float]:
    tiles, registered = made.tiles, model.posed.sparse.value.registered
    found = {
        "images": len(registered),
        "images_registered": int(registered.sum()),
        "images_placed_by_surface": int(made.placed.placed.sum()),
        "sparse_reprojection_px": model.posed.sparse.value.mean_reprojection_px,
        "tiles": len(tiles),
        "tiles_mapped": sum(1 for tile in tiles if not tile.value.failure),
        "tiles_untrusted": sum(1 for tile in tiles if tile.value.distrust),
        "landmarks": sum(len(tile.value.landmarks) for tile in tiles),
        **surface_figures(made.surface),
    }
    quality, explained = (of[np.isfinite(of)] for of in (made.renderings.psnr_db, made.renderings.explained))
    if len(quality):
        found |= {"psnr_mean_db": float(quality.mean()), "psnr_min_db": float(quality.min())}
    if len(explained):
        found["disk_brightness_explained_percent"] = 100.0 * float(np.median(explained))
    return found


def _tile_rows(model: BodyModel, made: BodyParts) -> list[dict[str, Any]]:
    rows = []
    for number, (tile, found) in enumerate(zip(model.plan.value.tiles, made.tiles, strict=True)):
        region = tile.region
        rows.append(
            {
                "tile": number,
                "reference": model.site.views[tile.reference].name,
                "region": f"{region.width} x {region.height} at ({region.col}, {region.row})",
                "views": len(tile.views),
                "gsd": round(tile.gsd, 4),
                "landmarks": len(found.value.landmarks),
                "tie_points_px": round(float(made.cameras.tile_px[number]), 3),
                "albedo_factor": round(float(made.surface.albedo_factor[number]), 4),
                "used": not found.value.failure,
                "why_not": "; ".join([found.value.failure, *found.value.distrust]).strip("; "),
            }
        )
    return rows


def _view_rows(model: BodyModel, made: BodyParts) -> list[dict[str, Any]]:
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
            "placed_by_surface": bool(made.placed.placed[k]),
            "psnr_db": round(float(made.renderings.psnr_db[k]), 1),
            "brightness_explained_percent": round(100.0 * float(made.renderings.explained[k]), 1),
            "optics_px": float(made.renderings.optics_px[k]),
            "gain": float(made.renderings.gain[k]),
            "left_out": why.get(k, ""),
        }
        for k, view in enumerate(model.site.views)
    ]
