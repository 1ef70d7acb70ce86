"""How observations lie in memory: blocks of neighbouring landmarks that share a list of views.

A dense landmark x image array wastes memory as soon as views see different ground, and a ragged list keeps
compiled loops from running over contiguous data. Between them: landmarks are sorted along a space-filling
curve and cut into blocks; a block lists the views that see any of its landmarks (its slots), and every
landmark of the block has one place per slot, with weight zero where it is not seen. Neighbours see
nearly the same views, so little is wasted; loops over slots are contiguous, and what belongs to a view is
gathered once per block.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from photoclinometry.scene import Tracks

LANES = 16
"""Slots come in multiples of this, so that loops over them have a fixed length that compilers turn into vector
instructions (LLVM leaves loops of fewer than 16 alone)."""

_FILL = 0.6
"""A block is closed before less than this share of its places would hold an observation."""


class Layout(NamedTuple):
    """Where things are. Landmarks and observations are in the solver's order."""

    landmark_start: np.ndarray
    """(B + 1,) int64: block b holds landmarks landmark_start[b]:landmark_start[b + 1]."""
    slot_start: np.ndarray
    """(B + 1,) int64: block b's views are slot_view[slot_start[b]:slot_start[b + 1]]."""
    slot_view: np.ndarray
    """(S,) int32 view of each slot; a block's last slots may repeat its first view, with nothing measured there."""
    place_start: np.ndarray
    """(B + 1,) int64: the first place of block b; landmark i of it begins i * slots later."""


class Measurements(NamedTuple):
    """What was measured at each of P places; weights are zero where nothing was. And the losses of what was."""

    keypoint: np.ndarray
    """(2, P) float64 [px]."""
    brightness: np.ndarray
    """(P,) float64."""
    keypoint_weight: np.ndarray
    """(P,) float32, 1 / sigma [1/px]."""
    brightness_weight: np.ndarray
    """(P,) float32, 1 / sigma."""
    keypoint_limit: np.ndarray
    """(J,) float64: Huber limit of each landmark's keypoints, in sigmas; infinite for least squares."""
    brightness_limit: float
    """Huber limit of every brightness, in sigmas."""


def morton_order(pixel: np.ndarray) -> np.ndarray:
    """Order (J,) of pixels (J, 2) along a Z-shaped curve: neighbours on the surface become neighbours in memory."""
    key = np.zeros(len(pixel), np.uint64)
    row, col = (pixel - pixel.min(0)).astype(np.uint64).T
    for bit in range(21):
        mask = np.uint64(1 << bit)
        key |= ((col & mask) << np.uint64(bit)) | ((row & mask) << np.uint64(bit + 1))
    return np.argsort(key, kind="stable")


def build_layout(tracks: Tracks, view_count: int, block_size: int = 32) -> tuple[Layout, np.ndarray]:
    """Blocks for tracks whose landmarks are already in a local order, and the place (N,) of each observation."""
    landmark_start = np.array(_cut(tracks.start, tracks.view, view_count, block_size), np.int64)
    block = np.searchsorted(landmark_start, tracks.landmark, side="right") - 1
    seen = np.unique(block * view_count + tracks.view)
    used = np.bincount(seen // view_count, minlength=len(landmark_start) - 1)
    slot_count = -(-used // LANES) * LANES
    slot_start = np.concatenate([[0], np.cumsum(slot_count)])
    used_start = np.cumsum(used) - used
    slot_view = np.repeat(seen[used_start] % view_count, slot_count).astype(np.int32)
    slot_view[np.arange(len(seen)) + np.repeat(slot_start[:-1] - used_start, used)] = seen % view_count
    layout = Layout(
        landmark_start,
        slot_start,
        slot_view,
        np.concatenate([[0], np.cumsum(np.diff(landmark_start) * slot_count)]),
    )
    slot = np.searchsorted(seen, block * view_count + tracks.view) - used_start[block]
    row = tracks.landmark - landmark_start[block]
    return layout, layout.place_start[block] + row * slot_count[block] + slot


@njit(cache=True)
def _cut(start, view, view_count, block_size):
    """Landmark indices at which blocks begin, and the end."""
    cuts = [0]
    seen = np.zeros(view_count, np.bool_)
    slots, observed = 0, 0
    for j in range(start.size - 1):
        new = 0
        for i in range(start[j], start[j + 1]):
            new += not seen[view[i]]
        count = start[j + 1] - start[j]
        size = j + 1 - cuts[-1]
        if size > block_size or (size > 1 and observed + count < _FILL * size * (slots + new)):
            cuts.append(j)
            seen[:] = False
            slots, observed, new = 0, 0, count
        for i in range(start[j], start[j + 1]):
            seen[view[i]] = True
        slots += new
        observed += count
    cuts.append(start.size - 1)
    return cuts


def lay_out(tracks: Tracks, place: np.ndarray, size: int) -> Measurements:
    """Keypoints with their own sigmas and brightness without weight, as least squares."""
    return Measurements(
        np.array([spread(axis, place, size) for axis in tracks.keypoint.T]),
        spread(tracks.brightness, place, size),
        spread(1.0 / tracks.keypoint_sigma, place, size, np.float32),
        np.zeros(size, np.float32),
        np.full(len(tracks.start) - 1, np.inf),
        np.inf,
    )


def spread(values: np.ndarray, place: np.ndarray, size: int, dtype: type = np.float64) -> np.ndarray:
    """Per-observation values (N,) laid out over `size` places, zero elsewhere."""
    out = np.zeros(size, dtype)
    out[place] = values
    return out
