"""Figures of maps on the reference grid: image, albedo, normals, slope, height, errors, coverage, relit views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.patches import Rectangle

from photoclinometry.evaluate.tables import split_unit, words
from photoclinometry.model.image import Image
from photoclinometry.model.region import Region
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.output.figures.draw import (
    bare,
    colour_map,
    limits,
    mark_number,
    one_panel,
    panels,
    region_extent,
    save,
    show_map,
    style,
    symmetric_limits,
)
from photoclinometry.output.figures.layers import LAYERS, SHORT_TAIL_PERCENT, STEEP_PERCENT
from photoclinometry.output.figures.maps import plot_layer
from photoclinometry.output.report.weak_places import WeakPlace
from photoclinometry.photometry.render import render_reference
from photoclinometry.surface.relief import local_frame, sun_from_angles

RELIGHT_AZIMUTHS_DEG = (0.0, 90.0, 180.0, 270.0)
RELIGHT_ELEVATIONS_DEG = (60.0, 30.0, 12.0)


def draw_one(
    path: Path,
    values: np.ndarray,
    region: Region,
    title: str,
    label: str = "",
    cmap: str = "gray",
    clim: tuple[float, float] | None = None,
) -> Path:
    """A single map as a file."""
    with style():
        figure, axes = one_panel(region.height / region.width)
        show_map(axes, values, region, title, label=label, cmap=cmap, clim=clim)
        return save(figure, path)


def draw_reference(path: Path, scene: Scene, image: Image) -> Path:
    """The brightness of the reference image over the region."""
    brightness = np.where(image.valid, image.brightness, np.nan)[scene.region.slices]
    unit = "I/F" if scene.brightness == "iof" else "DN (linear)"
    return draw_one(path, brightness, replace(scene.region, stride=1), "Reference image", unit)


def draw_layer(path: Path, scene: Scene, name: str) -> Path:
    """A layer of `figures.layers.LAYERS` with its scale bar, and the arrow to the north where that is known."""
    with style():
        figure, axes = one_panel(scene.region.height / scene.region.width)
        plot_layer(axes, scene, name)
        return save(figure, path)


def draw_overview(path: Path, scene: Scene, places: Sequence[WeakPlace]) -> str:
    """Heights under the Sun of the reference view, with the worst places numbered; returns the caption."""
    with style():
        figure, axes = one_panel(scene.region.height / scene.region.width)
        plot_layer(axes, scene, "height", view=scene.reference)
        for count, place in enumerate(places, 1):
            for color, width in (("white", 2.6), ("black", 1.2)):
                axes.add_patch(Rectangle(place.corner, *place.size, fill=False, edgecolor=color, linewidth=width))
            x, y = np.array(place.corner) + 0.5 * np.array(place.size)
            mark_number(axes, count, (x, y))
        save(figure, path)
    north = "; N is north" if scene.frame == BODY_FIXED else "; north is not known"
    numbered = " Squares: the worst places." if places else ""
    return f"Heights, lit by the Sun of the reference image {scene.views.name[scene.reference]}{north}.{numbered}"


def draw_landmark_values(path: Path, scene: Scene, name: str, values: np.ndarray) -> Path:
    """Values (J,) of landmarks, such as errors against truth; `name` ends in the unit."""
    quantity, unit = split_unit(name)
    signed = np.nanmin(values, initial=0.0) < 0
    grid = scene.grid(values)
    if signed:
        cmap, clim = "RdBu_r", symmetric_limits(grid, STEEP_PERCENT)
    else:
        cmap, clim = "magma", limits(grid, high=STEEP_PERCENT, zero=True)
    return draw_one(path, grid, scene.region, words(quantity).capitalize(), unit, cmap, clim)


def draw_relit(path: Path, scene: Scene) -> Path:
    """The map in the reference camera under other Suns, with cast shadows (paper, Fig. 13)."""
    frame = local_frame(scene)
    rows, cols = len(RELIGHT_ELEVATIONS_DEG), len(RELIGHT_AZIMUTHS_DEG)
    with style():
        aspect = scene.region.height / scene.region.width
        figure, axes = panels(rows, cols, 2.5, aspect, (0.12, 0.32), (0.05, 0.05, 0.05, 0.3))
        for i, elevation in enumerate(RELIGHT_ELEVATIONS_DEG):
            for j, azimuth in enumerate(RELIGHT_AZIMUTHS_DEG):
                sun = sun_from_angles(frame, np.deg2rad(azimuth), np.deg2rad(elevation))
                image, mask = render_reference(scene, sun=sun, with_scale_and_bias=False, cast_shadows=True)
                image = np.where(mask, image, np.nan)
                top = limits(image, high=SHORT_TAIL_PERCENT, zero=True)[1]
                panel = bare(axes[i, j], f"azimuth {azimuth:.0f}°, elevation {elevation:.0f}°")
                panel.imshow(image, cmap=colour_map("gray"), vmin=0.0, vmax=top, extent=region_extent(scene.region))
        return save(figure, path)


MAPS = {
    "albedo": "albedo.png",
    "height": "height.png",
    "normals": "normals.png",
    "slope": "slope.png",
    "residual": "photometric_error.png",
    "views": "views_per_landmark.png",
}
"""Layers on the page, in its order, and the names of their files."""


def draw_maps(folder: Path, scene: Scene, image: Image | None) -> list[tuple[str, str]]:
    """All maps of a scene as files in `folder`: (file name, caption) of each, in the page's order."""
    figures = []
    if image is not None:
        draw_reference(folder / "reference.png", scene, image)
        figures.append(("reference.png", f"The region of {scene.views.name[scene.reference]}, the reference image."))
    for name, file in MAPS.items():
        if LAYERS[name].lacks(scene) is None:
            draw_layer(folder / file, scene, name)
            figures.append((file, LAYERS[name].about))
    return figures


def draw_values(folder: Path, scene: Scene, values: Mapping[str, np.ndarray], kind: str) -> list[tuple[str, str]]:
    """One map per entry of `values` that has one number per landmark: (file name, caption) of each."""
    figures = []
    for name, value in values.items():
        if value.shape == (len(scene.landmarks),) and np.isfinite(value).any():
            file = f"{kind}_{name}.png".replace("/", "_")
            draw_landmark_values(folder / file, scene, name, value)
            figures.append((file, f"{words(kind).capitalize()}: {words(split_unit(name)[0])}."))
    return figures
