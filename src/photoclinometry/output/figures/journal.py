"""Figures for publication: lettered maps and a profile at a journal's width, as PDF, SVG or PNG."""

from __future__ import annotations

import io
import string
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photoclinometry import __version__
from photoclinometry.io.atomic import write_bytes
from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.draw import ASPECT, BAR_PLACE, STYLE, panels
from photoclinometry.output.figures.layers import find_layer
from photoclinometry.output.figures.maps import plot_layer
from photoclinometry.output.figures.options import COLUMN_MM, FigureOptions
from photoclinometry.output.figures.profile import add_line, plot_profile
from photoclinometry.output.figures.svg_fonts import with_fonts

SUFFIXES = (".pdf", ".svg", ".png")
INCH_MM = 25.4
POINTS_PER_MM = 72.0 / INCH_MM
PAGE_HEIGHT_MM = 240.0
"""Greatest height of a figure: that of a journal's page."""
_LEAST_PANEL_MM = 15.0
"""Narrower maps leave no room for a scale bar."""
_LEFT_MM, _TOP_MM, _BOTTOM_MM = 1.0, 5.5, 1.5
"""Margins around the maps."""
_BAR_SHARE, _LABEL_MM = BAR_PLACE[0] + BAR_PLACE[2] - 1.0, 12.5
"""Right margin, which is the gap between maps, too: a colour bar, as a share of the map's width, and its label."""
_PROFILE_MM, _PROFILE_LEFT_MM, _PROFILE_RIGHT_MM, _PROFILE_BELOW_MM, _PROFILE_ABOVE_MM = 32.0, 13.0, 3.5, 9.5, 8.0
"""Height of a profile, and its margins: numbers and label to the left, those below, and the gap to the maps above."""
_ACROSS = 3
"""Most maps side by side in two columns, unless asked for."""
_FONT_PT = 7.0
"""Size of text that the margins above are made for; they grow with the text."""


def style_of(options: FigureOptions) -> dict[Any, Any]:
    """matplotlib's settings of a figure: sizes, and text that stays text in fonts that lie in the file."""
    size = options.font_pt
    return STYLE | {
        "font.size": size,
        "font.family": "DejaVu Sans",
        "axes.titlesize": size,
        "axes.labelsize": size,
        "xtick.labelsize": size - 1.0,
        "ytick.labelsize": size - 1.0,
        "axes.linewidth": 0.5,
        "xtick.major.width": 0.5,
        "ytick.major.width": 0.5,
        "xtick.major.size": 2.0,
        "ytick.major.size": 2.0,
        "axes.titlepad": 3.0,
        "axes.labelpad": 2.0,
        "pdf.fonttype": 42,
        "svg.fonttype": "none",
        "svg.hashsalt": "photoclinometry",
        "savefig.facecolor": "white",
    }


def write_figure(path: Path, scene: Scene, options: FigureOptions, view: int | None = None) -> Figure:
    """A figure as PDF, SVG or PNG, by the suffix of its path; it appears whole or not at all. Returns the figure.

    view: index of the view that `options.view` names. Raises InputError for a suffix, a layer or a profile that cannot
    be, and for a figure that does not fit a page; RunFolderError.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: cannot write {path.suffix or 'a file without suffix'}; use {', '.join(SUFFIXES)}")
    with matplotlib.rc_context(style_of(options)):
        figure = draw_figure(scene, options, view)
        kind, file = path.suffix.lower(), io.BytesIO()
        figure.savefig(file, format=kind[1:], dpi=options.dpi, metadata=_metadata(kind, scene))
    write_bytes(path, with_fonts(file.getvalue()) if kind == ".svg" else file.getvalue())
    return figure


def draw_figure(scene: Scene, options: FigureOptions, view: int | None = None) -> Figure:
    """The figure of `write_figure`; call it inside its style. Raises InputError."""
    if not options.layers and options.profile is None:
        raise InputError("a figure needs something to show: name layers, or give the ends of a profile")
    for name in options.layers:
        find_layer(scene, name)
    figure, axes, below = _layout(scene, options)
    ends = None if options.profile is None else (options.profile[:2], options.profile[2:])
    if ends is not None and below is not None:
        plot_profile(below, scene, *ends, name=options.profile_layer)
    for panel, name in zip(axes, options.layers, strict=True):
        plot_layer(panel, scene, name, view=view)
        panel.set(xticks=[], yticks=[], xlabel="", ylabel="")
        for side in ("top", "right"):
            panel.spines[side].set_visible(True)
        if ends is not None:
            add_line(panel, *ends)
    shift = [0.0] * len(axes) + [-_grown(options) * (_PROFILE_LEFT_MM - _LEFT_MM) * POINTS_PER_MM]
    drawn = axes if below is None else [*axes, below]
    if options.letters and len(drawn) > 1:
        for panel, letter, right in zip(drawn, string.ascii_lowercase, shift, strict=False):
            _letter(panel, letter, right)
    return figure


def width_mm(options: FigureOptions) -> float:
    """The width of a figure [mm]: as asked for, or that of one or two columns."""
    columns = options.columns or (1 if len(options.layers) <= 1 else 2)
    return COLUMN_MM[columns] if options.width_mm is None else options.width_mm


def _layout(scene: Scene, options: FigureOptions) -> tuple[Figure, list[Axes], Axes | None]:
    """The figure, the axes of its maps, and those of the profile below them. Raises InputError."""
    full, grown = width_mm(options), _grown(options)
    left, top, bottom = (grown * side for side in (_LEFT_MM, _TOP_MM, _BOTTOM_MM))
    count = len(options.layers)
    across = min(count, options.across or (1 if full <= COLUMN_MM[1] else _ACROSS))
    down = -(-count // across) if count else 0
    with_curve = 0.0
    if options.profile is not None:
        with_curve = grown * (_PROFILE_BELOW_MM + (_PROFILE_ABOVE_MM if count else _TOP_MM)) + _PROFILE_MM
    each = (full - left) / max(across, 1)
    width = (each - grown * _LABEL_MM) / (1.0 + _BAR_SHARE)
    right = each - width
    if width < _LEAST_PANEL_MM:
        raise InputError(
            f"{across} maps side by side are {width:.0f} mm wide each in a figure of {full:g} mm, {_LEAST_PANEL_MM:g} "
            "are the least; place fewer across, or make the figure wider (--columns 2, --width-mm)"
        )
    aspect = scene.region.height / scene.region.width
    high = width * float(np.clip(aspect, *ASPECT)) + top
    height = down * high + (bottom if count else 0.0) + with_curve
    if height > PAGE_HEIGHT_MM:
        raise InputError(
            f"the figure would be {height:.0f} mm high, a page has {PAGE_HEIGHT_MM:g}; draw fewer layers, place more "
            "across, or make it narrower (--across, --width-mm)"
        )
    if count:
        margin = tuple(side / INCH_MM for side in (left, right, bottom + with_curve, top))
        figure, grid = panels(down, across, width / INCH_MM, aspect, (right / INCH_MM, top / INCH_MM), margin)
    else:
        figure, grid = Figure(figsize=(full / INCH_MM, height / INCH_MM)), np.empty(0, object)
    for spare in grid.flat[count:]:
        spare.remove()
    axes = list(grid.flat[:count])
    if options.profile is None:
        return figure, axes, None
    x, y = grown * _PROFILE_LEFT_MM / full, grown * _PROFILE_BELOW_MM / height
    return figure, axes, figure.add_axes((x, y, 1.0 - x - _PROFILE_RIGHT_MM / full, _PROFILE_MM / height))


def _grown(options: FigureOptions) -> float:
    """Ratio of the margins to those of the smallest text."""
    return max(1.0, options.font_pt / _FONT_PT)


def _letter(panel: Axes, letter: str, right: float) -> None:
    """A panel's letter above its upper left corner, moved to the right [points]."""
    size = float(matplotlib.rcParams["font.size"]) + 1.0
    look = {"weight": "bold", "size": size, "ha": "left", "va": "bottom"}
    panel.annotate(letter, (0.0, 1.0), (right, 3.0), "axes fraction", "offset points", **look)


def _metadata(suffix: str, scene: Scene) -> dict[str, Any]:
    """Metadata of the file; without the time, so that the same map gives the same file."""
    made = f"photoclinometry {__version__}"
    if suffix == ".png":
        return {"Title": scene.name, "Software": made}
    return {"Title": scene.name, "Creator": made} | ({"CreationDate": None} if suffix == ".pdf" else {"Date": None})
