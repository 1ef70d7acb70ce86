"""The epipolar geometry of two posed pinhole cameras.

Hartley and Zisserman (2004), Multiple View Geometry, chapters 9 and 11.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, skew
from photoclinometry.model.tiny import TINY


def fundamental_matrix(camera_a: Camera, pose_a: Rigid, camera_b: Camera, pose_b: Rigid) -> np.ndarray:
    """F (3, 3) with (x_b, 1) F (x_a, 1)^T = 0 for pixels of one point; poses are body_from_cam."""
    b_from_a = pose_b.inverse() @ pose_a
    essential = skew(b_from_a.translation) @ b_from_a.rotation
    return _ray_from_pixel(camera_b).T @ essential @ _ray_from_pixel(camera_a)


def sampson_error(fundamental: np.ndarray, xy_a: np.ndarray, xy_b: np.ndarray) -> np.ndarray:
    """Squared Sampson distance [px^2] of pixels (..., 2) of a and b to the epipolar geometry.

    (x_b F x_a)^2 / ((F x_a)_1^2 + (F x_a)_2^2 + (F^T x_b)_1^2 + (F^T x_b)_2^2)   (Hartley and Zisserman 11.9)

    Zero at the epipoles, where no line is defined.
    """
    one = np.ones_like(xy_a[..., :1])
    a, b = np.concatenate([xy_a, one], -1), np.concatenate([xy_b, one], -1)
    line_b, line_a = a @ fundamental.T, b @ fundamental
    squares = (line_b[..., :2] ** 2).sum(-1) + (line_a[..., :2] ** 2).sum(-1)
    return np.sum(b * line_b, -1) ** 2 / np.maximum(squares, TINY)


def _ray_from_pixel(camera: Camera) -> np.ndarray:
    """(3, 3) the inverse of the calibration matrix."""
    fx, fy, cx, cy = camera.intrinsics
    return np.array([[1 / fx, 0, -cx / fx], [0, 1 / fy, -cy / fy], [0, 0, 1]])
