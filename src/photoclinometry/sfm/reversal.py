"""The model that is left when depth and rotations are reversed, and which of the two the images show.

Under parallel projection a shape seen from some directions looks like its mirror image in depth, seen from the opposite
directions (Necker's reversal; Hartley and Zisserman 2004, Multiple View Geometry, 14.8). Rays of a narrow-angle camera
are nearly parallel. Two views then hardly tell the two apart, structure from motion begins with two, and bundle
adjustment does not lead from one to the other. All views together do tell.
"""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from photoclinometry.model.warning import warn

log = logging.getLogger(__name__)

ALIKE = 1.02
"""Ratio of the two mean reprojection errors below which the images do not tell. That of right models over reversed ones
is 0.36 to 0.6 on simulated sites with a field of view of 2 degrees."""


def right_way_round(model: Any, adjust: Callable[[Any], None]) -> Any:
    """The pycolmap reconstruction, or its reverse where that explains the keypoints better; both adjusted.

    adjust: bundle adjustment of a reconstruction, in place. Warns where both explain them alike.
    """
    if not model.num_points3D():
        return model
    other = reversed_model(model)
    for each in (model, other):
        adjust(each)
    error, reverse = (each.compute_mean_reprojection_error() for each in (model, other))
    log.info("mean reprojection error %.3f px, with depth and rotations reversed %.3f px", error, reverse)
    if max(error, reverse) < ALIKE * min(error, reverse):
        warn(
            log, "reversal-undecided",
            "rays are so nearly parallel that the relief may be reversed, hills for hollows: keypoints are explained "
            "to %.3f px, and to %.3f px the other way round. Add images from other directions, or pose priors",
            error, reverse,
        )  # fmt: skip
    return other if reverse < error else model


def reversed_model(model: Any) -> Any:
    """A copy of a pycolmap reconstruction with all points mirrored in depth, and cameras that see them alike.

    With D = diag(1, 1, -1) and m the middle of the points, X becomes m + D (X - m), and cam_from_world [R | t] becomes
    [D R D | R m + t - D R D m]: in each camera the depth from the middle changes its sign, and nothing else does.
    """
    import pycolmap

    found = copy.deepcopy(model)
    depth = np.diag([1.0, 1.0, -1.0])
    points = [found.points3D[number] for number in found.point3D_ids()]
    middle = np.mean([point.xyz for point in points], axis=0)
    for point in points:
        point.xyz = middle + depth @ (point.xyz - middle)
    for image_id in found.reg_image_ids():
        frame = found.frames[found.images[image_id].frame_id]
        pose = frame.rig_from_world
        rotation = pose.rotation.matrix()
        turned = depth @ rotation @ depth
        translation = rotation @ middle + pose.translation - turned @ middle
        frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(turned), translation)
    found.update_point_3d_errors()
    return found
