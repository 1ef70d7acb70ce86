"""The sparse tie points that structure from motion would find all over the images, on the place's tangent plane."""

from __future__ import annotations

import numpy as np

from photoclinometry.adjust import TiePoints
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.scene import Tracks, Views

LEAST_VIEWS = 3
"""Fewest views of a tie point: with two, a wrong match cannot be distinguished from a right one."""

_FARTHEST = 0.5
"""Distance of tie points from the place at most, in distances of the camera: beyond, the ground is no plane."""


def expected_tie_points(
    whole: Views, cut: Views, reference: int, count: int, sigma_px: float, relief: float, seed: int
) -> TiePoints | None:
    """Points evenly distributed at random over the reference image, seen by all views whose whole images contain them;
    None if there are none.

    whole, cut: the same views with whole images, and with the cut ones, in whose pixels keypoints are given; relief:
    standard deviation of the points' heights [m]. Keypoints have errors of sigma_px.
    """
    rng = np.random.default_rng([seed, 3])
    camera, pose = whole.cameras[reference], whole.body_from_cam[reference]
    pixel = rng.uniform(0.0, 1.0, (count, 2)) * (camera.width, camera.height)
    ray = camera.ray_in_cam(pixel) @ pose.rotation.T
    down = ray[:, 2] < 0.0
    distance = -pose.translation[2] / np.where(down, ray[:, 2], -1.0)
    point = pose.translation + ray * distance[:, None]
    point[:, 2] += relief * rng.standard_normal(count)
    near = np.linalg.norm(point, axis=1) < _FARTHEST * np.linalg.norm(pose.translation)
    point = point[down & near]
    seen = np.stack([_inside(whole, k, point) for k in range(len(whole))], 1).reshape(-1, len(whole))
    kept = seen.sum(1) >= LEAST_VIEWS
    point, seen = point[kept], seen[kept]
    if not len(point):
        return None
    landmark, view = np.nonzero(seen)
    keypoint = np.stack([cut.project(k, point) for k in range(len(cut))], 1)[landmark, view]
    keypoint = keypoint + sigma_px * rng.standard_normal(keypoint.shape)
    start = row_starts(seen.sum(1))
    return TiePoints(position=point, tracks=Tracks.of_keypoints(start, view.astype(np.int32), keypoint, sigma_px))


def _inside(views: Views, k: int, point: np.ndarray) -> np.ndarray:
    """(n,) bool: the points within the image."""
    camera, pixel = views.cameras[k], views.project(k, point)
    return np.all((pixel > 0.0) & (pixel < (camera.width, camera.height)), axis=1)
