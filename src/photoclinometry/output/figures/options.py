"""Content and size of a figure for publication."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.output.figures.layers import LAYERS

if TYPE_CHECKING:
    LayerName = str
else:
    LayerName = Literal[*LAYERS]

_Coordinate = Annotated[float, Range()]

COLUMN_MM = {1: 90.0, 2: 190.0}
"""Widths of figures of one and two columns [mm], as Elsevier's journals of planetary science ask for."""


@dataclass(frozen=True, kw_only=True)
class FigureOptions(Ranged):
    """Content and size of a figure for publication."""

    layers: tuple[LayerName, ...] = ("albedo", "height", "slope")
    """Layers of the map, each a panel."""
    profile: tuple[_Coordinate, _Coordinate, _Coordinate, _Coordinate] | None = None
    """Ends x0 y0 x1 y1 of a profile in pixels of the reference image, as the axes of the report's maps show them. Its
    curve is the last panel, its line is drawn in the maps."""
    profile_layer: LayerName = "height"
    """The layer that the profile shows."""
    view: str | None = None
    """Name of the view whose Sun is shown by an arrow, and lights the relief. By default there is no arrow, and light
    comes from the upper left."""
    columns: Literal[1, 2] | None = None
    """Columns of a journal that the figure is as wide as: 90 or 190 mm. By default one for a single map, else two."""
    width_mm: Annotated[float | None, Range(least=30, most=1000)] = None
    """Width of the figure [mm], in place of that of columns."""
    across: Annotated[int | None, Range(least=1, most=10)] = None
    """Maps side by side. By default one in one column, and up to three in two."""
    dpi: Annotated[float, Range(least=50, most=2400)] = 300.0
    """Resolution of the maps inside of the file, and of PNG files [pixels per inch]. Text and lines of PDF and SVG have
    none."""
    font_pt: Annotated[float, Range(least=4, most=30)] = 7.0
    """Size of text [points]."""
    letters: bool = True
    """Letter the panels a, b, c ..."""
