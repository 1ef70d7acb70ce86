"""Differences of measurements from the map's predictions: of all views side by side, or of one view as a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from photoclinometry.evaluate.evaluate import keypoint_residual_px
from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.draw import limits, show_map, symmetric_limits
from photoclinometry.output.figures.layers import STEEP_PERCENT
from photoclinometry.output.figures.marks import add_marks
from photoclinometry.photometry.predict import brightness_residuals

KINDS = ("brightness", "keypoint")
"""Quantities for `plot_residuals`: predicted minus measured brightness, or distances of keypoints."""
_WHISKERS = (5.0, 95.0)
"""Percentiles at the ends of the lines of a box plot."""
_LABELS = {
    "brightness": "predicted − measured brightness\n[% of the view's mean]",
    "keypoint": "keypoint to projection [px]",
}


def residuals(scene: Scene, kind: str) -> np.ndarray:
    """(N,) of every observation: brightness [% of its view's mean], NaN where it is no measurement; or keypoints [px].

    Raises InputError for another kind, and for the brightness of a scene without a reflectance model.
    """
    if kind not in KINDS:
        raise InputError(f"no residuals {kind!r}; known: {', '.join(KINDS)}")
    if kind == "keypoint":
        return keypoint_residual_px(scene)
    tracks, count = scene.tracks, len(scene.views)
    lit = tracks.lit
    found = np.full(len(tracks), np.nan)
    total = np.bincount(tracks.view[lit], tracks.brightness[lit], count)
    mean = total / np.maximum(np.bincount(tracks.view[lit], minlength=count), 1)
    found[lit] = 100.0 * brightness_residuals(scene)[lit] / mean[tracks.view[lit]]
    return found


def plot_residuals(axes: Axes, scene: Scene, *, view: int | None = None, kind: str = "brightness") -> Axes:
    """Residuals of every view as a box plot, or those of one view as a map; returns the axes.

    Boxes hold the middle half, lines end at the 5th and the 95th percentile. Raises InputError as `residuals`.
    """
    found = residuals(scene, kind)
    if view is None:
        return _boxes(axes, scene, found, kind)
    grid, signed = scene.grid_of_observations(found, np.flatnonzero(scene.tracks.view == view)), kind == "brightness"
    clim = symmetric_limits(grid) if signed else limits(grid, high=STEEP_PERCENT, zero=True)
    cmap, label = "RdBu_r" if signed else "magma", _LABELS[kind].replace("\n", " ")
    show_map(axes, grid, scene.region, f"Residuals of {scene.views.name[view]}", label=label, cmap=cmap, clim=clim)
    add_marks(axes, scene, view)
    return axes


def _boxes(axes: Axes, scene: Scene, found: np.ndarray, kind: str) -> Axes:
    boxes = []
    for k, name in enumerate(scene.views.name):
        own = found[(scene.tracks.view == k) & np.isfinite(found)]
        parts = [_WHISKERS[0], 25.0, 50.0, 75.0, _WHISKERS[1]]
        low, first, middle, third, high = np.percentile(own, parts) if len(own) else np.full(len(parts), np.nan)
        box = {"med": middle, "q1": first, "q3": third, "whislo": low, "whishi": high}
        boxes.append({"label": Path(name).stem, **box})
    axes.bxp(boxes, showfliers=False)
    axes.tick_params(axis="x", labelrotation=90.0)
    axes.set_ylabel(_LABELS[kind])
    if kind == "brightness":
        axes.axhline(0.0, color="0.6", linewidth=0.8, zorder=0)
    else:
        axes.set_ylim(bottom=0.0)
    axes.set_title("Residuals of the views")
    return axes
