"""A closed surface from six sides: shaded, and coloured by what is known at its vertices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.figures.draw import bare, colour_map, limits, mark_number, panels, save, style
from photoclinometry.surface.closed_mesh import vertex_normals
from photoclinometry.surface.mesh_rays import MeshRays

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDES = (
    ("0° E", "from +x", (1.0, 0.0, 0.0)),
    ("90° E", "from +y", (0.0, 1.0, 0.0)),
    ("180°", "from -x", (-1.0, 0.0, 0.0)),
    ("90° W", "from -y", (0.0, -1.0, 0.0)),
    ("north", "from +z", (0.0, 0.0, 1.0)),
    ("south", "from -z", (0.0, 0.0, -1.0)),
)
"""Titles of a body with longitudes and of one in a frame of its own, and directions from the body to the viewer."""
PIXELS = 320
"""Width and height of each picture [px]."""
PANEL = 2.6
"""Width and height of each picture [inches]."""
GAP = (0.12, 0.3)
"""Across and down between pictures [inches]."""
_SAME_DEPTH = 0.05
"""Ground that is nearer than a point by less than this share of half the picture does not hide it."""
LIGHT = (-0.45, 0.45, 0.77)
"""Towards the Sun, in the picture: rightwards, upwards, towards the viewer. Left above, as people expect."""
AMBIENT = 0.15
"""Brightness of ground that the Sun does not reach, so that the whole shape is seen."""


class Side(NamedTuple):
    """The body seen from one side, through PIXELS x PIXELS parallel rays."""

    triangle: np.ndarray
    """(n,) int, -1 beside the body."""
    weight: np.ndarray
    """(n, 3) of the triangle's corners."""
    axes: np.ndarray
    """(3, 3) rightwards, upwards and towards the viewer, in B."""


def seen_from(rays: MeshRays, towards: np.ndarray) -> Side:
    """The surface that parallel rays from a direction (3,) meet first; the body fills the picture."""
    reach = _reach(rays)
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

    with style():
        figure, axes = panels(2, 3, PANEL, 1.0, GAP, (0.1, 0.1 if values is None else 0.9, 0.1, 0.6))
        colours = None if values is None else Normalize(*limits(values[np.isfinite(values)]))
        for panel, name, side in zip(axes.flat, titles(shape), _sides(rays), strict=True):
            if values is None or colours is None:
                _show_shaded(panel, rays, side, _normals(shape))
            else:
                drawn = _of_vertices(rays, side, values[:, None])[:, 0].reshape(PIXELS, PIXELS)
                panel.imshow(drawn, cmap=colour_map(cmap), norm=colours)
            bare(panel, name)
        figure.suptitle(title, fontsize=11)
        if colours is not None:
            bar = figure.add_axes((0.91, 0.15, 0.018, 0.65))
            figure.colorbar(ScalarMappable(colours, colour_map(cmap)), cax=bar)
        return save(figure, path)


def draw_numbered_sides(path: Path, rays: MeshRays, shape: ShapeModel, marked: Sequence[int]) -> Path:
    """The six sides, shaded, in three rows; vertices of these numbers are marked 1, 2, ... where they are seen best."""
    with style():
        figure, axes = panels(3, 2, PANEL, 1.0, GAP, (0.1, 0.1, 0.1, 0.3))
        sides = list(_sides(rays))
        for panel, name, side in zip(axes.flat, titles(shape), sides, strict=True):
            _show_shaded(panel, rays, side, _normals(shape))
            bare(panel, name)
        for count, vertex in enumerate(marked, 1):
            best, place = best_seen(rays, sides, shape.vertices[vertex], _normals(shape)[vertex])
            mark_number(axes.flat[best], count, place)
        return save(figure, path)


def _sides(rays: MeshRays) -> Iterator[Side]:
    return (seen_from(rays, np.array(towards)) for *_, towards in SIDES)


def titles(shape: ShapeModel) -> list[str]:
    """Of the six sides. A model without a unit of length is made from images alone, which do not determine the
    poles."""
    return [of_axis if shape.from_images_alone else geographic for geographic, of_axis, _ in SIDES]


def best_seen(
    rays: MeshRays, sides: Sequence[Side], point: np.ndarray, normal: np.ndarray
) -> tuple[int, tuple[float, float]]:
    """The side that sees a point (3,) with its normal (3,) least obliquely, and (x, y) in its picture [px]."""
    best = max(range(len(sides)), key=lambda n: _seen(rays, sides[n], point, normal))
    x, y = _pixel(rays, sides[best], point)
    return best, (float(x), float(y))


def _seen(rays: MeshRays, side: Side, point: np.ndarray, normal: np.ndarray) -> float:
    """Cosine of emission of a point (3,) from a side; -1 where other ground is before it."""
    x, y = np.clip(_pixel(rays, side, point), 0, PIXELS - 1).astype(int)
    triangle = side.triangle[y * PIXELS + x]
    if triangle < 0:
        return -1.0
    depth = rays.vertices[rays.faces[triangle]].mean(0) @ side.axes[2]
    behind = depth - point @ side.axes[2]
    return float(normal @ side.axes[2]) if behind < _SAME_DEPTH * _reach(rays) else -1.0


def _pixel(rays: MeshRays, side: Side, point: np.ndarray) -> np.ndarray:
    """(x, y) of a point (3,) in the picture of a side [px]."""
    across, up, _ = side.axes @ point
    return (1.0 + np.array([across, -up]) / _reach(rays)) * 0.5 * PIXELS


def _reach(rays: MeshRays) -> float:
    """Half the width of a picture, in the unit of the mesh."""
    return 1.02 * float(np.linalg.norm(rays.vertices, axis=1).max())


def _normals(shape: ShapeModel) -> np.ndarray:
    return vertex_normals(shape.vertices, shape.faces) if shape.normals is None else shape.normals


def _show_shaded(panel: Axes, rays: MeshRays, side: Side, normals: np.ndarray) -> None:
    panel.imshow(_shaded(rays, side, normals), cmap="gray", vmin=0.0, vmax=1.0)


def _shaded(rays: MeshRays, side: Side, normals: np.ndarray) -> np.ndarray:
    """(PIXELS, PIXELS) brightness from 0 to 1 by Lambert's law; NaN beside the body."""
    light = unit(np.array(LIGHT)) @ side.axes
    cosine = unit(_of_vertices(rays, side, normals)) @ light
    return (AMBIENT + (1.0 - AMBIENT) * np.maximum(cosine, 0.0)).reshape(PIXELS, PIXELS)


def _of_vertices(rays: MeshRays, side: Side, values: np.ndarray) -> np.ndarray:
    """(n, d) values (V, d) of vertices where the rays meet the body; NaN beside it."""
    found = rays.interpolated(values, side.triangle, side.weight)
    return np.where((side.triangle >= 0)[:, None], found, np.nan)
