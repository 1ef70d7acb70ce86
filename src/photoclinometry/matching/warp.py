"""From a network's dense warp to matches: all of a learned matcher except the network.

A network is any function of two pictures that returns the position of each pixel of one in the other, with a certainty:
in torch (`matching/roma.py`), in ONNX, or a substitute in tests. It compares the reference with the pre-warped target,
as `flow` does. It therefore need not find rotations and scales that are known, and the same ground fills both pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from photoclinometry.matching.flow import crop, in_target, pixel_centers, resample
from photoclinometry.matching.interface import Matches, MatchRequest, region_matches
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.sampling import ALL_VALID, sample
from photoclinometry.model.tiny import TINY

STRETCH_PERCENT = (0.5, 99.5)
"""Percentiles of a picture's brightness that become black and white: hot pixels do not set the range."""

ROUNDING_PX = 1e-6
"""Largest distance of a match beyond the outermost pixels' centres, because of rounding [px]."""


@dataclass(frozen=True, kw_only=True)
class Warp:
    """Positions of one picture's points in another, on a grid (H, W) of any size that covers the whole picture."""

    position: np.ndarray
    """(H, W, 2) position of each cell's centre in the other picture: x from -1, its left edge, to 1, its right edge; y
    likewise from top to bottom."""
    certainty: np.ndarray
    """(H, W) in [0, 1]."""


Network = Callable[[np.ndarray, np.ndarray], tuple[Warp, Warp]]
"""Two pictures (h, w) float32 in [0, 1] -> warps from the first to the second, and back."""


@dataclass(frozen=True, kw_only=True)
class WarpOptions(Ranged):
    """Selection of a network's matches, and their standard deviation."""

    max_round_trip_px: Annotated[float, Range(above=0)] = 1.0
    """A match, followed by the match in the other direction, must end within this of its pixel [px]."""
    min_certainty: Annotated[float, Range(least=0, most=1)] = 0.05
    """Least certainty that the network gives a match."""
    sigma_cells: Annotated[float, Range(above=0)] = 0.5
    """Standard deviation of a match about each axis, in cells of the warp's grid (pixels, as the network sees
    them)."""


@dataclass(frozen=True)
class WarpMatcher:
    """A network's dense matches after the pre-warp (`interface.Matcher`)."""

    network: Network
    options: WarpOptions
    name: str = "warp"

    def match(self, request: MatchRequest) -> Matches:
        reference, target = crop(request.reference, request.padded), resample(request.target, request.prediction)
        there, back = self.network(stretch(*reference), stretch(*target))
        return matches_from_warps(request, reference[1], target[1], there, back, self.options)


def matches_from_warps(
    request: MatchRequest,
    reference_valid: np.ndarray,
    target_valid: np.ndarray,
    there: Warp,
    back: Warp,
    options: WarpOptions,
) -> Matches:
    """Matches of the region from warps between the padded reference and the pre-warped target, both (h, w).

    Kept are matches on valid pixels whose round trip is short and whose certainty is high enough. The standard
    deviation is that of the options and the round trip, in quadrature: a warp has no covariance, and certainty does not
    measure precision.
    """
    shape = reference_valid.shape
    centres = pixel_centers(shape)
    forward, backward = (displacement(warp, shape) for warp in (there, back))
    found = centres + forward
    round_trip = np.linalg.norm(forward + sample(backward, found, order=1), axis=-1)
    certainty = np.clip(on_grid(there.certainty, shape), 0.0, 1.0)
    position = sample(request.prediction, found, order=1)
    valid = reference_valid & (sample(target_valid.astype(float), found, order=1) > ALL_VALID)
    outermost = np.array(shape[::-1]) - (0.5 - ROUNDING_PX)
    valid &= np.all((found > 0.5 - ROUNDING_PX) & (found < outermost), axis=-1) & np.isfinite(position).all(-1)
    valid &= (round_trip < options.max_round_trip_px) & (certainty >= options.min_certainty)
    cell_px = np.sqrt(np.prod(shape) / there.certainty.size)
    sigma = in_target(np.hypot(options.sigma_cells * cell_px, round_trip), request.prediction)
    return region_matches(request, position, certainty, sigma, valid)


def stretch(brightness: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """(h, w) float32 in [0, 1]: brightness between percentiles of the valid pixels; invalid ones get their median."""
    if not valid.any():
        return np.full(brightness.shape, 0.5, np.float32)
    low, middle, high = np.percentile(brightness[valid], (STRETCH_PERCENT[0], 50, STRETCH_PERCENT[1]))
    filled = np.where(valid, brightness, middle)
    return np.clip((filled - low) / max(high - low, TINY), 0.0, 1.0).astype(np.float32)


def displacement(warp: Warp, shape: tuple[int, ...]) -> np.ndarray:
    """(h, w, 2) [px] from each pixel of a picture to its position in another of the same shape, by a warp."""
    height, width = shape
    return (on_grid(warp.position, shape) + 1.0) / 2.0 * (width, height) - pixel_centers(shape)


def on_grid(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Values (H, W, ...) of cells as values (h, w, ...) of other cells on the same area, linear between centres.

    Beyond the outermost centres values are extrapolated linearly, so that linear functions are exact. H and W must be 2
    or more.
    """
    for axis in (0, 1):
        values = _along(np.asarray(values, float), shape[axis], axis)
    return values


def _along(values: np.ndarray, count: int, axis: int) -> np.ndarray:
    values = np.moveaxis(values, axis, 0)
    where = (np.arange(count) + 0.5) * len(values) / count - 0.5
    low = np.clip(np.floor(where).astype(int), 0, len(values) - 2)
    share = (where - low).reshape(-1, *[1] * (values.ndim - 1))
    return np.moveaxis((1.0 - share) * values[low] + share * values[low + 1], 0, axis)
