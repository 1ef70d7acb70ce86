"""The first facts of a report: the mapped ground, the quality of the map, and reasons for distrust."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from photoclinometry.evaluate.illumination import sun_span_deg
from photoclinometry.evaluate.tables import digits, number
from photoclinometry.evaluate.verdict import Judgement, why_with_care
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.output.figures.layers import LAYERS, length_unit
from photoclinometry.output.figures.marks import ground_per_pixel
from photoclinometry.output.report.facts import (
    Fact,
    Overview,
    dark_level,
    span,
    stated_sigmas,
    with_unit,
)
from photoclinometry.output.report.weak_places import WeakPlace, weak_places
from photoclinometry.registration.place import lon_lat_deg
from photoclinometry.surface.relief import local_frame

_SIGMAS = {
    "height": "one sigma of a landmark above the mean plane",
    "normal": "one sigma of its angle to the true one, at one landmark",
    "albedo": "one sigma between places; the level of all errs with the model",
}
_PLACED = "one sigma, with that of the map's place on the body"
_TRUE_ERRORS = (
    ("surface_distance_mean_gsd", "True error of the surface", "mean distance to the truth"),
    ("normal_error_mean_deg", "True error of normals", "mean angle to the truth"),
    ("albedo_error_mean_percent", "True error of albedos", "mean difference from the truth"),
)


def overview(
    scene: Scene,
    metrics: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    judgement: Judgement | None = None,
) -> Overview[WeakPlace]:
    """The overview of a scene. metrics: its figures; rows: of its views; judgement: all as `ReportContent` has them."""
    if judgement is None:
        judgement = Judgement(care=tuple(why_with_care(scene, metrics)))
    return Overview(
        verdict=judgement.verdict,
        reasons=judgement.reasons,
        warnings=tuple(warned.line for warned in judgement.warnings),
        what=(*_what(scene, rows), *_optics(metrics)),
        quality=tuple(_quality(scene, metrics)),
        places=weak_places(scene),
    )


def light(scene: Scene) -> dict[str, np.ndarray]:
    """Incidence, emission and phase (K,) [degrees] of every view on the mean plane, in the middle of the map."""
    frame = local_frame(scene)
    mu0, mu, phase = photometric_angles(
        scene.views.sun, scene.views.body_from_cam.translation, frame.translation, frame.rotation[:, 2]
    )
    cosines = np.clip([mu0, mu], -1.0, 1.0)
    incidence, emission = np.degrees(np.arccos(cosines))
    return {"incidence": incidence, "emission": emission, "phase": np.degrees(phase)}


def _what(scene: Scene, rows: Sequence[Mapping[str, Any]]) -> list[Fact]:
    """Body, place, size, resolution, views and light."""
    factor, unit = length_unit(scene)
    width, height = ground_per_pixel(scene) * (scene.region.width, scene.region.height) * factor
    scale, shown = (1e-3, "km") if unit == "m" and max(width, height) >= 1000.0 else (1.0, unit)
    relief = np.ptp(np.percentile(LAYERS["height"].values(scene), [1.0, 99.0]))
    counts = {"held out": "held_out", "left out": "left_out"}
    others = {name: sum(1 for row in rows if row.get(key)) for name, key in counts.items()}
    views = [f"{len(scene.views)} used", *(f"{count} {name}" for name, count in others.items() if count)]
    per_landmark = len(scene.tracks) / max(1, len(scene.landmarks))
    spans = [f"{name} {span(values)}" for name, values in light(scene).items()]
    gsd = f"{digits(scene.gsd)} m" if unit == "m" else "of unknown length"
    return [
        Fact(name="Body", value=_where(scene)),
        Fact(name="Size", value=f"{digits(width * scale)} x {digits(height * scale)} {shown}"),
        Fact(name="GSD", value=gsd, meaning="ground sample distance: one reference pixel"),
        Fact(name="Relief", value=f"{digits(relief)} {unit}", meaning="from the lowest to the highest 1 % of heights"),
        Fact(
            name="Landmarks",
            value=number(len(scene.landmarks)),
            meaning="each with position, normal and albedo" if scene.reflectance else "each with position and normal",
        ),
        Fact(name="Views", value=", ".join(views), meaning=f"a landmark is measured in {per_landmark:.1f} of them"),
        Fact(
            name="Light",
            value=", ".join(spans),
            meaning=f"Suns up to {sun_span_deg(scene.views):.0f}° apart",
        ),
        *dark_level(scene.brightness, scene.views),
    ]


def _optics(metrics: Mapping[str, Any]) -> list[Fact]:
    """The width of the point-spread function, where fine relief was restored with it."""
    sigma_px = metrics.get("psf_sigma_px")
    if sigma_px is None:
        return []
    meaning = "one sigma; what it and the pixels take from the finest relief is restored"
    return [Fact(name="Point-spread function", value=f"{sigma_px:.2f} px", meaning=meaning)]


def _where(scene: Scene) -> str:
    """The body, and the place on it where that is known."""
    body = (scene.body or "unknown body").capitalize()
    if scene.frame != BODY_FIXED:
        return f"{body}, at an unknown place: images alone determine neither scale nor place"
    lon, lat = lon_lat_deg(local_frame(scene).translation)
    return f"{body}, {lon % 360.0:.2f}° E, {abs(lat):.2f}° {'N' if lat >= 0 else 'S'}"


def _quality(scene: Scene, metrics: Mapping[str, Any]) -> list[Fact]:
    """Sigmas, renderings, completeness, and errors where the truth is known."""
    gsd_m = scene.gsd if scene.unit else None
    placed = {"height": _PLACED} if scene.frame == BODY_FIXED else {}
    found = stated_sigmas(metrics, gsd_m, _SIGMAS | placed)
    if "psnr_mean_db" in metrics:
        worst = f"renderings against images, worst {metrics['psnr_min_db']:.1f}; 40 dB is 1 % of the peak"
        found.append(Fact(name="PSNR, used", value=f"{metrics['psnr_mean_db']:.1f} dB", meaning=worst))
    if "psnr_held_out_mean_db" in metrics:
        meaning = "images that the map was not made from"
        found.append(Fact(name="PSNR, held out", value=f"{metrics['psnr_held_out_mean_db']:.1f} dB", meaning=meaning))
    if "completeness_percent" in metrics:
        meaning = "of the lit pixels of the region carry a landmark"
        found.append(Fact(name="Completeness", value=f"{metrics['completeness_percent']:.1f} %", meaning=meaning))
    if "relief_over_parallax" in metrics:
        value = f"{metrics['relief_over_parallax']:.2f} ± {metrics['relief_over_parallax_sigma']:.2f}"
        meaning = "heights by brightness over heights by parallax alone; 1 if they agree"
        found.append(Fact(name="Relief, checked", value=value, meaning=meaning))
    for key, title, meaning in _TRUE_ERRORS:
        if key in metrics:
            value = with_unit(metrics[key], key.rpartition("_")[2], gsd_m)
            found.append(Fact(name=title, value=value, meaning=meaning))
    return found
