"""Distances, height differences, slopes and volumes of a map, with their standard deviations.

Places are pixels (x, y) of the reference image, in the reverse order of `Landmarks.pixel`: (0.5, 0.5) is the centre of
the top-left one. Each stands for the landmark of its cell. Heights are over the map's mean plane. Standard deviations
include the correlation of errors of different landmarks (`Scene.sigma_of`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import Scene
from photoclinometry.surface.relief import local_frame

Pixel = tuple[float, float]
"""(x, y) of the reference image [px]."""

_FEWEST_ON_BORDER = 8
"""Fewest landmarks around a volume: more than the three numbers of the plane that they determine."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A quantity of a map."""

    value: float
    sigma: float
    """Standard deviation, in the unit of the value."""
    unit: str
    """"m", "m^3" or "deg"; where the map has no unit of length, "GSD" and "GSD^3"."""

    def __str__(self) -> str:
        digits = 1 - math.floor(math.log10(self.sigma)) if 0.0 < self.sigma < math.inf else 3
        number = f".{min(max(digits, 0), 12)}f"
        return f"{self.value:{number}} +- {self.sigma:{number}} {self.unit}"


def distance(scene: Scene, a: Pixel, b: Pixel) -> Measured:
    """Straight from one place to another. Raises InputError as `landmark_at`, or as `Scene.sigma_of`."""
    pair, between = _from_to(scene, a, b)
    length = float(np.linalg.norm(between))
    along = between / length
    return _length(scene, length, scene.sigma_of(pair, np.stack([-along, along])))


def height_difference(scene: Scene, a: Pixel, b: Pixel) -> Measured:
    """Height of the second place above the first. Raises InputError as `distance`."""
    pair, between = _from_to(scene, a, b)
    up = local_frame(scene).rotation[:, 2]
    return _length(scene, float(between @ up), scene.sigma_of(pair, np.stack([-up, up])))


def slope(scene: Scene, a: Pixel, b: Pixel) -> Measured:
    """Of the straight line from one place to another against the mean plane, upwards positive [degrees].

    Raises InputError as `distance`.
    """
    pair, between = _from_to(scene, a, b)
    up = local_frame(scene).rotation[:, 2]
    rise = float(between @ up)
    flat = between - rise * up
    run = float(np.linalg.norm(flat))
    turn = (run * up - rise * flat / max(run, np.finfo(float).tiny)) / (run**2 + rise**2)
    sigma = scene.sigma_of(pair, np.stack([-turn, turn]))
    return Measured(value=math.degrees(math.atan2(rise, run)), sigma=math.degrees(sigma), unit="deg")


def volume(scene: Scene, outline: np.ndarray) -> Measured:
    """Volume between the ground within an outline and the plane through the ground along it; negative for hollows.

    outline: (n, 2) corners (x, y) of a polygon in the reference image [px]. Raises InputError where the polygon
    contains too few landmarks, or holes; and as `Scene.sigma_of`.
    """
    inside = _within(scene, np.asarray(outline, float))
    index = scene.grid(np.arange(len(scene.landmarks), dtype=float), fill=-1.0).astype(int)
    if (index[inside] < 0).any():
        raise InputError("the outline contains cells without landmarks: choose one around them, or fill the map")
    border = inside & ~cv2.erode(inside.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0).astype(bool)
    if np.count_nonzero(border) < _FEWEST_ON_BORDER or not (inside & ~border).any():
        raise InputError(f"the outline contains {np.count_nonzero(inside)} landmarks: draw a larger one")
    chosen, frame = index[inside], local_frame(scene)
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(len(chosen))
    at = frame.inverse()(scene.landmarks.position[chosen])
    total, gradient = _over_border(at, _triangles(number), number[border])
    sigma = scene.sigma_of(chosen, gradient @ frame.rotation.T)
    cube = 1.0 if scene.unit else scene.gsd**3
    return Measured(value=total / cube, sigma=sigma / cube, unit=f"{scene.unit or 'GSD'}^3")


def landmark_at(scene: Scene, place: Pixel) -> int:
    """The landmark whose cell of the map contains a pixel. Raises InputError where there is none."""
    region, (x, y) = scene.region, place
    row, col = (math.floor((value - first) / region.stride) for value, first in ((y, region.row), (x, region.col)))
    rows, cols = region.grid_shape
    found = np.flatnonzero((scene.cells[0] == row) & (scene.cells[1] == col))
    if not len(found):
        raise InputError(
            f"there is no landmark at pixel ({x:g}, {y:g}) of {scene.views.name[scene.reference]}: the map has columns "
            f"{region.col} to {region.col + cols * region.stride - 1} and rows {region.row} to "
            f"{region.row + rows * region.stride - 1}, and holes"
        )
    return int(found[0])


def _from_to(scene: Scene, a: Pixel, b: Pixel) -> tuple[np.ndarray, np.ndarray]:
    """Two landmarks (2,), and the way from one to the other (3,)."""
    pair = np.array([landmark_at(scene, a), landmark_at(scene, b)])
    if pair[0] == pair[1]:
        raise InputError(f"pixels {a} and {b} are one landmark: choose two places")
    return pair, scene.landmarks.position[pair[1]] - scene.landmarks.position[pair[0]]


def _length(scene: Scene, value: float, sigma: float) -> Measured:
    unit = 1.0 if scene.unit else scene.gsd
    return Measured(value=value / unit, sigma=sigma / unit, unit=scene.unit or "GSD")


def _within(scene: Scene, outline: np.ndarray) -> np.ndarray:
    """(rows, cols) bool: cells of the map whose middles lie in a polygon (n, 2) of pixels. Raises InputError."""
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3 or not np.isfinite(outline).all():
        raise InputError(f"an outline is (n, 2) pixels, three at least; got an array of shape {outline.shape}")
    region = scene.region
    rows, cols = region.grid_shape
    y, x = (first + region.stride * np.arange(count) + 0.5 for first, count in ((region.row, rows), (region.col, cols)))
    inside = np.zeros((rows, cols), bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        spans = (y0 > y) != (y1 > y)
        crossing = x0 + (y - y0) / np.where(y1 == y0, 1.0, y1 - y0) * (x1 - x0)
        inside ^= spans[:, None] & (x[None] < crossing[:, None])
    return inside


def _triangles(number: np.ndarray) -> np.ndarray:
    """(m, 3) vertices of two triangles for each square of four cells; number: (rows, cols), -1 outside."""
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    corners = np.stack([a, b, c, b, d, c], -1).reshape(-1, 3)
    return corners[(corners >= 0).all(1)]


def _over_border(at: np.ndarray, triangle: np.ndarray, border: np.ndarray) -> tuple[float, np.ndarray]:
    """Volume over the least-squares plane through the border, and its derivatives (n, 3), to first order.

    at: (n, 3) positions, heights last; triangle: (m, 3); border: (b,) indices. The dependence of the plane on its
    residuals is left out.
    """
    base = np.column_stack([np.ones(len(at)), at[:, :2]])
    fit = np.linalg.pinv(base[border])
    plane = fit @ at[border, 2]
    over = at[:, 2] - base @ plane
    corner = at[triangle, :2]
    edge = np.roll(corner, -1, axis=1) - np.roll(corner, 1, axis=1)  # opposite each corner
    area = 0.5 * np.linalg.det(corner[:, 1:] - corner[:, :1])
    sign = np.sign(area)
    mean = over[triangle].mean(1)
    weight = np.bincount(triangle.ravel(), np.repeat(np.abs(area) / 3.0, 3), len(at))
    of_height = weight.copy()
    of_height[border] -= (weight @ base) @ fit
    gradient = of_height[:, None] * np.array([-plane[1], -plane[2], 1.0])
    by_corner = 0.5 * (sign * mean)[:, None, None] * np.stack([edge[..., 1], -edge[..., 0]], -1)
    np.add.at(gradient[:, :2], triangle, by_corner)
    return float(np.abs(area) @ mean), gradient
