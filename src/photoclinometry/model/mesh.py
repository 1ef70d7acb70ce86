"""Triangles over a grid of points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from photoclinometry.model.scene import Scene

STRETCH_LIMIT = 6.0
"""A triangle with an edge longer than this many median edges spans a jump in depth, not a surface."""


def grid_faces(position: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Triangles (F, 3) over a grid of points: two per cell whose corners are present, one if three are.

    position: (h, w, 3); present: (h, w) bool. Indices count row by row over the whole grid. Triangles with an edge
    longer than STRETCH_LIMIT median edges (depth jumps, spikes) are left out.
    """
    index = np.arange(present.size).reshape(present.shape)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    has = present.ravel()
    # Whole cells, and those without a or d, are cut along the diagonal b-c; those without b or c along a-d.
    other = (has[a] & has[d]) & (has[b] ^ has[c])
    first = np.where(other[:, None], np.stack([a, c, d], -1), np.stack([a, c, b], -1))
    second = np.where(other[:, None], np.stack([a, d, b], -1), np.stack([b, c, d], -1))
    faces = np.concatenate([first, second])
    faces = faces[has[faces].all(-1)]
    if len(faces) == 0:
        return faces
    corner = position.reshape(-1, 3)[faces]
    edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=-1)
    return faces[(edge < STRETCH_LIMIT * np.median(edge)).all(-1)]


def landmark_faces(scene: Scene) -> np.ndarray:
    """Triangles (F, 3) of landmark indices over the map's grid (`grid_faces`), counter-clockwise as seen by the
    reference view, so that they face outwards."""
    position = scene.grid(scene.landmarks.position)
    index = scene.grid(np.arange(len(scene.landmarks)), fill=0).astype(np.int64).ravel()
    return index[grid_faces(position, np.isfinite(position[..., 0]))]
