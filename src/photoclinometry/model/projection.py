"""The pinhole projection of a scene's landmarks into its views (Eq. 10)."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from photoclinometry.model.scene import Scene


@njit(cache=True, fastmath={"contract", "reassoc", "nsz", "arcp"}, error_model="numpy")
def project_point(r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2):
    """1 / z, x / z and y / z in the camera's frame of an offset d in B from its centre; r: body_from_cam (Eq. 10)."""
    inverse = 1.0 / (r02 * d0 + r12 * d1 + r22 * d2)
    return inverse, (r00 * d0 + r10 * d1 + r20 * d2) * inverse, (r01 * d0 + r11 * d1 + r21 * d2) * inverse


def keypoint_residuals(scene: Scene) -> np.ndarray:
    """Predicted minus measured keypoints (N, 2) [px]."""
    out, pose = np.empty_like(scene.tracks.keypoint), scene.views.body_from_cam
    _project(
        scene.tracks.start, scene.tracks.view, scene.tracks.keypoint, np.ascontiguousarray(pose.rotation),
        np.ascontiguousarray(pose.translation), scene.views.intrinsics, scene.landmarks.position, out,
    )  # fmt: skip
    return out


def projected_keypoints(scene: Scene) -> np.ndarray:
    """Predicted keypoints (N, 2) [px]: where the observed landmarks project."""
    return scene.tracks.keypoint + keypoint_residuals(scene)


@njit(cache=True, parallel=True, error_model="numpy")
def _project(start, view, keypoint, rotation, center, intrinsics, position, out):
    """Pinhole projection (Eq. 10) minus keypoint, landmark by landmark."""
    for j in prange(start.size - 1):
        for n in range(start[j], start[j + 1]):
            k = view[n]
            d0, d1, d2 = position[j, 0] - center[k, 0], position[j, 1] - center[k, 1], position[j, 2] - center[k, 2]
            r = rotation[k]
            z = r[0, 2] * d0 + r[1, 2] * d1 + r[2, 2] * d2
            x = (r[0, 0] * d0 + r[1, 0] * d1 + r[2, 0] * d2) / z
            y = (r[0, 1] * d0 + r[1, 1] * d1 + r[2, 1] * d2) / z
            out[n, 0] = intrinsics[k, 0] * x + intrinsics[k, 2] - keypoint[n, 0]
            out[n, 1] = intrinsics[k, 1] * y + intrinsics[k, 3] - keypoint[n, 1]
