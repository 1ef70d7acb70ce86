"""The first facts of a body's report: the mapped ground, the quality of the map, and reasons for distrust."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from photoclinometry.evaluate.illumination import sun_span_deg
from photoclinometry.evaluate.tables import digits, number
from photoclinometry.evaluate.verdict import Judgement
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.model.warning import few_of_each
from photoclinometry.output.report.body_places import BodyPlace, body_places
from photoclinometry.output.report.facts import (
    Fact,
    Overview,
    dark_level,
    span,
    stated_sigmas,
    with_sigma,
    with_unit,
)
from photoclinometry.output.viewer import ViewedBody
from photoclinometry.surface.closed_mesh import centroid

KILO = 1000.0
"""Length from which on lengths are shown in kilometres [m]."""
_SIGMAS = {
    "height": "one sigma along the normal, at one vertex, as overlapping tiles disagree",
    "normal": "one sigma of its angle to the true one, at one vertex",
    "albedo": "one sigma between places; the level of all errs with the model",
}


def body_overview(
    body: ViewedBody, step: np.ndarray, metrics: Mapping[str, Any], judgement: Judgement
) -> Overview[BodyPlace]:
    """The overview of a body.

    step: (V,) scatter of heights between tiles, NaN where there is but one; metrics: as in the body's metrics.json.
    """
    return Overview(
        verdict=judgement.verdict,
        reasons=judgement.reasons,
        warnings=tuple(few_of_each(judgement.warnings)),
        what=tuple(_what(body, metrics)),
        quality=tuple(_quality(body, metrics)),
        places=body_places(body.shape, step, body.gsd),
    )


def phases_deg(body: ViewedBody) -> np.ndarray:
    """(K,) phase angles of the views at the body's centre [degrees]."""
    middle = centroid(body.shape.vertices, body.shape.faces)
    return np.degrees(angle_between(body.views.body_from_cam.translation - middle, body.views.sun))


def _what(body: ViewedBody, metrics: Mapping[str, Any]) -> list[Fact]:
    """Body, size, surface, images and light."""
    name = (body.body or "unknown body").capitalize()
    frame = "in its body-fixed frame" if body.body_fixed else "images alone determine neither its size nor its poles"
    used = metrics["images_registered"] + metrics["images_placed_by_surface"]
    per_vertex = views_per_vertex(body.shape)
    each = "" if per_vertex is None else f"; a vertex is measured in {per_vertex:.1f} of them"
    return [
        Fact(name="Body", value=name, meaning=frame),
        *_size(body, metrics),
        Fact(
            name="GSD",
            value="of unknown length" if body.shape.from_images_alone else f"{digits(body.gsd)} m",
            meaning="ground sample distance: one reference pixel, the median of all tiles",
        ),
        Fact(
            name="Surface",
            value=f"{metrics['mapped_percent']:.1f} % mapped",
            meaning=f"{100.0 - metrics['mapped_percent']:.1f} % without a map are closed by a smooth guess",
        ),
        Fact(
            name="Images",
            value=f"{number(used)} of {number(metrics['images'])} used",
            meaning=f"{number(metrics['images_placed_by_surface'])} of these placed by the finished surface{each}",
        ),
        Fact(
            name="Tiles",
            value=f"{number(metrics['tiles_mapped'])} of {number(metrics['tiles'])} mapped",
            meaning=f"{number(metrics['landmarks'])} landmarks, {number(metrics['facets'])} facets",
        ),
        Fact(
            name="Light",
            value=f"phase {span(phases_deg(body))}",
            meaning=f"Suns up to {sun_span_deg(body.views):.0f}° apart, as seen from the body",
        ),
        *dark_level(body.brightness, body.views),
    ]


def views_per_vertex(shape: ShapeModel) -> float | None:
    """Images that measure a vertex, in the mean over those that were mapped; None where the shape does not state it."""
    if shape.views is None:
        return None
    return float(shape.views[shape.views > 0].mean()) if (shape.views > 0).any() else 0.0


def _size(body: ViewedBody, metrics: Mapping[str, Any]) -> list[Fact]:
    """Extents and volume, in metres or kilometres; in GSD where these are not known."""
    extents = np.array([metrics[f"{name}_extent"] for name in ("longest", "middle", "shortest")])
    if body.shape.from_images_alone:
        length, unit = 1.0 / body.gsd, "GSD"
    else:
        length, unit = (1.0 / KILO, "km") if extents.max() >= KILO else (1.0, body.shape.unit)
    radius = f"{digits(metrics['mean_radius'] * length)} {unit}"
    volume = with_sigma(metrics["volume"] * length**3, metrics["volume_sigma"] * length**3)
    return [
        Fact(
            name="Size",
            value=f"{' x '.join(digits(each * length) for each in extents)} {unit}",
            meaning=f"along its principal axes of inertia; mean radius {radius}",
        ),
        Fact(
            name="Volume",
            value=f"{volume} {unit}³",
            meaning="one sigma, if heights err alike over a tenth of the mean radius",
        ),
    ]


def _quality(body: ViewedBody, metrics: Mapping[str, Any]) -> list[Fact]:
    """Sigmas, how tiles agree, and renderings."""
    gsd_m = None if body.shape.from_images_alone else body.gsd
    found = stated_sigmas(metrics, gsd_m, _SIGMAS)
    if "step_between_tiles_median_gsd" in metrics:
        value = with_unit(metrics["step_between_tiles_median_gsd"], "gsd", gsd_m)
        meaning = "scatter of heights where tiles overlap, the median"
        found.append(Fact(name="Tiles agree", value=f"to {value}", meaning=meaning))
    if "psnr_mean_db" in metrics:
        worst = f"whole disks against images, worst {metrics['psnr_min_db']:.1f}; 30 dB is 3 % of the peak"
        found.append(Fact(name="PSNR", value=f"{metrics['psnr_mean_db']:.1f} dB", meaning=worst))
    return found
