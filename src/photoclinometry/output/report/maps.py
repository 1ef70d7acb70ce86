"""Figures of maps on the reference grid: image, albedo, normals, slope, height, errors, coverage, relit views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from photoclinometry.evaluate.evaluate import landmark_photometric_error
from photoclinometry.evaluate.tables import split_unit, words
from photoclinometry.model.scene import Image, Region, Scene
from photoclinometry.output.report.draw import (
    MISSING,
    add_bar,
    bare,
    colour_map,
    limits,
    one_panel,
    panels,
    region_extent,
    save,
    show_map,
    style,
)
from photoclinometry.photometry.render import render_reference
from photoclinometry.surface.relief import height_map, lambert_shade, local_frame, sun_from_angles

_STEEP_PERCENT = 98.0
"""Percentile of values at which a colour scale ends; the steepest and worst few saturate."""
_SLOPE_PERCENT = 99.5
"""As above, of slopes and of brightness, whose tails are short."""
_HILLSHADE_SUN_DEG = (315.0, 35.0)
"""Azimuth and elevation of the light of hillshades: from the upper left, the cartographers' convention."""
_HILLSHADE_MIX = (0.35, 0.65, 1.45)
"""Colour of a hillshaded map: share without light, share by shade over its median, and upper limit."""
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


def draw_albedo(path: Path, scene: Scene) -> Path:
    """Normal albedo, or relative albedo of uncalibrated images."""
    albedo = scene.grid(scene.landmarks.albedo)
    label = "normal albedo (I/F)" if scene.brightness == "iof" else "relative albedo"
    return draw_one(path, albedo, scene.region, "Albedo", label)


def local_normals(scene: Scene) -> np.ndarray:
    """Normals (h, w, 3) in the local frame of `relief`: right, up in the reference image, out of the ground."""
    return scene.grid(scene.landmarks.normal) @ local_frame(scene).rotation


def normal_colours(scene: Scene) -> np.ndarray:
    """Normals as colours (h, w, 3): red to the right, green up in the image, blue out of the ground.

    Both components along the ground are stretched by one factor, so that the steepest two percent saturate.
    """
    normal = local_normals(scene)
    across = limits(np.hypot(normal[..., 0], normal[..., 1]), high=_STEEP_PERCENT, zero=True)[1]
    red, green = (0.5 + 0.5 * normal[..., k] / across for k in (0, 1))
    colour = np.clip(np.stack([red, green, normal[..., 2]], -1), 0.0, 1.0)
    return np.where(np.isfinite(colour), colour, MISSING)


def draw_normals(path: Path, scene: Scene) -> Path:
    """The colours of `normal_colours`."""
    return draw_one(path, normal_colours(scene), scene.region, "Normals")


def draw_slope(path: Path, scene: Scene) -> Path:
    """Angle between normals and the normal of the mean plane."""
    normal = local_normals(scene)
    slope = np.degrees(np.arctan2(np.hypot(normal[..., 0], normal[..., 1]), normal[..., 2]))
    clim = limits(slope, high=_SLOPE_PERCENT, zero=True)
    return draw_one(path, slope, scene.region, "Slope against the mean plane", "degrees", "inferno", clim)


def draw_height(path: Path, scene: Scene, unit: str | None) -> Path:
    """Heights over a hillshade from the upper left, in the scene's unit, or in GSD if `unit` is None."""
    height = height_map(scene) if unit else height_map(scene) / scene.gsd
    frame = local_frame(scene)
    sun = frame.rotation.T @ sun_from_angles(frame, *np.deg2rad(_HILLSHADE_SUN_DEG))
    shade = lambert_shade(local_normals(scene), sun)
    dark, by_shade, brightest = _HILLSHADE_MIX
    low, high = limits(height)
    colour = colour_map("viridis")(np.clip((height - low) / (high - low), 0.0, 1.0))[..., :3]
    relief = np.clip(dark + by_shade * shade / np.nanmedian(shade), 0.0, brightest)[..., None]
    mixed = np.where(np.isfinite(height)[..., None], np.clip(colour * relief, 0.0, 1.0), MISSING)
    with style():
        figure, axes = one_panel(scene.region.height / scene.region.width)
        show_map(axes, mixed, scene.region, "Height above the mean plane, hillshaded")
        bar = ScalarMappable(Normalize(low, high), colour_map("viridis"))
        add_bar(axes, bar, height, unit or "GSD (reference pixels)")
        return save(figure, path)


def draw_photometric_error(path: Path, scene: Scene) -> Path:
    """Photometric error (Eq. 39) without scale and bias [%]."""
    percent = 100.0 * scene.grid(landmark_photometric_error(scene, remove_scale_and_bias=True))
    clim = limits(percent, high=_STEEP_PERCENT, zero=True)
    title = "Photometric error (Eq. 39)"
    return draw_one(path, percent, scene.region, title, "% of brightness", "magma", clim)


def draw_coverage(path: Path, scene: Scene) -> Path:
    """Number of views per landmark."""
    count = scene.grid(np.diff(scene.tracks.start))
    clim = (0.0, float(len(scene.views)))
    return draw_one(path, count, scene.region, "Views per landmark", "views", "viridis", clim)


def draw_landmark_values(path: Path, scene: Scene, name: str, values: np.ndarray) -> Path:
    """Values (J,) of landmarks, such as errors against truth; `name` ends in the unit."""
    quantity, unit = split_unit(name)
    signed = np.nanmin(values, initial=0.0) < 0
    grid = scene.grid(values)
    if signed:
        top = limits(np.abs(grid), high=_STEEP_PERCENT, zero=True)[1]
        return draw_one(path, grid, scene.region, words(quantity).capitalize(), unit, "RdBu_r", (-top, top))
    clim = limits(grid, high=_STEEP_PERCENT, zero=True)
    return draw_one(path, grid, scene.region, words(quantity).capitalize(), unit, "magma", clim)


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
                top = limits(image, high=_SLOPE_PERCENT, zero=True)[1]
                panel = bare(axes[i, j], f"azimuth {azimuth:.0f}°, elevation {elevation:.0f}°")
                panel.imshow(image, cmap=colour_map("gray"), vmin=0.0, vmax=top, extent=region_extent(scene.region))
        return save(figure, path)


def draw_maps(folder: Path, scene: Scene, image: Image | None, unit: str | None) -> list[tuple[str, str]]:
    """All maps of a scene as files in `folder`: (file name, caption) of each, in the page's order."""
    figures = []
    if image is not None:
        draw_reference(folder / "reference.png", scene, image)
        figures.append(("reference.png", f"The region of {scene.views.name[scene.reference]}, the reference image."))
    if scene.reflectance is not None:
        draw_albedo(folder / "albedo.png", scene)
        figures.append(("albedo.png", "Albedo. Shading of the relief must not be visible in it."))
    draw_height(folder / "height.png", scene, unit)
    figures.append(("height.png", "Height above the robust mean plane; hillshade from the upper left."))
    draw_normals(folder / "normals.png", scene)
    caption = "Normals. Red: facing right, green: up in the image (both stretched), blue: out of the ground."
    figures.append(("normals.png", caption))
    draw_slope(folder / "slope.png", scene)
    figures.append(("slope.png", "Slope against the mean plane."))
    if scene.reflectance is not None:
        draw_photometric_error(folder / "photometric_error.png", scene)
        figures.append(
            ("photometric_error.png", "Photometric error of each landmark (Eq. 39), scale and bias removed.")
        )
    draw_coverage(folder / "views_per_landmark.png", scene)
    figures.append(("views_per_landmark.png", "Number of views that measure each landmark."))
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
