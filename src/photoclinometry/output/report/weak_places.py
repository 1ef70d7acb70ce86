"""The worst places of a map: ground with few views, large sigmas, and brightness that the map does not explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.scene import Scene
from photoclinometry.output.figures.layers import LAYERS
from photoclinometry.output.report.facts import WorstPlace

BLOCKS = 8
"""Number of blocks along the longer side of a map."""
_LEAST_CELLS = 4
"""Smallest side of a block [cells of the grid]."""
_LEAST_SHARE = 0.25
"""Share of a block's cells that must have a landmark for the block to be judged."""
NOTABLE = 1.5
"""A block is named if it is this many times worse than the middle of the map."""
_JUDGED = (
    ("views", "fewest views", False, "in the mean"),
    ("height-sigma", "largest uncertainty of heights", True, "in the median"),
    ("normal-sigma", "largest uncertainty of normals", True, "in the median"),
    ("residual", "largest photometric error", True, "in the median"),
)
"""Layers, the property of a bad block in words, whether large values are bad, and the statistic of a block."""
_THIRDS = (("upper left", "top", "upper right"), ("left", "middle", "right"), ("lower left", "bottom", "lower right"))


@dataclass(frozen=True, kw_only=True)
class WeakPlace(WorstPlace):
    """A block of the map's grid."""

    corner: tuple[float, float]
    """(x, y) of its upper left corner in the reference image [px]."""
    size: tuple[float, float]
    """Width and height [px]."""


def weak_places(scene: Scene) -> tuple[WeakPlace, ...]:
    """The worst block in every respect in which it is NOTABLE times worse than the whole map, each block once."""
    found: dict[tuple[int, int], WeakPlace] = {}
    for name, words, large_is_bad, how in _JUDGED:
        layer = LAYERS[name]
        if layer.lacks(scene) is not None:
            continue
        grid, side = scene.grid(layer.values(scene)), block_side(scene.region.grid_shape)
        blocks = block_values(grid, side, mean=not large_is_bad)
        if not np.isfinite(blocks).any():
            continue
        whole = float(np.nanmean(grid) if not large_is_bad else np.nanmedian(grid[np.isfinite(grid)]))
        row, col = np.unravel_index(np.nanargmax(blocks if large_is_bad else -blocks), blocks.shape)
        value = float(blocks[row, col])
        if not stands_out(value, whole, large_is_bad=large_is_bad) or (row, col) in found:
            continue
        told = compared(words, value, whole, _unit_of(layer.label(scene)), how, "map")
        found[int(row), int(col)] = _place(scene, int(row), int(col), side, told)
    return tuple(found.values())


def stands_out(value: float, whole: float, *, large_is_bad: bool) -> bool:
    """Whether a part of a map is NOTABLE times worse than the whole."""
    return value >= NOTABLE * whole if large_is_bad else value * NOTABLE <= whole


def compared(words: str, value: float, whole: float, unit: str, how: str, of: str) -> str:
    """The fault of a part of a map, with its value and that of the whole (of: "map" or "surface")."""
    return f"{words}: {value:.3g}{unit} {how}, of the whole {of} {whole:.3g}{unit}"


def block_side(shape: tuple[int, int]) -> int:
    """Side of the blocks [cells] of a grid of this shape."""
    return max(_LEAST_CELLS, -(-max(shape) // BLOCKS))


def block_values(grid: np.ndarray, side: int, *, mean: bool) -> np.ndarray:
    """The mean or the median of the finite values (h, w) in each block; NaN where too few cells have one."""
    rows, cols = (-(-size // side) for size in grid.shape)
    found = np.full((rows, cols), np.nan)
    for row, col in np.ndindex(rows, cols):
        cells = grid[row * side : (row + 1) * side, col * side : (col + 1) * side]
        known = cells[np.isfinite(cells)]
        if known.size >= _LEAST_SHARE * side * side:
            found[row, col] = known.mean() if mean else np.median(known)
    return found


def _place(scene: Scene, row: int, col: int, side: int, words: str) -> WeakPlace:
    region, (rows, cols) = scene.region, scene.region.grid_shape
    high, wide = min(side, rows - row * side), min(side, cols - col * side)
    corner = (region.col + region.stride * col * side, region.row + region.stride * row * side)
    size = (float(region.stride * wide), float(region.stride * high))
    middle = (corner[0] + 0.5 * size[0], corner[1] + 0.5 * size[1])
    across, down = (middle[0] - region.col) / region.width, (middle[1] - region.row) / region.height
    third = _THIRDS[min(2, int(3 * down))][min(2, int(3 * across))]
    return WeakPlace(
        words=words,
        where=f"{third}, around column {middle[0]:.0f}, row {middle[1]:.0f}",
        corner=(float(corner[0]), float(corner[1])),
        size=size,
    )


def _unit_of(label: str) -> str:
    """The unit in brackets at the end of a label, after a blank where it is a word."""
    if not label.endswith("]"):
        return ""
    unit = label[label.rindex("[") + 1 : -1]
    return unit if unit == "°" else f" {unit}"
