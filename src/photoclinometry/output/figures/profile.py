"""A layer along a straight line of the map, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.model.sampling import sample
from photoclinometry.model.scene import BODY_FIXED, Scene
from photoclinometry.output.figures.layers import Layer, find_layer, length_unit
from photoclinometry.surface.relief import local_frame, on_mean_plane

Pixel = tuple[float, float]
"""(x, y) of the reference image [px]; (0.5, 0.5) is the centre of its top-left pixel."""

ENDS = ("A", "A′")
"""Names of the two ends of a profile, in the map and in the curve."""
_ROUNDING = 1e-9
"""Share of a cell by which a place may lie outside the map, or its weights on a hole, because of rounding."""
_BAND_ALPHA = 0.3
_CURVE = "#0072b2"
"""Blue of Okabe and Ito's palette, which people with any colour vision can distinguish from black."""


@dataclass(frozen=True, kw_only=True)
class Profile:
    """A layer at places along a line, one for each cell of the map's grid that the line passes."""

    pixel: np.ndarray
    """(n, 2) places in the reference image [px]."""
    length: float
    """Between the ends, along the mean plane [metres, or GSD]."""
    distance: np.ndarray
    """(n,) along the mean plane from the first end [metres, or GSD]; NaN where there is no landmark around."""
    value: np.ndarray
    """(n,) of the layer, linear between landmarks; NaN where there are none around."""
    sigma: np.ndarray | None
    """(n,) one standard deviation of the values; None where the scene states none."""


def profile(scene: Scene, layer: Layer, start: Pixel, end: Pixel) -> Profile:
    """A layer between two places of the reference image.

    Raises InputError for a layer of directions, for two places that are one, and for a line that misses the map.
    """
    if layer.name == "normals":
        raise InputError("layer 'normals' has no profile: it is a direction; take slope or height")
    ends = np.array([start, end], float)
    if ends.shape != (2, 2) or not np.isfinite(ends).all() or (ends[0] == ends[1]).all():
        raise InputError(f"profile from {start} to {end}: give two different places as x y, in reference pixels")
    steps = int(np.ceil(np.linalg.norm(ends[1] - ends[0]) / scene.region.stride))
    pixel = np.linspace(ends[0], ends[1], max(steps, 1) + 1)
    to_local = local_frame(scene).inverse()
    local = to_local(scene.landmarks.position)[:, :2]
    sigma = layer.sigma(scene)
    columns = [*local.T, layer.shown(scene), *([] if sigma is None else [sigma])]
    found = _along(scene, np.stack(columns, -1), pixel)
    there = np.isfinite(found).all(-1)
    if there.sum() < 2:
        region = scene.region
        raise InputError(
            f"the profile from {start} to {end} misses the map, which has columns {region.col} to "
            f"{region.col + region.width} and rows {region.row} to {region.row + region.height} of the reference image"
        )
    first, last = to_local(on_mean_plane(scene, ends))[:, :2]
    distance = (found[:, :2] - first) @ unit(last - first) * length_unit(scene)[0]
    length = float(np.linalg.norm(last - first)) * length_unit(scene)[0]
    return Profile(
        pixel=pixel, length=length, distance=distance, value=found[:, 2], sigma=None if sigma is None else found[:, 3]
    )


def plot_profile(axes: Axes, scene: Scene, start: Pixel, end: Pixel, *, name: str = "height") -> Axes:
    """The curve of a layer between two places, with a band of one standard deviation; returns the axes.

    In the body-fixed frame heights are as uncertain as the map's place on the body, which all of them share: the curve
    may be off by as much as a whole, and its form is known better.

    Raises InputError as `profile` and `find_layer`.
    """
    layer = find_layer(scene, name)
    drawn = profile(scene, layer, start, end)
    placed = scene.frame == BODY_FIXED and name == "height"
    if drawn.sigma is not None:
        low, high = drawn.value - drawn.sigma, drawn.value + drawn.sigma
        label = "± 1 σ" + (", with the map's place on the body" if placed else "")
        axes.fill_between(drawn.distance, low, high, color=_CURVE, alpha=_BAND_ALPHA, linewidth=0.0, label=label)
    axes.plot(drawn.distance, drawn.value, color=_CURVE, linewidth=1.0)
    axes.set_xlim(0.0, drawn.length)
    axes.set_xlabel(f"distance [{length_unit(scene)[1]}]")
    axes.set_ylabel(layer.label(scene))
    for x, words, side in ((0.0, ENDS[0], "left"), (drawn.length, ENDS[1], "right")):
        axes.annotate(words, (x, 1.0), (0.0, 2.0), ("data", "axes fraction"), "offset points", ha=side, va="bottom")
    if drawn.sigma is not None:
        axes.legend(frameon=False, fontsize="small", loc="best")
    return axes


def add_line(axes: Axes, start: Pixel, end: Pixel) -> None:
    """The line of a profile in a map, with the names of its ends."""
    for color, width in (("white", 2.2), ("black", 1.0)):
        axes.plot(*np.transpose([start, end]), color=color, linewidth=width, scalex=False, scaley=False)
    way = unit(np.subtract(end, start)) * (1.0, -1.0)
    for place, words, side in ((start, ENDS[0], -1.0), (end, ENDS[1], 1.0)):
        box = {"facecolor": "white", "alpha": 0.78, "edgecolor": "none", "pad": 0.6}
        offset = tuple(6.0 * side * way)
        axes.annotate(words, place, offset, textcoords="offset points", ha="center", va="center", bbox=box)


def _along(scene: Scene, values: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """Values (J, c) of landmarks at places (n, 2) of the reference image, bilinear; NaN beside any hole."""
    grid, region = scene.grid(values), scene.region
    cell = (pixel - (region.col + 0.5, region.row + 0.5)) / region.stride + 0.5
    there = np.all(np.isfinite(grid), axis=-1)
    rows, cols = region.grid_shape
    nearest = np.clip(cell, 0.5, np.array([cols, rows]) - 0.5)
    inside = (np.abs(cell - nearest) <= _ROUNDING).all(-1)
    whole = sample(there[..., None].astype(float), nearest, order=1)[:, 0] >= 1.0 - _ROUNDING
    found = sample(np.where(there[..., None], grid, 0.0), nearest, order=1)
    return np.where((inside & whole)[:, None], found, np.nan)
