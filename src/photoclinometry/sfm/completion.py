"""Completion of a model by its poses: views with few matches are located, and matches that fit the poses are accepted.

The mapper uses pairs of views with many matches, which two-view geometry verifies. Where poses are known, they verify a
pair's matches, and few suffice.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.sparse import SparseModel, without_views
from photoclinometry.sfm.database import DescriptorMatches, padding_px, to_colmap, write_verified_matches
from photoclinometry.sfm.joining import AGREE_PX, FEWEST_OF_VIEW, locate_keypoints
from photoclinometry.sfm.known_poses import VerifiedMatches
from photoclinometry.sfm.options import SfmOptions

log = logging.getLogger(__name__)

FEWEST_OF_PAIR = 5
"""Fewest matches that must agree with the poses for a pair of views to count. A wrong match of two views lies within a
few pixels of its epipolar line once in fifty times, so that one in some tens of wrong ones agrees."""
FEWEST_TO_LOCATE = 10
"""Fewest matches with ground in three dimensions that give a view its pose. Three always agree; among hundreds of wrong
ones four more agree by chance."""


def complete_model(
    model: SparseModel, matches: DescriptorMatches, cameras: list[Camera], work_dir: Path, options: SfmOptions
) -> SparseModel:
    """The model after views were located, matches verified by its poses, and all were adjusted.

    matches: of all K views, whose verified ones in the database of work_dir are completed. Views that then see
    fewer points than a pair needs matches, or than FEWEST_OF_VIEW, are left out.
    """
    for gate in (AGREE_PX, options.max_reprojection_px):
        model = with_resected_views(model, matches, cameras, options)
        write_verified_matches(work_dir, epipolar_inliers(model, matches, cameras, gate))
        verified = VerifiedMatches(work_dir, replace(options, min_pair_matches=FEWEST_OF_PAIR))
        model = verified.adjusted(cameras, model.body_from_cam, model.registered, gate)
        seen = np.bincount(model.point_view, minlength=len(cameras))
        fewest = max(options.min_pair_matches, FEWEST_OF_VIEW)
        model = without_views(model, model.registered & (seen < fewest))
        log.info(
            "%d views, %d points, %.3f px mean reprojection error, of matches that fit the poses within %.2g px",
            model.registered.sum(), len(model.points), model.mean_reprojection_px, gate,
        )  # fmt: skip
    return model


def epipolar_inliers(
    model: SparseModel, matches: DescriptorMatches, cameras: Sequence[Camera], gate_px: float
) -> dict[tuple[int, int], np.ndarray]:
    """By registered views (a, b), the matches (m, 2) that lie within `gate_px` of their epipolar lines."""
    found = {}
    for (a, b), index in matches.pairs.items():
        if model.registered[a] and model.registered[b]:
            pose = model.body_from_cam
            off = epipolar_px(
                pose[a], cameras[a], matches.keypoints[a][index[:, 0]],
                pose[b], cameras[b], matches.keypoints[b][index[:, 1]],
            )  # fmt: skip
            if np.count_nonzero(off <= gate_px) >= FEWEST_OF_PAIR:
                found[a, b] = index[off <= gate_px]
    return found


def epipolar_px(
    first: Rigid,
    first_camera: Camera,
    first_xy: np.ndarray,
    second: Rigid,
    second_camera: Camera,
    second_xy: np.ndarray,
) -> np.ndarray:
    """(m,) the greater distance of two matching pixels (m, 2) from each other's epipolar line [px].

    first, second: body_from_cam. Hartley and Zisserman (2004), Multiple View Geometry, 9.2.
    """
    rays = [
        unit(camera.ray_in_cam(xy)) @ pose.rotation.T
        for pose, camera, xy in ((first, first_camera, first_xy), (second, second_camera, second_xy))
    ]
    between = unit(second.translation - first.translation)
    off = []
    for ray, other, camera in ((rays[0], rays[1], first_camera), (rays[1], rays[0], second_camera)):
        normal = unit(np.cross(other, between))
        off.append(np.arcsin(np.clip(np.abs(np.sum(ray * normal, -1)), 0.0, 1.0)) * np.mean(camera.focal_px))
    return np.maximum(*off)


def with_resected_views(
    model: SparseModel, matches: DescriptorMatches, cameras: Sequence[Camera], options: SfmOptions
) -> SparseModel:
    """The model with poses of further views, by their matches with ground whose depth it knows."""
    ground = locate_keypoints(model, matches, cameras).points
    registered, rotation, center = (
        each.copy() for each in (model.registered, model.body_from_cam.rotation, model.body_from_cam.translation)
    )
    for k in np.flatnonzero(~model.registered).tolist():
        pixels, points = [np.empty((0, 2))], [np.empty((0, 3))]
        for one, other, index in matches.both_ways():
            if one == k and other in ground:
                point = ground[other][index[:, 1]]
                known = np.isfinite(point[:, 0])
                pixels.append(matches.keypoints[k][index[known, 0]])
                points.append(point[known])
        pose = _pose(cameras[k], np.concatenate(pixels), np.concatenate(points), options)
        if pose is not None:
            registered[k], rotation[k], center[k] = True, pose.rotation.matrix(), pose.translation
    log.info("%d more views located", np.count_nonzero(registered & ~model.registered))
    return replace(model, registered=registered, body_from_cam=Rigid(rotation, center))


def _pose(camera: Camera, pixels: np.ndarray, points: np.ndarray, options: SfmOptions) -> Any | None:
    """body_from_cam, as a pycolmap Rigid3d, of a view that sees points (n, 3) at pixels (n, 2), some of them wrong."""
    import pycolmap

    if len(points) < FEWEST_TO_LOCATE:
        return None
    estimation = pycolmap.AbsolutePoseEstimationOptions()
    estimation.ransac.max_error = AGREE_PX
    estimation.ransac.random_seed = options.seed
    estimation.ransac.min_inlier_ratio = FEWEST_TO_LOCATE / len(points)
    padded = pixels + padding_px(camera)
    found = pycolmap.estimate_and_refine_absolute_pose(padded, points, to_colmap(camera), estimation)
    if found is None or found["num_inliers"] < FEWEST_TO_LOCATE:
        return None
    return found["cam_from_world"].inverse()
