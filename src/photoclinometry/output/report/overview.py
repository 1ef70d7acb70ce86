"""What a reader of a report wants to know first: what was mapped, how good it is, and what to distrust."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from photoclinometry.evaluate.tables import number
from photoclinometry.io.dark_level import in_words
from photoclinometry.model.geometry import angle_between
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.output.figures.layers import LAYERS, length_unit
from photoclinometry.output.figures.marks import ground_per_pixel
from photoclinometry.output.report.weak_places import WeakPlace, weak_places
from photoclinometry.registration.place import lon_lat_deg
from photoclinometry.surface.relief import local_frame

SOUND, CARE, WRONG = "Sound", "Usable with care", "Do not trust"
"""Verdicts."""

FEW_VIEWS = 5.0
"""Views per landmark in the mean below which normals and albedos rest on so few measurements that one bad view shows. A
normal and an albedo are three numbers, and each view gives one brightness."""
LITTLE_LIGHT_DEG = 10.0
"""Greatest angle between two Suns below which brightness hardly tells slope from albedo. Under Suns that are 10 degrees
apart ground of 5 degrees slope changes against level ground by 0.17 x 0.09 = 1.5 %, about what maps do not explain."""
ROUGH_NORMAL_DEG, ROUGH_HEIGHT_GSD = 5.0, 0.5
"""Medians of stated sigmas beyond those of any sound simulated site: these have 1 to 2 degrees, and 0.1 GSD."""
UNCHECKED_RELIEF = 0.1
"""Standard deviation of relief over parallax beyond which a relief that is a fifth too low would pass as sound. Maps of
100 x 100 landmarks have 0.01 to 0.05."""
SPARSE_PERCENT = 80.0
"""Share of the lit region below which a map is full of holes."""
POOR_PSNR_DB, WORSE_BY_DB = 30.0, 6.0
"""Mean PSNR below which renderings differ from images by more than 3 % of the peak (sound simulated sites have 40 dB);
and how much worse held-out views may be: twice the error."""
_SIGMAS = (
    ("height", "gsd", "Heights", "one sigma of a landmark above the mean plane"),
    ("normal", "deg", "Normals", "one sigma over both axes, at one landmark"),
    ("albedo", "percent", "Albedos", "one sigma between places; the level of all errs with the model"),
)
_PLACED = "one sigma, with that of the map's place on the body"
_TRUE_ERRORS = (
    ("surface_distance_mean_gsd", "True error of the surface", "mean distance to the truth"),
    ("normal_error_mean_deg", "True error of normals", "mean angle to the truth"),
    ("albedo_error_mean_percent", "True error of albedos", "mean difference from the truth"),
)


@dataclass(frozen=True, kw_only=True)
class Fact:
    """One line of the overview."""

    name: str
    value: str
    meaning: str = ""
    """Half a sentence."""


@dataclass(frozen=True, kw_only=True)
class Overview:
    """The first screen of a report, in words."""

    verdict: str
    """SOUND, CARE or WRONG."""
    reasons: tuple[str, ...]
    """Why the map is not to be trusted, or what to take care of. Empty for a sound map."""
    warnings: tuple[str, ...]
    what: tuple[Fact, ...]
    quality: tuple[Fact, ...]
    places: tuple[WeakPlace, ...]
    """The worst places of the map."""


def overview(
    scene: Scene,
    metrics: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    warnings: Sequence[str] = (),
    distrust: Sequence[str] = (),
) -> Overview:
    """The overview of a scene. metrics: its figures; rows: of its views, as `ReportContent` has both."""
    care = _care(scene, metrics)
    verdict = WRONG if distrust else CARE if warnings or care else SOUND
    return Overview(
        verdict=verdict,
        reasons=(*distrust, *care),
        warnings=tuple(warnings),
        what=tuple(_what(scene, rows)),
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


def sun_span_deg(scene: Scene) -> float:
    """The greatest angle between the Suns of two views [degrees]."""
    sun = scene.views.sun
    return float(np.degrees(angle_between(sun[:, None], sun[None])).max())


def digits(value: float, count: int = 3) -> str:
    """So many significant digits, and all before the point; never in scientific notation."""
    if not np.isfinite(value) or value == 0.0:
        return number(value)
    return f"{value:,.{max(0, count - 1 - int(np.floor(np.log10(abs(value)))))}f}".replace(",", "\u202f")


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
    spans = [f"{name} {_span(values)}" for name, values in light(scene).items()]
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
            meaning=f"Suns up to {sun_span_deg(scene):.0f}° apart",
        ),
        *_dark_level(scene),
    ]


def _dark_level(scene: Scene) -> list[Fact]:
    """Of uncalibrated images."""
    if scene.brightness == "iof":
        return []
    level, meaning = in_words(scene.views.dark_level)
    return [Fact(name="Dark level", value=level, meaning=meaning)]


def _where(scene: Scene) -> str:
    """The body, and the place on it where that is known."""
    body = (scene.body or "unknown body").capitalize()
    if scene.frame != BODY_FIXED:
        return f"{body}, at an unknown place: images alone tell neither scale nor place"
    lon, lat = lon_lat_deg(local_frame(scene).translation)
    return f"{body}, {lon % 360.0:.2f}° E, {abs(lat):.2f}° {'N' if lat >= 0 else 'S'}"


def _span(values: np.ndarray) -> str:
    low, high = np.round([values.min(), values.max()])
    return f"{low:.0f}°" if low == high else f"{low:.0f} to {high:.0f}°"


def _quality(scene: Scene, metrics: Mapping[str, Any]) -> list[Fact]:
    """Sigmas, renderings, completeness, and errors where the truth is known."""
    found = []
    for name, unit, title, meaning in _SIGMAS:
        value = metrics.get(f"{name}_sigma_median_{unit}")
        if value is not None:
            meaning = _PLACED if name == "height" and scene.frame == BODY_FIXED else meaning
            found.append(Fact(name=title, value=f"± {_with_unit(scene, value, unit)}", meaning=meaning))
    if not found:
        found.append(Fact(name="Uncertainties", value="unknown", meaning="the run did not compute any"))
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
            found.append(
                Fact(name=title, value=_with_unit(scene, metrics[key], key.rpartition("_")[2]), meaning=meaning)
            )
    return found


def _with_unit(scene: Scene, value: float, unit: str) -> str:
    """A figure with its unit; lengths in GSD in metres, too, where these are known."""
    if unit == "gsd":
        metres = f" = {digits(value * scene.gsd, 2)} m" if scene.unit else ""
        return f"{digits(value, 2)} GSD{metres}"
    return f"{digits(value, 2)}{'°' if unit == 'deg' else ' %'}"


def _care(scene: Scene, metrics: Mapping[str, Any]) -> list[str]:
    """What makes a map that nothing is wrong with less than sound."""
    found, photometric = [], scene.reflectance is not None
    per_landmark, span = len(scene.tracks) / max(1, len(scene.landmarks)), sun_span_deg(scene)
    if per_landmark < FEW_VIEWS:
        found.append(f"few views: {per_landmark:.1f} measure a landmark, {FEW_VIEWS:.0f} or more are good")
    if photometric and span < LITTLE_LIGHT_DEG:
        found.append(f"the light hardly changes: Suns are at most {span:.1f}° apart, so that albedo may contain slope")
    if not scene.uncertainty:
        found.append("no uncertainties were computed")
    if metrics.get("normal_sigma_median_deg", 0.0) > ROUGH_NORMAL_DEG:
        found.append(f"normals are uncertain: {digits(metrics['normal_sigma_median_deg'])}° in the median")
    if scene.frame != BODY_FIXED and metrics.get("height_sigma_median_gsd", 0.0) > ROUGH_HEIGHT_GSD:
        found.append(f"heights are uncertain: {digits(metrics['height_sigma_median_gsd'])} GSD in the median")
    unsure = metrics.get("relief_over_parallax_sigma", 0.0)
    if unsure > UNCHECKED_RELIEF:
        found.append(f"parallax checks the relief to {100.0 * unsure:.0f} % only: it may be too high or too low")
    if metrics.get("completeness_percent", 100.0) < SPARSE_PERCENT:
        found.append(f"{100.0 - metrics['completeness_percent']:.0f} % of the lit region are not mapped")
    quality, held_out = metrics.get("psnr_mean_db"), metrics.get("psnr_held_out_mean_db")
    if quality is not None and quality < POOR_PSNR_DB:
        found.append(f"renderings differ from the images: mean PSNR {quality:.1f} dB")
    if quality is not None and held_out is not None and held_out < quality - WORSE_BY_DB:
        found.append(f"held-out views are predicted {quality - held_out:.1f} dB worse than those that were used")
    return found
