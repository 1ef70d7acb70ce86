"""How observations lie in memory: groups of neighbouring landmarks that share a list of views.

A dense landmark x image array wastes memory as soon as views see different ground, and a ragged list keeps compiled
loops from vector instructions. Between them: landmarks are sorted along a space-filling curve and taken sixteen at a
time, the lanes of a group; the group lists the views that see any of them (its slots), and each slot has one place per
lane, with weight zero where the landmark is not seen. Neighbours see nearly the same views, so little is wasted; every
loop over lanes has the same fixed length, and what belongs to a view is the same number in all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photoclinometry.model.scene import Tracks

LANES = 16
"""Landmarks of a group: sixteen single-precision numbers fill the widest vector registers, and LLVM does not vectorise
loops of fewer turns."""


class Layout(NamedTuple):
    """Where things are: landmark j is lane j % LANES of group j // LANES, and slot s has places LANES s + lane."""

    slot_start: np.ndarray
    """(G + 1,) int64: the slots of group g are slot_start[g]:slot_start[g + 1]."""
    slot_view: np.ndarray
    """(S,) int32 view of each slot."""

    @property
    def places(self) -> int:
        return LANES * len(self.slot_view)


class Measurements(NamedTuple):
    """Measurements at each of P places, with weights of zero where there are none; and their losses."""

    keypoint: np.ndarray
    """(2, P) float64 [px]."""
    brightness: np.ndarray
    """(P,) float64: at pixel (0, 0), by the gradient; the brightness itself where that is zero."""
    gradient: np.ndarray
    """(2, P) float32, brightness per pixel."""
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


def build_layout(tracks: Tracks, view_count: int) -> tuple[Layout, np.ndarray]:
    """Groups for tracks whose landmarks are already in a local order, and the place (N,) of each observation."""
    landmark = tracks.landmark
    groups = -(-(len(tracks.start) - 1) // LANES)
    key = landmark // LANES * view_count + tracks.view
    seen = np.zeros(groups * view_count, bool)
    seen[key] = True
    slot = np.cumsum(seen) - 1
    used = np.flatnonzero(seen)
    start = np.searchsorted(used, view_count * np.arange(groups + 1))
    return Layout(start, (used % view_count).astype(np.int32)), LANES * slot[key] + landmark % LANES


def spread(values: np.ndarray, place: np.ndarray, size: int, dtype: type = np.float64) -> np.ndarray:
    """Per-observation values (N,) laid out over `size` places, zero elsewhere."""
    out = np.zeros(size, dtype)
    out[place] = values
    return out
