"""Maps of given heights, with independent errors, and places on them to measure between."""

from dataclasses import replace

import numpy as np

from photoclinometry.model.error_correlation import ErrorCorrelation
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.surface.relief import local_frame
from scenes import synthetic_scene

SIZE = 21
INDEPENDENT = ErrorCorrelation(length_px=np.ones(1), share=np.zeros(1))


def map_of_heights(height, spacing=2.0, sigma=0.01, frame=BODY_FIXED):
    """A map of SIZE x SIZE landmarks, `spacing` apart, of heights over their mean plane (SIZE, SIZE); independent
    errors of one sigma along each axis."""
    scene = synthetic_scene(size=SIZE, views=3)
    row, col = scene.cells
    towards = local_frame(scene)
    local = np.stack([spacing * col, -spacing * row, height[row, col]], -1)
    position = towards(local - local.mean(0))
    covariance = np.tile(sigma**2 * np.eye(3), (len(position), 1, 1))
    return replace(
        scene,
        landmarks=replace(scene.landmarks, position=position),
        uncertainty={"position": covariance},
        error_correlation=INDEPENDENT,
        frame=frame,
    )


def flat(value=0.0):
    """(SIZE, SIZE) heights of level ground."""
    return np.full((SIZE, SIZE), value)


def pixel_of(scene, row, col):
    """(x, y) of the middle of a cell."""
    return scene.region.col + col + 0.5, scene.region.row + row + 0.5


def outline_of(scene, low, high):
    """A square around the cells from low to high, both included."""
    (x0, y0), (x1, y1) = pixel_of(scene, low, low), pixel_of(scene, high, high)
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) + 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
