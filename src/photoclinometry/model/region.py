"""A rectangle of an image in whole pixels, and the grid of landmarks in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Region:
    """A rectangle of the reference image, in whole pixels, and which of its pixels may become landmarks."""

    row: int
    """Of the top-left pixel, from 0."""
    col: int
    """Of the top-left pixel, from 0."""
    height: int
    """[px]."""
    width: int
    """[px]."""
    stride: int = 1
    """Spacing of the map's grid, down and across, from the corner on [px]."""

    @classmethod
    def of_image(cls, height: int, width: int, stride: int = 1) -> Self:
        """All pixels of an image."""
        return cls(row=0, col=0, height=height, width=width, stride=stride)

    @property
    def slices(self) -> tuple[slice, slice]:
        """Of the whole image: all of the region's pixels."""
        return slice(self.row, self.row + self.height), slice(self.col, self.col + self.width)

    @property
    def grid_shape(self) -> tuple[int, int]:
        """Rows and columns of the map's grid."""
        return -(-self.height // self.stride), -(-self.width // self.stride)

    @property
    def grid_slices(self) -> tuple[slice, slice]:
        """Of arrays over all of the region's pixels: those of the map's grid."""
        return slice(None, None, self.stride), slice(None, None, self.stride)

    def slices_in(self, outer: Region) -> tuple[slice, slice]:
        """Of arrays over all pixels of a region around this one: all of this one's pixels."""
        row, col = self.row - outer.row, self.col - outer.col
        return slice(row, row + self.height), slice(col, col + self.width)

    def row_blocks(self, count: int) -> list[Self]:
        """The region divided into parts of `count` rows of the map's grid; the last may have fewer."""
        step, bottom = count * self.stride, self.row + self.height
        return [replace(self, row=row, height=min(step, bottom - row)) for row in range(self.row, bottom, step)]

    def cells(self, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Row and column (J,) in the map's grid of pixels (J, 2) of the image that are landmarks'."""
        row, col = ((pixel - (self.row, self.col)) // self.stride).T
        return row, col

    def between_cells(self, values: np.ndarray) -> np.ndarray:
        """Values (rows, cols, ...) on the map's grid at every pixel (height, width, ...), linear from cell to cell.

        NaN where one of the cells used is NaN; values beyond the last row and column are those of the last ones.
        """
        for axis, count in enumerate((self.height, self.width)):
            cell = np.arange(count) / self.stride
            low = cell.astype(int)
            share = np.where(low == values.shape[axis] - 1, 0.0, cell - low)
            high = np.where(share > 0.0, low + 1, low)
            share = share.reshape(-1, *[1] * (values.ndim - 1 - axis))
            values = (1.0 - share) * np.take(values, low, axis) + share * np.take(values, high, axis)
        return values

    def pixel_centers(self) -> np.ndarray:
        """(height, width, 2) pixel coordinates (x, y) of the pixel centres."""
        x, y = np.meshgrid(self.col + 0.5 + np.arange(self.width), self.row + 0.5 + np.arange(self.height))
        return np.stack([x, y], -1)
