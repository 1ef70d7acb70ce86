"""The pinhole projection (Eqs. 9, 10), stated once in NumPy and once compiled.

`pixel_from_cam` and `project` are the plain statements. `project_point` is the compiled one for a single point, which
the loops over observations call; a test compares the two.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit, prange

if TYPE_CHECKING:
    from photoclinometry.model.scene import Scene


def pixel_from_cam(points: np.ndarray, intrinsics: np.ndarray | tuple[float, ...]) -> np.ndarray:
    """Pixels (..., 2) of points (..., 3) of frame C: (fx x / z + cx, fy y / z + cy) (Eq. 10).

    intrinsics: (..., 4) fx, fy, cx, cy [px]. Points must lie before the camera (z > 0); others give the pixel of the
    line through the camera's centre, or infinity at z = 0.
    """
    intrinsics = np.asarray(intrinsics, float)
    return points[..., :2] / points[..., 2:] * intrinsics[..., :2] + intrinsics[..., 2:]


def project(
    rotation: np.ndarray, center: np.ndarray, intrinsics: np.ndarray | tuple[float, ...], position: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (..., 2) of points of B, and their derivatives by position (..., 2, 3) [px per unit of B].

    rotation: body_from_cam (..., 3, 3); center: camera centres (..., 3) in B; intrinsics: (..., 4) fx, fy, cx, cy
    [px]; position: (..., 3) in B, before the camera. The derivatives by the centre are those by position, negated.
    """
    in_cam = np.einsum("...ji,...j->...i", rotation, position - center)
    intrinsics = np.asarray(intrinsics, float)
    ratio, depth = in_cam[..., :2] / in_cam[..., 2:], in_cam[..., 2]
    rows = np.swapaxes(rotation, -1, -2)  # rows of cam_from_body: the camera's axes in B
    by_position = rows[..., :2, :] - ratio[..., None] * rows[..., 2:, :]
    by_position = by_position * (intrinsics[..., :2] / depth[..., None])[..., None]
    return pixel_from_cam(in_cam, intrinsics), by_position


@njit(cache=True, fastmath={"contract"}, error_model="numpy")
def project_point(r00, r01, r02, r10, r11, r12, r20, r21, r22, d0, d1, d2):
    """(1 / z, x / z, y / z) of a point in the camera's frame; the pixel is (fx x / z + cx, fy y / z + cy) (Eq. 10).

    r00 ... r22: body_from_cam rotation, row by row; d0, d1, d2: position minus camera centre, in B. The first number
    is positive where the point lies before the camera. Derivatives by position: of x / z,
    (r_i0 - x / z r_i2) / z for i = 0, 1, 2; of y / z, (r_i1 - y / z r_i2) / z.
    Scalars in and out, so that LLVM inlines it and vectorises the loops that call it.
    """
    inverse = 1.0 / (r02 * d0 + r12 * d1 + r22 * d2)
    return inverse, (r00 * d0 + r10 * d1 + r20 * d2) * inverse, (r01 * d0 + r11 * d1 + r21 * d2) * inverse


def keypoint_residuals(scene: Scene) -> np.ndarray:
    """Predicted minus measured keypoints (N, 2) [px]."""
    out, pose = np.empty_like(scene.tracks.keypoint), scene.views.body_from_cam
    _project_tracks(
        scene.tracks.start, scene.tracks.view, scene.tracks.keypoint, np.ascontiguousarray(pose.rotation),
        np.ascontiguousarray(pose.translation), scene.views.intrinsics, scene.landmarks.position, out,
    )  # fmt: skip
    return out


def projected_keypoints(scene: Scene) -> np.ndarray:
    """Predicted keypoints (N, 2) [px]: the projections of the observed landmarks."""
    return scene.tracks.keypoint + keypoint_residuals(scene)


@njit(cache=True, parallel=True, error_model="numpy")
def _project_tracks(start, view, keypoint, rotation, center, intrinsics, position, out):
    """Pinhole projection minus keypoint, landmark by landmark, into out (N, 2)."""
    for j in prange(start.size - 1):
        for n in range(start[j], start[j + 1]):
            k = view[n]
            r = rotation[k]
            _, x, y = project_point(
                r[0, 0], r[0, 1], r[0, 2], r[1, 0], r[1, 1], r[1, 2], r[2, 0], r[2, 1], r[2, 2],
                position[j, 0] - center[k, 0], position[j, 1] - center[k, 1], position[j, 2] - center[k, 2],
            )  # fmt: skip
            out[n, 0] = intrinsics[k, 0] * x + intrinsics[k, 2] - keypoint[n, 0]
            out[n, 1] = intrinsics[k, 1] * y + intrinsics[k, 3] - keypoint[n, 1]
