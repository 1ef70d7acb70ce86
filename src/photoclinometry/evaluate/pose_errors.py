"""Errors of camera poses, and of the frame that they define."""

from __future__ import annotations

import numpy as np

from photoclinometry.evaluate.metrics import spread
from photoclinometry.model.geometry import Rigid, Similarity, angle_between, so3_log
from photoclinometry.registration.alignment import transform_poses


def frame_metrics(true_from_found: Similarity, position: np.ndarray, true: np.ndarray) -> dict[str, float]:
    """Errors of the frame of a body-fixed scene: attitude and scale by its cameras, origin by its landmarks.

    position, true: (J, 3) landmarks without alignment, and the truth, NaN where there is none.
    """
    return {
        "frame_offset_m": float(np.linalg.norm(np.nanmedian(position - true, axis=0))),
        "frame_turn_deg": float(np.degrees(np.linalg.norm(so3_log(true_from_found.rotation)))),
        "frame_scale_error_percent": 100.0 * (1.0 / true_from_found.scale - 1.0),
    }


def pose_metrics(found: Rigid, true: Rigid, true_from_found: Similarity, unit: str) -> dict[str, float]:
    """Errors of paired poses (K,): centres and pointing after alignment, relative rotations without any.

    Pointing is the angle between camera axes. A relative rotation is that between two cameras; its error does
    not depend on the alignment.
    """
    moved = transform_poses(true_from_found, found)
    offset = np.linalg.norm(moved.translation - true.translation, axis=-1)
    pointing = angle_between(moved.rotation[..., 2], true.rotation[..., 2])
    angle = relative_rotation_errors(found, true)
    return {
        **spread(offset, "camera_position_error", unit),
        **spread(np.degrees(pointing), "camera_pointing_error", "deg"),
        **spread(angle, "camera_relative_rotation_error", "deg"),
        "camera_relative_rotation_error_max_deg": float(angle.max()),
    }


def relative_rotation_errors(found: Rigid, true: Rigid) -> np.ndarray:
    """(K (K - 1) / 2,) errors of the rotations between two cameras of paired poses (K,) [degrees], of every pair."""
    i, j = np.triu_indices(len(found), 1)

    def relative(poses: Rigid) -> np.ndarray:
        return np.einsum("kji,kjl->kil", poses.rotation[i], poses.rotation[j])

    error = so3_log(np.einsum("kji,kjl->kil", relative(found), relative(true)))
    return np.degrees(np.linalg.norm(error, axis=-1))
