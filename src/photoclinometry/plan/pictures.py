"""Pictures of a plan: maps of the sigmas, the sky of Suns and cameras, and the gain by candidates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from photoclinometry.output.figures.draw import add_bar, colour_map, limits, panels, save, set_missing, show_map, style
from photoclinometry.plan.candidates import Gain, view_angles
from photoclinometry.plan.run import Plan

TITLES = {
    "height": ("Sigma of height", "GSD"),
    "normal": ("Sigma of normal", "degrees"),
    "albedo": ("Sigma of albedo", "%"),
}
DROPS = {"height": "heights", "normal": "normals", "albedo": "albedos"}

_BARS = 20
"""Candidates in the chart of bars: more could not be distinguished."""
_SKY_IN = 3.4
"""Diameter of a sky [inch]."""
_WIDE_DEG = 75.0
"""Zenith angle to which a sky reaches at least."""


def draw_plan(folder: Path, plan: Plan) -> list[Path]:
    """All pictures of a plan in a folder, which exists."""
    drawn = [draw_sigmas(folder / "sigmas.png", plan), draw_light(folder / "light.png", plan)]
    if plan.gains:
        drawn.append(draw_candidates(folder / "candidates.png", plan.gains, plan.options.kind))
        for tries in ("Sun", "camera"):
            of_kind = [gain for gain in plan.gains if gain.candidate.tries == tries]
            if len(of_kind) > 1:
                drawn.append(draw_sky(folder / f"candidate_{tries.lower()}s.png", of_kind, tries))
    return drawn


def draw_sigmas(path: Path, plan: Plan) -> Path:
    """Maps of the sigmas of the representative map, and of its lit views per landmark."""
    scene = plan.forecast.scene
    count = np.bincount(scene.tracks.landmark, plan.forecast.adjustment.lit, len(scene.landmarks))
    with style():
        figure, axes = panels(2, 2, 3.0, 1.0, (1.5, 0.75), (0.6, 0.9, 0.5, 0.3))
        set_missing(axes)
        for place, (kind, sigma) in zip(axes.ravel(), plan.forecast.sigmas().items(), strict=False):
            title, unit = TITLES[kind]
            values = scene.grid(np.where(np.isfinite(sigma), sigma, np.nan))
            show_map(place, values, scene.region, title, label=unit, cmap="magma", clim=limits(values, zero=True))
        views = (0.0, float(len(scene.views)))
        show_map(
            axes[1, 1],
            scene.grid(count),
            scene.region,
            "Lit views per landmark",
            label="views",
            cmap="viridis",
            clim=views,
        )
        for place in axes.ravel():
            place.set_xlabel("map column [reference px]")
            place.set_ylabel("map row [reference px]")
        return save(figure, path)


def draw_light(path: Path, plan: Plan) -> Path:
    """Directions of the Suns and the cameras of the views from the place, with lines between those of one view."""
    views = plan.forecast.scene.views
    angles = [view_angles(views, k) for k in range(len(views))]
    with style():
        figure, axes = _skies(1, max(max(a["incidence_deg"], a["emission_deg"]) for a in angles), right=1.9)
        for number, each in enumerate(angles):
            sun = np.radians(each["sun_azimuth_deg"]), each["incidence_deg"]
            camera = np.radians(each["camera_azimuth_deg"]), each["emission_deg"]
            axes[0].plot(*zip(sun, camera, strict=True), color="0.75", linewidth=0.6, zorder=1)
            label = ("Sun", "camera") if number == 0 else (None, None)
            axes[0].scatter(*sun, marker="o", s=36, color="#e69f00", edgecolor="black", linewidth=0.4, label=label[0])
            axes[0].scatter(
                *camera, marker="^", s=30, color="#0072b2", edgecolor="black", linewidth=0.4, label=label[1]
            )
        axes[0].set_title("Suns and cameras over the place", pad=14)
        axes[0].legend(loc="upper left", bbox_to_anchor=(1.08, 1.0), frameon=False)
        return save(figure, path)


def draw_candidates(path: Path, gains: Sequence[Gain], kind: str) -> Path:
    """The gain by the best candidates, a group of bars each."""
    shown = list(gains[:_BARS])
    with style():
        figure = Figure(figsize=(6.6, 1.1 + 0.3 * len(shown)))
        axes = figure.add_axes((0.24, 0.62 / (1.1 + 0.3 * len(shown)), 0.72, 1.0 - 1.0 / (1.1 + 0.3 * len(shown))))
        row = np.arange(len(shown))
        for n, (name, words) in enumerate(DROPS.items()):
            values = [gain.drop_percent[name] for gain in shown]
            axes.barh(row + 0.27 * (n - 1), values, 0.25, label=words, color=("#0072b2", "#d55e00", "#009e73")[n])
        axes.set_yticks(row, [gain.candidate.name for gain in shown])
        axes.invert_yaxis()
        axes.axvline(0.0, color="black", linewidth=0.6)
        axes.set_xlabel("drop of the mean sigma by one more image [%]")
        axes.set_title(f"Candidates, ranked by {DROPS[kind]}")
        axes.legend(loc="lower right", frameon=False)
        return save(figure, path)


def draw_sky(path: Path, gains: Sequence[Gain], tries: str) -> Path:
    """The gain by candidates over the direction of their Sun, or their camera: a sky for each kind of sigma."""
    azimuth, zenith = ("sun_azimuth_deg", "incidence_deg") if tries == "Sun" else ("camera_azimuth_deg", "emission_deg")
    at = np.radians([gain.angles[azimuth] for gain in gains]), [gain.angles[zenith] for gain in gains]
    with style():
        figure, axes = _skies(len(DROPS), max(at[1]), right=0.9)
        for place, (name, words) in zip(axes, DROPS.items(), strict=True):
            values = np.array([gain.drop_percent[name] for gain in gains])
            low, high = min(0.0, values.min()), max(values.max(), 1e-6)
            dots = place.scatter(
                *at, c=values, s=110, cmap=colour_map("viridis"), vmin=low, vmax=high, edgecolor="black", linewidth=0.4
            )
            place.set_title(f"{words}: drop of the mean sigma", pad=14)
            add_bar(place, dots, values, "%")
        return save(figure, path)


def _skies(count: int, widest_deg: float, right: float) -> tuple[Figure, list[Any]]:
    """Polar axes, north up, azimuths clockwise, the zenith in the middle. right: room for a bar or a legend [inch]."""
    left, bottom, top, wide = 0.45, 0.4, 0.6, _SKY_IN
    width, height = count * (left + wide + right), bottom + wide + top
    figure = Figure(figsize=(width, height))
    axes = []
    for n in range(count):
        x = n * (left + wide + right) + left
        place: Any = figure.add_axes((x / width, bottom / height, wide / width, wide / height), projection="polar")
        place.set_theta_zero_location("N")
        place.set_theta_direction(-1)
        place.set_rlim(0.0, min(90.0, max(_WIDE_DEG, 5.0 + widest_deg)))
        place.set_rgrids([30.0, 60.0], ["30°", "60°"], angle=112.5, color="0.4")
        place.set_thetagrids(range(0, 360, 45), ["N", "45°", "E", "135°", "S", "225°", "W", "315°"])
        place.grid(True, color="0.88", linewidth=0.6)
        place.set_axisbelow(True)
        axes.append(place)
    return figure, axes
