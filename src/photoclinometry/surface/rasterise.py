"""Triangles onto pixels: a z-buffer that draws a mesh as a pinhole camera sees it, or as a map."""

from __future__ import annotations

import numpy as np
from numba import njit

_NEARER = 1.0 - 1e-12
"""A depth is nearer than another if it is below this times the other: depths that differ by rounding are equal."""

_ON_EDGE = 1e-9
"""A pixel centre that is outside a triangle by no more than this, in barycentric weight or in pixels, lies on its edge,
so that rounding leaves no gaps between neighbouring triangles."""


@njit(cache=True)
def _draw(pixel, depth, value, faces, image, nearest):
    """`draw_triangles` into image (H, W, n), zero before, and nearest (H, W), its depth, infinite before.

    pixel: (V, 2); depth: (V,); value: (V, n); faces: (F, 3). Where no triangle covers a pixel's centre, both stay.
    """
    height, width = nearest.shape
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if depth[i] <= 0.0 or depth[j] <= 0.0 or depth[k] <= 0.0:
            continue
        xi, yi, xj, yj, xk, yk = pixel[i, 0], pixel[i, 1], pixel[j, 0], pixel[j, 1], pixel[k, 0], pixel[k, 1]
        area = (xj - xi) * (yk - yi) - (xk - xi) * (yj - yi)
        if area == 0.0:
            continue
        # Pixel [row, col] has its centre at (col + 0.5, row + 0.5).
        first_col = max(0, int(np.ceil(min(xi, xj, xk) - 0.5 - _ON_EDGE)))
        last_col = min(width - 1, int(np.floor(max(xi, xj, xk) - 0.5 + _ON_EDGE)))
        first_row = max(0, int(np.ceil(min(yi, yj, yk) - 0.5 - _ON_EDGE)))
        last_row = min(height - 1, int(np.floor(max(yi, yj, yk) - 0.5 + _ON_EDGE)))
        for row in range(first_row, last_row + 1):
            y = row + 0.5
            for col in range(first_col, last_col + 1):
                x = col + 0.5
                wi = ((xj - x) * (yk - y) - (xk - x) * (yj - y)) / area
                wj = ((xk - x) * (yi - y) - (xi - x) * (yk - y)) / area
                wk = 1.0 - wi - wj
                if wi < -_ON_EDGE or wj < -_ON_EDGE or wk < -_ON_EDGE:
                    continue
                # 1 / z is linear in the image; so is value / z.
                wi, wj, wk = wi / depth[i], wj / depth[j], wk / depth[k]
                z = 1.0 / (wi + wj + wk)
                if z < _NEARER * nearest[row, col]:
                    nearest[row, col] = z
                    for n in range(value.shape[1]):
                        image[row, col, n] = z * (wi * value[i, n] + wj * value[j, n] + wk * value[k, n])


def draw_triangles(
    pixel: np.ndarray, depth: np.ndarray, value: np.ndarray, faces: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """A mesh as a pinhole camera sees it: image (H, W) or (H, W, n) of `value`, zero outside, and mask (H, W) bool.

    pixel: (V, 2) projected vertices; depth: (V,) along the camera's axis; triangles with a corner at or behind the
    camera are dropped; value: (V,) or (V, n), interpolated linearly on the triangle (perspective-correct) at pixel
    centres; faces: (F, 3) vertices; shape: (H, W). The nearest triangle is seen, of equally near ones the first. With
    all depths 1 the picture is a map, without perspective.
    """
    value = np.ascontiguousarray(value, float)
    columns = value.reshape(len(value), -1)
    image, nearest = np.zeros((*shape, columns.shape[1])), np.full(shape, np.inf)
    _draw(
        np.ascontiguousarray(pixel, float),
        np.ascontiguousarray(depth, float),
        columns,
        np.ascontiguousarray(faces, np.int64),
        image,
        nearest,
    )
    return image.reshape(*shape, *value.shape[1:]), np.isfinite(nearest)
