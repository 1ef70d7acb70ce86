"""The surface as known so far, as depth at every reference pixel, and what it predicts for other views."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.geometry import Rigid
from photoclinometry.model.scene import Camera, Region


def predict_pixels(
    depth: np.ndarray,
    region: Region,
    reference_camera: Camera,
    reference_pose: Rigid,
    target_camera: Camera,
    target_pose: Rigid,
) -> np.ndarray:
    """(h, w, 2) target pixels of a region's pixel centres at depth (h, w); poses are body_from_cam.

    NaN where the point lies behind the target camera.
    """
    rays = reference_camera.ray_in_cam(region.pixel_centers())
    local = (target_pose.inverse() @ reference_pose)(rays * depth[..., None])
    local[local[..., 2] <= 0] = np.nan
    return target_camera.pixel_from_cam(local)
