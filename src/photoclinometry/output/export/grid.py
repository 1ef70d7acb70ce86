"""Resampling of a mesh to a north-up grid, by linear interpolation on its triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.surface.rasterise import draw_triangles

MAX_PIXELS = 25_000_000
"""Largest map [px]: 100 MB per band; a finer --resolution than the landmarks' shows nothing more."""


@dataclass(frozen=True, kw_only=True)
class MapGrid:
    """Square pixels of a map, rows down (south), columns right (east)."""

    corner: tuple[float, float]
    """(x, y) of the outer corner of the top-left pixel; multiples of `pixel`."""
    pixel: float
    """Width and height of a pixel, in the map's unit."""
    shape: tuple[int, int]
    """Rows and columns."""

    def pixel_centers(self) -> np.ndarray:
        """(h, w, 2) map coordinates of the pixels' centres."""
        row, col = np.indices(self.shape) + 0.5
        return np.stack([self.corner[0] + col * self.pixel, self.corner[1] - row * self.pixel], -1)

    def pixel_from_map(self, xy: np.ndarray) -> np.ndarray:
        """Pixel coordinates (..., 2) of points (..., 2) of the map; (0.5, 0.5) is the centre of the top-left pixel."""
        return (np.asarray(xy) - self.corner) / self.pixel * (1.0, -1.0)


def grid_around(xy: np.ndarray, pixel: float) -> MapGrid:
    """The grid that covers points (n, 2) of the map. Raises InputError for invalid or far too small pixels."""
    if not (np.isfinite(pixel) and pixel > 0):
        raise InputError(f"--resolution {pixel}: give a positive width of a pixel")
    low, high = np.floor(xy.min(0) / pixel), np.ceil(xy.max(0) / pixel)
    cols, rows = (np.maximum(high - low, 1.0)).tolist()
    if rows * cols > MAX_PIXELS:
        raise InputError(
            f"pixels of {pixel:g} make a map of {cols:.0f} x {rows:.0f} pixels, {MAX_PIXELS:,} are the limit; choose a "
            "coarser --resolution"
        )
    return MapGrid(corner=(float(low[0] * pixel), float(high[1] * pixel)), pixel=pixel, shape=(int(rows), int(cols)))


def resample(grid: MapGrid, xyz: np.ndarray, values: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (J, n) of a mesh's vertices at the grid's pixel centres (h, w, n), and (h, w) True where defined.

    xyz: (J, 3) map coordinates and heights; faces: (F, 3). Values are linear on each triangle; of triangles above each
    other the upper is used. Pixels whose centre is under no triangle are gaps.
    """
    pixel = grid.pixel_from_map(xyz[:, :2])
    top_first = faces[np.argsort(-xyz[faces, 2].mean(1), kind="stable")]
    return draw_triangles(pixel, np.ones(len(xyz)), values, top_first, grid.shape)


def resample_heights(
    grid: MapGrid, xyz: np.ndarray, gradient: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Heights (h, w) at the grid's pixel centres, as `resample`, using the slopes of the ground at the vertices too.

    gradient: (J, 2) of the height by x and y. With weights w_i of the corners, the height at p of a triangle is
    sum w_i (h_i + g_i . (p - p_i) / 2): half the slopes of the tangent planes are added. That is exact for quadratic
    ground, which linear interpolation flattens.
    """
    at_vertex = xyz[:, 2] - 0.5 * np.sum(gradient * xyz[:, :2], -1)
    image, valid = resample(grid, xyz, np.concatenate([at_vertex[:, None], gradient], -1), faces)
    return image[..., 0] + 0.5 * np.sum(image[..., 1:] * grid.pixel_centers(), -1), valid
