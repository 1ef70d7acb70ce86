"""Pictures: the functions of `import photoclinometry` that render a map, and that draw it with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from photoclinometry.api.given import given_scene, view_index
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.option_fields import changed
from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.options import FigureOptions
from photoclinometry.photometry.render import render_reference, render_view
from photoclinometry.pipeline.products import RunResult
from photoclinometry.surface.relief import local_frame, sun_from_angles


def render(
    scene: RunResult | Scene | str | Path,
    *,
    view: str | None = None,
    sun: Sequence[float] | np.ndarray | None = None,
    sun_azimuth_deg: float | None = None,
    sun_elevation_deg: float | None = None,
    geometry: Literal["camera", "reference"] = "camera",
    cast_shadows: bool = False,
) -> Image:
    """Render a map as a camera sees it, under its own Sun or any other.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene by itself.
        view: Name of the view whose camera, Sun, scale and bias to use. Default: the reference view.
        sun: Direction (3,) towards the Sun in the body-fixed frame, of any length.
        sun_azimuth_deg: Sun's azimuth, clockwise from up in the reference image, along the map's mean plane.
        sun_elevation_deg: Sun's elevation above the map's mean plane; goes with the azimuth.
        geometry: "camera" draws the view's whole image; "reference" the map's own grid of reference pixels.
        cast_shadows: Also darken what lies in the shadow of other ground of the map.

    Returns:
        Brightness in the unit of the scene's images; `valid` is where the map is.

    Raises:
        InputError: There is no such view, the Sun is not a direction, or the scene has no reflectance model.
    """
    scene = given_scene(scene)
    index = view_index(scene, view)
    towards = _sun_direction(scene, sun, sun_azimuth_deg, sun_elevation_deg)
    draw = {"camera": render_view, "reference": render_reference}.get(geometry)
    if draw is None:
        raise InputError(f'geometry {geometry!r}: must be "camera" or "reference"')
    brightness, there = draw(scene, index, towards, cast_shadows=cast_shadows)
    return Image(scene.views.name[index], brightness.astype(np.float32), there)


def plot(
    scene: RunResult | Scene | str | Path,
    layer: str,
    *,
    ax: Any = None,
    view: str | None = None,
    clim: tuple[float, float] | None = None,
    marks: bool = True,
) -> Any:
    """Draw a layer of a map on matplotlib's axes, with colour bar, scale bar and arrows.

    The axes count pixels of the reference image. Places without a landmark stay blank.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        layer: "albedo", "relief" (shaded), "height", "slope", "normals", "height-sigma", "normal-sigma",
            "albedo-sigma", "views" or "residual".
        ax: The axes to draw on. Default: those of a new figure of matplotlib.pyplot.
        view: Name of the view whose Sun an arrow shows, and which lights the relief of "relief" and "height". Default:
            no arrow, and light from the upper left.
        clim: Ends of the colour scale, in the layer's unit. Default: by percentiles.
        marks: Draw the scale bar, and the arrows to the north (in the body-fixed frame) and to the Sun.

    Returns:
        The axes.

    Raises:
        InputError: There is no such layer or view, or the scene does not hold what the layer shows.
    """
    from photoclinometry.output.figures.maps import plot_layer

    scene = given_scene(scene)
    index = None if view is None else view_index(scene, view)
    return plot_layer(ax or _new_axes(), scene, layer, view=index, clim=clim, marks=marks)


def plot_profile(
    scene: RunResult | Scene | str | Path,
    start: tuple[float, float],
    end: tuple[float, float],
    *,
    layer: str = "height",
    ax: Any = None,
) -> Any:
    """Draw a layer along a line of a map, with a band of one standard deviation.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        start: One end (x, y) in pixels of the reference image, as the axes of `plot` count them.
        end: The other end.
        layer: As of `plot`, but for "normals".
        ax: The axes to draw on. Default: those of a new figure of matplotlib.pyplot.

    Returns:
        The axes: distances along the map's mean plane in metres, or in GSD, and values in the layer's unit.

    Raises:
        InputError: There is no such layer, the ends are one place, or the line misses the map.
    """
    from photoclinometry.output.figures import profile

    return profile.plot_profile(ax or _new_axes(), given_scene(scene), start, end, name=layer)


def plot_residuals(
    scene: RunResult | Scene | str | Path,
    *,
    view: str | None = None,
    kind: Literal["brightness", "keypoint"] = "brightness",
    ax: Any = None,
) -> Any:
    """Draw how far measurements are from what a map predicts: of all views, or of one view as a map.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        view: Name of the view to draw as a map. Default: all views side by side; boxes hold the middle half of
            their residuals, lines end at the 5th and the 95th percentile.
        kind: "brightness", predicted minus measured in per cent of the view's mean, or "keypoint", distances in pixels.
        ax: The axes to draw on. Default: those of a new figure of matplotlib.pyplot.

    Returns:
        The axes.

    Raises:
        InputError: There is no such view or kind, or the scene has no reflectance model to predict brightness with.
    """
    from photoclinometry.output.figures import residuals

    scene = given_scene(scene)
    index = None if view is None else view_index(scene, view)
    return residuals.plot_residuals(ax or _new_axes(), scene, view=index, kind=kind)


def figure(
    scene: RunResult | Scene | str | Path, out: str | Path, *, options: FigureOptions | None = None, **changes: Any
) -> Path:
    """Write a figure for publication: lettered maps and a profile, at the width of a journal's columns.

    Args:
        scene: The result of `run`, the folder of a finished run or its scene.h5, or a scene.
        out: The file; .pdf, .svg or .png. Text of PDF and SVG files is text, in fonts that lie in the file.
        options: Layers, profile, size and resolution.
        **changes: Fields of `FigureOptions`, such as layers=("albedo", "height"), dpi=600.

    Returns:
        The path of the file.

    Raises:
        InputError: An option is wrong, the scene lacks a layer, the figure does not fit a page, or `out` cannot be
            written.
    """
    from photoclinometry.output.figures.journal import write_figure

    scene, chosen = given_scene(scene), changed(options or FigureOptions(), changes)
    write_figure(Path(out), scene, chosen, None if chosen.view is None else view_index(scene, chosen.view))
    return Path(out)


def _sun_direction(
    scene: Scene, sun: Sequence[float] | np.ndarray | None, azimuth_deg: float | None, elevation_deg: float | None
) -> np.ndarray | None:
    """The Sun asked for as a vector (3,) in B; None for the view's own. Raises InputError."""
    if (azimuth_deg is None) != (elevation_deg is None):
        raise InputError("the Sun's azimuth and elevation go together: give both or none")
    if sun is not None and azimuth_deg is not None:
        raise InputError("the Sun is given twice: give its direction, or azimuth and elevation")
    if sun is not None:
        direction = np.asarray(sun, float)
        if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
            raise InputError(f"Sun {direction.tolist()} is not a direction; give three numbers, not all zero")
        return direction
    if azimuth_deg is None or elevation_deg is None:
        return None
    if not np.isfinite(azimuth_deg):
        raise InputError(f"Sun's azimuth {azimuth_deg} degrees: must be a finite number")
    if not 0.0 < elevation_deg <= 90.0:
        raise InputError(f"Sun's elevation {elevation_deg} degrees: must be above 0 and at most 90 for light to fall")
    return sun_from_angles(local_frame(scene), np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg))


def _new_axes() -> Any:
    """Axes of a new figure, which a notebook and `matplotlib.pyplot.show` show."""
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained")[1]
