"""The layout and style of figures: sizes, colours, colour bars, limits.

Figures are made without pyplot, so that no global state changes and no display is needed.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from photoclinometry.model.region import Region

MISSING = (0.66, 0.71, 0.77)
"""Colour of pixels without a value in the report: a bluish grey, which is not mistaken for a brightness."""
_NOTHING = (0.0, 0.0, 0.0, 0.0)
"""Colour of pixels without a value: none, so that the axes' own is seen."""
DPI = 130
"""Resolution of figures [px/inch]."""
ASPECT = (0.3, 2.0)
"""Range of a panel's height over its width; maps beyond it are drawn with margins."""
BAR_PLACE = (1.03, 0.0, 0.035, 1.0)
"""Left, bottom, width and height of a colour bar in sizes of its map."""
_MOST_TICKS = 6
"""Intervals of a colour bar. Steps of 1, 2 or 5 need a digit less than those of 2.5; beside a bar is room for five
characters."""
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": False,
    "image.interpolation": "nearest",
    "savefig.facecolor": "white",
}


def save(figure: Figure, path: Path) -> Path:
    """Writes the figure; returns its path."""
    figure.savefig(path, dpi=DPI)
    return path


def panels(
    rows: int, cols: int, width: float, aspect: float, gap: tuple[float, float], margin: tuple[float, ...]
) -> tuple[Figure, np.ndarray]:
    """A figure and its axes (rows, cols), every panel `width` wide and width x aspect high, all in inches.

    gap: across and down between panels; margin: left, right, bottom, top. Placed by hand, since matplotlib's layout
    engines draw everything twice. Draw inside `style()`.
    """
    left, right, bottom, top = margin
    height = width * float(np.clip(aspect, *ASPECT))
    full_width = left + right + cols * width + (cols - 1) * gap[0]
    full_height = bottom + top + rows * height + (rows - 1) * gap[1]
    figure = Figure(figsize=(full_width, full_height))
    axes = np.empty((rows, cols), object)
    for i, j in np.ndindex(rows, cols):
        x, y = left + j * (width + gap[0]), full_height - top - height - i * (height + gap[1])
        axes[i, j] = figure.add_axes((x / full_width, y / full_height, width / full_width, height / full_height))
    return figure, axes


def mark_number(axes: Axes, number: int, place: tuple[float, float]) -> None:
    """A number in a white box, its middle at a place (x, y) of the data."""
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.78, "pad": 1.0}
    axes.annotate(str(number), place, ha="center", va="center", weight="bold", bbox=box)


def one_panel(aspect: float) -> tuple[Figure, Axes]:
    """A figure for one map (height / width = aspect) with its colour bar."""
    figure, axes = panels(1, 1, 4.3, aspect, (0.0, 0.0), (0.6, 1.0, 0.5, 0.3))
    set_missing(axes)
    return figure, axes[0, 0]


def set_missing(axes: np.ndarray) -> None:
    """Maps on these axes (rows, cols) show MISSING where there is no value."""
    for panel in axes.flat:
        panel.set_facecolor(MISSING)


def style() -> AbstractContextManager[None]:
    """The report's matplotlib settings, as a context."""
    return matplotlib.rc_context(STYLE)


def colour_map(name: str) -> Colormap:
    """A matplotlib colour map that leaves missing values blank."""
    return matplotlib.colormaps[name].with_extremes(bad=_NOTHING)


def transparent(colours: np.ndarray) -> np.ndarray:
    """Colours (h, w, 3), NaN where there is no value, as (h, w, 4) that are blank there."""
    there = np.isfinite(colours).all(-1, keepdims=True)
    return np.concatenate([np.where(there, colours, 0.0), there.astype(float)], -1)


def limits(values: np.ndarray, low: float = 1.0, high: float = 99.0, *, zero: bool = False) -> tuple[float, float]:
    """Percentiles of the finite values, which single outliers do not change; (0, 1) if there are none."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return 0.0, 1.0
    bottom, top = np.percentile(finite, [low, high])
    bottom = 0.0 if zero else float(bottom)
    return bottom, float(top) if top > bottom else bottom + max(abs(bottom) * 1e-3, 1e-12)


def symmetric_limits(values: np.ndarray, high: float = 99.0) -> tuple[float, float]:
    """Limits (-x, x) around zero; x is a percentile of the absolute finite values."""
    top = limits(np.abs(values), high=high, zero=True)[1]
    return -top, top


def region_extent(region: Region) -> tuple[float, float, float, float]:
    """The extent (left, right, bottom, top) of the map's grid for imshow, in reference pixels."""
    rows, cols = region.grid_shape
    left, top = region.col + 0.5 * (1 - region.stride), region.row + 0.5 * (1 - region.stride)
    return left, left + region.stride * cols, top + region.stride * rows, top


def show_map(
    axes: Axes,
    values: np.ndarray,
    region: Region,
    title: str,
    *,
    label: str = "",
    cmap: str = "gray",
    clim: tuple[float, float] | None = None,
) -> None:
    """A map (h, w) on the region's grid with its colour bar, or an image (h, w, 4) of colours without one."""
    axes.set_title(title)
    axes.set_xlabel("reference column [px]")
    axes.set_ylabel("reference row [px]")
    if values.ndim == 3:
        axes.imshow(values, extent=region_extent(region), interpolation="nearest")
        return
    low, high = limits(values) if clim is None else clim
    drawn = axes.imshow(
        np.ma.masked_invalid(values),
        cmap=colour_map(cmap),
        vmin=low,
        vmax=high,
        extent=region_extent(region),
        interpolation="nearest",
    )
    add_bar(axes, drawn, values, label)


def add_bar(axes: Axes, drawn: Any, values: np.ndarray, label: str) -> None:
    """A colour bar as high as the axes, with arrows if values lie beyond its limits."""
    finite = values[np.isfinite(values)]
    low, high = drawn.get_clim()
    under, over = (finite < low).any(), (finite > high).any()
    extend = "both" if under and over else "min" if under else "max" if over else "neither"
    place = axes.inset_axes(BAR_PLACE)
    ticks = MaxNLocator(_MOST_TICKS, steps=(1, 2, 5, 10))
    axes.figure.colorbar(drawn, cax=place, label=label, extend=extend, extendfrac=0.03, ticks=ticks)


def bare(axes: Axes, title: str = "") -> Axes:
    """Axes without ticks and frame, for pictures of the report."""
    axes.set_title(title)
    axes.set_facecolor(MISSING)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    return axes
