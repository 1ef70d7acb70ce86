"""Marks that make a picture of ground a map: a scale bar, and arrows to the north and to the Sun."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.offsetbox import AnchoredOffsetbox, AuxTransformBox, DrawingArea, OffsetBox, TextArea, VPacker
from matplotlib.patches import FancyArrowPatch, Rectangle
from matplotlib.text import Text

from photoclinometry.model.geometry import unit
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.output.figures.layers import length_unit
from photoclinometry.surface.relief import local_frame, on_mean_plane

_BAR_SHARE = 0.32
"""Longest scale bar as a share of the map's width."""
_BAR_THICK = 0.012
"""Thickness of the scale bar as a share of the map's longer side."""
_ARROW_PT, _GAP_PT = 15.0, 1.5
"""Length of arrows, and distance of their names from their tips [points]."""
_LETTER = np.array([0.33, 0.42])
"""Half the width of a letter and half its height, in sizes of the font."""
_LEAST_SLANT = math.sin(math.radians(1.0))
"""Sine of the angle from the vertical below which a direction has no azimuth that is worth drawing."""
_KM = 1000.0
_STEPS = (1.0, 2.0, 5.0, 10.0)
"""Lengths of scale bars, times a power of ten."""


def scale_bar(scene: Scene) -> tuple[float, str]:
    """The length of a scale bar in pixels of the reference image, and that length in words.

    Metres, kilometres, or GSD where metres are not known. It is true along the rows of the image, on the mean plane.
    """
    factor, unit_name = length_unit(scene)
    per_pixel = float(ground_per_pixel(scene)[0]) * factor
    longest = _BAR_SHARE * scene.region.width * per_pixel
    power = 10.0 ** math.floor(math.log10(longest))
    length = power * max(step for step in _STEPS if step * power <= longest)
    if unit_name == "m" and length >= _KM:
        return length / per_pixel, f"{length / _KM:g} km"
    return length / per_pixel, f"{length:g} {unit_name}"


def ground_per_pixel(scene: Scene) -> np.ndarray:
    """(2,) lengths in B on the mean plane of a step to the next column and to the next row of the reference image.

    In the middle of the map.
    """
    region = scene.region
    middle = np.array([region.col + 0.5 * region.width, region.row + 0.5 * region.height])
    point = on_mean_plane(scene, middle + np.array([[[-0.5, 0.0], [0.5, 0.0]], [[0.0, -0.5], [0.0, 0.5]]]))
    return np.linalg.norm(point[:, 1] - point[:, 0], axis=-1)


def north_in_image(scene: Scene) -> np.ndarray | None:
    """(2,) unit vector (right, down) of the reference image towards the body's north pole; None where that is not
    known.

    It is known in the body-fixed frame, but for maps of the poles themselves.
    """
    if scene.frame != BODY_FIXED:
        return None
    return _in_image(scene, np.array([0.0, 0.0, 1.0]), unit(local_frame(scene).translation))


def sun_in_image(scene: Scene, view: int) -> np.ndarray | None:
    """(2,) unit vector (right, down) of the reference image towards the Sun of a view; None for a Sun overhead."""
    return _in_image(scene, scene.views.sun[view], local_frame(scene).rotation[:, 2])


def _in_image(scene: Scene, direction: np.ndarray, up: np.ndarray) -> np.ndarray | None:
    """The horizontal part of a direction (3,) of B as the reference image shows it in the middle of the map."""
    level = direction - (direction @ up) * up
    if np.linalg.norm(level) < _LEAST_SLANT * np.linalg.norm(direction):
        return None
    middle = local_frame(scene).translation
    ends = middle + scene.gsd * np.array([[-0.5], [0.5]]) * unit(level)
    before, after = scene.views.project(scene.reference, ends)
    return unit(after - before)


def add_marks(axes: Axes, scene: Scene, view: int | None = None) -> None:
    """A scale bar, and arrows to the north where it is known and to the Sun of `view` where one is named."""
    length, words = scale_bar(scene)
    bar = AuxTransformBox(axes.transData)
    thick = _BAR_THICK * max(scene.region.width, scene.region.height)
    bar.add_artist(Rectangle((0.0, 0.0), length, thick, facecolor="black", linewidth=0.0))
    _framed(axes, VPacker(children=[TextArea(words), bar], align="center", pad=0.0, sep=2.0), "lower left")
    ways = {"N": north_in_image(scene), "Sun": None if view is None else sun_in_image(scene, view)}
    known = {name: way for name, way in ways.items() if way is not None}
    if known:
        _framed(axes, _arrows(known), "upper right")


def _arrows(ways: dict[str, np.ndarray]) -> DrawingArea:
    """Arrows from one point along (right, down), with names at their tips."""
    size = FontProperties(size="small").get_size_in_points()
    artists: list[Artist] = []
    corners = [np.zeros(2)]
    for name, (right, down) in ways.items():
        along, half = np.array([right, -down]), size * _LETTER * (len(name), 1.0)
        place = (_ARROW_PT + _GAP_PT + half @ np.abs(along)) * along
        style = {"arrowstyle": "-|>", "mutation_scale": 7.0, "shrinkA": 0.0, "shrinkB": 0.0, "linewidth": 1.0}
        artists.append(FancyArrowPatch((0.0, 0.0), tuple(_ARROW_PT * along), color="black", **style))
        artists.append(Text(place[0], place[1], name, ha="center", va="center_baseline", fontsize=size))
        corners += [place - half, place + half]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    box = DrawingArea(*(high - low), *-low)
    for artist in artists:
        box.add_artist(artist)
    return box


def _framed(axes: Axes, content: OffsetBox, corner: str) -> None:
    """Content in a corner of a map, on white that lets the map shine through."""
    box = AnchoredOffsetbox(corner, child=content, pad=0.25, borderpad=0.35, frameon=True)
    box.patch.set(facecolor="white", alpha=0.78, edgecolor="none")
    axes.add_artist(box)
