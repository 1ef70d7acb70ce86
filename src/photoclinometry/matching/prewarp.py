"""The pre-warp: expected positions of the reference's pixels in another view, from the depth known so far."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.region import Region


def predict_pixels(
    depth: np.ndarray,
    region: Region,
    reference_camera: Camera,
    reference_pose: Rigid,
    target_camera: Camera,
    target_pose: Rigid,
) -> np.ndarray:
    """(h, w, 2) pixels of the target where a region's pixel centres project, at depth (h, w); poses are body_from_cam.

    depth: along the reference camera's optical axis, in units of B. NaN where the point lies behind the target camera.
    """
    rays = reference_camera.ray_in_cam(region.pixel_centers())
    local = (target_pose.inverse() @ reference_pose)(rays * depth[..., None])
    local[local[..., 2] <= 0] = np.nan
    return target_camera.pixel_from_cam(local)
