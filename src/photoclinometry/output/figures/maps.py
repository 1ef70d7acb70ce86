"""A layer of a map on axes: its colours with their bar, contours, scale bar and arrows."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.draw import add_bar, colour_map, limits, region_extent, show_map, transparent
from photoclinometry.output.figures.layers import STEEP_PERCENT, Layer, find_layer, length_unit, local_normal, shade
from photoclinometry.output.figures.marks import add_marks

_HILLSHADE_MIX = (0.35, 0.65, 1.45)
"""Colour of a hillshaded map: share without light, share by shade over its median, and upper limit."""
_CONTOURS = 9
"""Most intervals between contours over the range of colours."""
_UP_COLOUR = np.array([0.42, 0.42, 0.42])
_RIGHT_COLOUR = np.array([0.42, -0.11, -0.52])
"""Change of red, green and blue of ground that faces up in the image, and of ground that faces right: lightness, and
orange against blue at the same lightness. These are told apart by people who confuse red with green."""
_KEY = 41
"""Width and height of the key of normals [px]."""


def plot_layer(
    axes: Axes,
    scene: Scene,
    name: str,
    *,
    view: int | None = None,
    clim: tuple[float, float] | None = None,
    marks: bool = True,
) -> Axes:
    """Draws a layer of `LAYERS` on axes, in pixels of the reference image; returns the axes.

    Places without a landmark stay blank. view: whose Sun is shown by an arrow, and lights the relief. clim: the
    ends of the colour scale. marks: also draw the scale bar and the arrows. Raises InputError for a layer that there is
    not.
    """
    layer = find_layer(scene, name)
    if name == "normals":
        show_map(axes, normal_colours(scene), scene.region, layer.title)
        _add_key(axes)
    else:
        values = scene.grid(shade(scene, view) if name == "relief" else layer.values(scene))
        low, high = layer_limits(layer, values) if clim is None else clim
        if name == "height":
            _show_height(axes, scene, layer, values, (low, high), view)
        else:
            show_map(
                axes, values, scene.region, layer.title, label=layer.label(scene), cmap=layer.cmap, clim=(low, high)
            )
    if marks:
        add_marks(axes, scene, view)
    return axes


def layer_limits(layer: Layer, values: np.ndarray) -> tuple[float, float]:
    """The ends of a layer's colour scale for values on the map's grid."""
    return limits(values) if layer.from_zero is None else limits(values, high=layer.from_zero, zero=True)


def normal_colours(scene: Scene) -> np.ndarray:
    """Normals as colours (h, w, 4): lightness by how far the ground faces up in the image, orange right, blue left.

    Both are stretched by one factor, so that the steepest two percent saturate. Transparent where there is no landmark.
    """
    normal = scene.grid(local_normal(scene))
    across = limits(np.hypot(normal[..., 0], normal[..., 1]), high=STEEP_PERCENT, zero=True)[1]
    return transparent(_facing_colours(normal[..., 0] / across, normal[..., 1] / across))


def _facing_colours(right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Colours (..., 3) of ground that faces right and up in the image, from -1 to 1 each."""
    return np.clip(0.5 + right[..., None] * _RIGHT_COLOUR + up[..., None] * _UP_COLOUR, 0.0, 1.0)


def hillshaded(
    scene: Scene, values: np.ndarray, cmap: str, clim: tuple[float, float], view: int | None = None
) -> np.ndarray:
    """Colours (h, w, 4) of values (h, w) by a colour map, darker where the hillshade is; transparent where NaN.

    view: whose Sun lights the relief; by default the light comes from the upper left.
    """
    low, high = clim
    dark, by_shade, brightest = _HILLSHADE_MIX
    lit = scene.grid(shade(scene, view))
    colour = colour_map(cmap)(np.clip((values - low) / (high - low), 0.0, 1.0))[..., :3]
    mixed = colour * np.clip(dark + by_shade * lit / np.nanmedian(lit), 0.0, brightest)[..., None]
    return transparent(np.where(np.isfinite(values)[..., None], np.clip(mixed, 0.0, 1.0), np.nan))


def contour_levels(clim: tuple[float, float]) -> np.ndarray:
    """Heights of contours: round numbers between the ends of the colour scale."""
    levels = np.asarray(MaxNLocator(_CONTOURS, steps=[1, 2, 5, 10]).tick_values(*clim))
    return levels[(levels > clim[0]) & (levels < clim[1])]


def _show_height(
    axes: Axes, scene: Scene, layer: Layer, values: np.ndarray, clim: tuple[float, float], view: int | None
) -> None:
    show_map(axes, hillshaded(scene, values, layer.cmap, clim, view), scene.region, layer.title)
    levels, label = contour_levels(clim), layer.label(scene)
    if len(levels) > 1 and min(values.shape) > 1:
        left, right, bottom, top = region_extent(scene.region)
        rows, cols = values.shape
        x = left + (np.arange(cols) + 0.5) * (right - left) / cols
        y = top + (np.arange(rows) + 0.5) * (bottom - top) / rows
        axes.contour(x, y, np.ma.masked_invalid(values), levels, colors="black", linewidths=0.5, alpha=0.7)
        label += f", contours every {levels[1] - levels[0]:.3g} {length_unit(scene)[1]}"
    add_bar(axes, ScalarMappable(Normalize(*clim), colour_map(layer.cmap)), values, label)


def _add_key(axes: Axes) -> None:
    """The colours of normals by the direction that the ground faces, beside the map."""
    key = axes.inset_axes((1.04, 0.36, 0.16, 0.28))
    right, up = np.meshgrid(np.linspace(-1.0, 1.0, _KEY), np.linspace(1.0, -1.0, _KEY))
    inside = (np.hypot(right, up) <= 1.0)[..., None]
    key.imshow(transparent(np.where(inside, _facing_colours(right, up), np.nan)), interpolation="nearest")
    key.set_anchor("W")
    key.set_axis_off()
    key.set_title("facing", fontsize="small", pad=9.0)
    middle, end = 0.5 * (_KEY - 1), _KEY - 0.5
    for x, y, words, across, along in (
        (middle, -0.5, "up", "center", "bottom"),
        (middle, end, "down", "center", "top"),
        (end, middle, " right", "left", "center"),
    ):
        key.text(x, y, words, ha=across, va=along, fontsize="x-small")
