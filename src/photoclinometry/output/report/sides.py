"""A closed surface from six sides: shaded, and coloured by what is known at its vertices."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.figures.draw import bare, colour_map, limits, panels, save, style
from photoclinometry.surface.closed_mesh import vertex_normals
from photoclinometry.surface.mesh_rays import MeshRays

SIDES = (
    ("0° E", (1.0, 0.0, 0.0)),
    ("90° E", (0.0, 1.0, 0.0)),
    ("180°", (-1.0, 0.0, 0.0)),
    ("90° W", (0.0, -1.0, 0.0)),
    ("north", (0.0, 0.0, 1.0)),
    ("south", (0.0, 0.0, -1.0)),
)
"""Titles, and directions from the body to the viewer."""
PIXELS = 320
"""Width and height of each picture [px]."""
PANEL = 2.6
"""Width and height of each picture [inches]."""
LIGHT = (-0.45, 0.45, 0.77)
"""Towards the Sun, in the picture: rightwards, upwards, towards the viewer. Left above, as people expect."""
AMBIENT = 0.15
"""Brightness of ground that the Sun does not reach, so that the whole shape is seen."""


class Side(NamedTuple):
    """What is seen from one side, through PIXELS x PIXELS parallel rays."""

    triangle: np.ndarray
    """(n,) int, -1 beside the body."""
    weight: np.ndarray
    """(n, 3) of the triangle's corners."""
    axes: np.ndarray
    """(3, 3) rightwards, upwards and towards the viewer, in B."""


def seen_from(rays: MeshRays, towards: np.ndarray) -> Side:
    """What parallel rays from a direction (3,) meet first; the body fills the picture."""
    reach = 1.02 * float(np.linalg.norm(rays.vertices, axis=1).max())
    up = np.array([1.0, 0.0, 0.0]) if abs(towards[2]) > 0.9 else np.array([0.0, 0.0, 1.0])
    right = unit(np.cross(up, towards))
    axes = np.stack([right, np.cross(towards, right), towards])
    at = reach * ((np.arange(PIXELS) + 0.5) * 2.0 / PIXELS - 1.0)
    x, y = np.meshgrid(at, -at)
    origin = np.stack([x.ravel(), y.ravel(), np.full(x.size, 2.0 * reach)], -1) @ axes
    return Side(*rays.first_hit(origin, np.broadcast_to(-towards, origin.shape)), axes)


def draw_sides(
    path: Path, rays: MeshRays, shape: ShapeModel, title: str, values: np.ndarray | None = None, cmap: str = "viridis"
) -> Path:
    """The six sides: shaded, or in colours of values (V,) with a bar; what is not known is grey. Returns the path."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    normals = vertex_normals(shape.vertices, shape.faces) if shape.normals is None else shape.normals
    with style():
        figure, axes = panels(2, 3, PANEL, 1.0, (0.12, 0.3), (0.1, 0.1 if values is None else 0.9, 0.1, 0.6))
        colours = None if values is None else Normalize(*limits(values[np.isfinite(values)]))
        for panel, (name, towards) in zip(axes.flat, SIDES, strict=True):
            side = seen_from(rays, np.array(towards))
            if values is None or colours is None:
                picture = _shaded(rays, side, normals)
                panel.imshow(picture, cmap="gray", vmin=0.0, vmax=1.0)
            else:
                drawn = _of_vertices(rays, side, values[:, None])[:, 0].reshape(PIXELS, PIXELS)
                panel.imshow(drawn, cmap=colour_map(cmap), norm=colours)
            bare(panel, name)
        figure.suptitle(title, fontsize=11)
        if colours is not None:
            bar = figure.add_axes((0.91, 0.15, 0.018, 0.65))
            figure.colorbar(ScalarMappable(colours, colour_map(cmap)), cax=bar)
        return save(figure, path)


def _shaded(rays: MeshRays, side: Side, normals: np.ndarray) -> np.ndarray:
    """(PIXELS, PIXELS) brightness from 0 to 1 by Lambert's law; NaN beside the body."""
    light = unit(np.array(LIGHT)) @ side.axes
    cosine = unit(_of_vertices(rays, side, normals)) @ light
    return (AMBIENT + (1.0 - AMBIENT) * np.maximum(cosine, 0.0)).reshape(PIXELS, PIXELS)


def _of_vertices(rays: MeshRays, side: Side, values: np.ndarray) -> np.ndarray:
    """(n, d) values (V, d) of vertices where the rays meet the body; NaN beside it."""
    found = rays.interpolated(values, side.triangle, side.weight)
    return np.where((side.triangle >= 0)[:, None], found, np.nan)
