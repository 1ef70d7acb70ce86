"""Moves of the variables under a common rotation, shift and scale: the similarity that images leave open."""

from __future__ import annotations

import numpy as np

from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE
from photoclinometry.model.geometry import point_moves, skew

SIMILARITY = 7
"""Numbers of a similarity, which images leave open: rotation 3, translation 3, scale 1."""


def landmark_moves(position: np.ndarray, normal: np.ndarray, basis: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """(n, 6, 7): local coordinates of landmarks by rotation, translation and scale about the pivot (3,).

    position, normal: (n, 3); basis: (n, 3, 2), the normals' `tangent_basis`.
    """
    out = np.zeros((len(position), LANDMARK_SIZE, SIMILARITY))
    out[:, :3] = point_moves(position, pivot)
    out[:, 3:5, :3] = -np.einsum("jia,jib->jab", basis, skew(normal))
    return out


def view_moves(center: np.ndarray, sun: np.ndarray, basis: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """(K, 10, 7): local coordinates of views likewise. center, sun: (K, 3); basis: (K, 3, 2), of the Suns."""
    out = np.zeros((len(center), VIEW_SIZE, SIMILARITY))
    out[:, range(3), range(3)] = 1.0
    out[:, range(3, 6), range(3, 6)] = 1.0
    out[:, 3:6, 6] = center - pivot
    out[:, 6:8, :3] = -np.einsum("kia,kib->kab", basis, skew(sun))
    return out
