"""A layer of a map on axes: its colours with their bar, contours, scale bar and arrows."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.font_manager import FontProperties
from matplotlib.offsetbox import AnchoredOffsetbox, DrawingArea, HPacker, OffsetImage, TextArea, VPacker
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.draw import add_bar, colour_map, limits, region_extent, show_map, transparent
from photoclinometry.output.figures.layers import LAYERS, STEEP_PERCENT, Layer, find_layer, length_unit, shade
from photoclinometry.output.figures.marks import add_marks

_HILLSHADE_MIX = (0.35, 0.65, 1.45)
"""Colour of a hillshaded map: share without light, share by shade over its median, and upper limit."""
_CONTOURS = 9
"""Most intervals between contours over the range of colours."""
_UP_COLOUR = np.array([0.42, 0.42, 0.42])
_RIGHT_COLOUR = np.array([0.42, -0.11, -0.52])
"""Change of red, green and blue of ground that faces up in the image, and of ground that faces right: lightness, and
orange against blue at the same lightness. People who confuse red with green can distinguish these."""
_KEY_PX, _KEY_PT = 81, 22.0
"""Width and height of the disc of colours of normals, in pixels and on paper [points]."""


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

    Places without a landmark, or where nothing determines the values, stay blank. view: whose Sun is shown by an
    arrow, and lights the relief. clim: the ends of the colour scale. marks: also draw the scale bar and the arrows.
    Raises InputError for a layer that there is not.
    """
    layer = find_layer(scene, name)
    if name == "normals":
        show_map(axes, normal_colours(scene), scene.region, layer.title)
        _add_key(axes)
    else:
        values = scene.grid(layer.shown(scene, view))
        low, high = layer_limits(layer, values) if clim is None else clim
        if name == "height":
            _show_height(axes, scene, layer, values, (low, high), view)
        else:
            show_map(
                axes, values, scene.region, layer.title, label=layer.label(scene), cmap=layer.cmap, clim=(low, high)
            )
    if name == "views":
        axes.child_axes[-1].yaxis.set_major_locator(MaxNLocator(integer=True))
    if marks:
        add_marks(axes, scene, view)
    return axes


def layer_limits(layer: Layer, values: np.ndarray) -> tuple[float, float]:
    """The ends of a layer's colour scale for values on the map's grid."""
    return limits(values) if layer.from_zero is None else limits(values, high=layer.from_zero, zero=True)


def normal_colours(scene: Scene) -> np.ndarray:
    """Normals as colours (h, w, 4): lightness by how far the ground faces up in the image, orange right, blue left.

    Both are stretched by one factor, so that the steepest two percent saturate. Transparent where there is no landmark,
    or nothing determines its normal.
    """
    normal = scene.grid(LAYERS["normals"].shown(scene))
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
    levels = contour_levels(clim)
    if len(levels) > 1 and min(values.shape) > 1:
        left, right, bottom, top = region_extent(scene.region)
        rows, cols = values.shape
        x = left + (np.arange(cols) + 0.5) * (right - left) / cols
        y = top + (np.arange(rows) + 0.5) * (bottom - top) / rows
        axes.contour(x, y, np.ma.masked_invalid(values), levels, colors="black", linewidths=0.5, alpha=0.7)
        axes.set_title(f"{layer.title}, contours {levels[1] - levels[0]:.3g} {length_unit(scene)[1]}")
    add_bar(axes, ScalarMappable(Normalize(*clim), colour_map(layer.cmap)), values, layer.label(scene))


def _add_key(axes: Axes) -> None:
    """The colours of normals by the direction that the ground faces, to the right of the map."""
    right, up = np.meshgrid(np.linspace(-1.0, 1.0, _KEY_PX), np.linspace(1.0, -1.0, _KEY_PX))
    inside = (np.hypot(right, up) <= 1.0)[..., None]
    colours = transparent(np.where(inside, _facing_colours(right, up), np.nan))
    disc = OffsetImage(colours, zoom=_KEY_PT / _KEY_PX, interpolation="nearest")
    row = HPacker(children=[_sideways("left", 90.0), disc, _sideways("right", 270.0)], align="center", pad=0.0, sep=1.0)
    words = [TextArea(text, textprops={"size": "x-small"}) for text in ("facing", "up", "down")]
    key = VPacker(children=[*words[:2], row, words[2]], align="center", pad=0.0, sep=1.0)
    place = {"bbox_to_anchor": (1.02, 0.5), "bbox_transform": axes.transAxes}
    axes.add_artist(AnchoredOffsetbox("center left", child=key, pad=0.0, borderpad=0.0, frameon=False, **place))


def _sideways(words: str, rotation: float) -> DrawingArea:
    """A word that is read upwards or downwards."""
    size = FontProperties(size="x-small").get_size_in_points()
    box = DrawingArea(1.2 * size, _KEY_PT)
    middle = (0.6 * size, 0.5 * _KEY_PT)
    box.add_artist(Text(*middle, words, rotation=rotation, ha="center", va="center", fontsize=size))
    return box
