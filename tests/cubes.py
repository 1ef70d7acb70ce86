"""The cube of side 2 about the origin, whose gravity, inertia and radii have closed forms."""

import numpy as np

CUBE = (
    np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float),
    np.array(
        [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5], [2, 3, 7], [2, 7, 6], [0, 6, 4], [0, 2, 6]]
        + [[1, 5, 7], [1, 7, 3]]
    ),
)
"""Vertices (8, 3) and faces (12, 3)."""
