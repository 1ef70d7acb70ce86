"""A start of the joint estimate at the pose priors themselves, where these are far better than poses from images alone.

Steps of the estimate are short, a landmark's half a ground sample. Where the cameras have to move by many sigmas, the
whole map has to follow, further than that takes it in reasonable time.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from photoclinometry.adjust import PosePriors
from photoclinometry.align import camera_distance, transform_poses
from photoclinometry.densify import triangulate_tracks
from photoclinometry.geometry import Rigid, align_similarity, unit
from photoclinometry.georeference import MIN_PRIORS, OUTLIER
from photoclinometry.scene import Scene, Tracks, Views

log = logging.getLogger(__name__)


def start_at_priors(scene: Scene, known: PosePriors) -> tuple[Scene, np.ndarray]:
    """The scene with its views at their priors and its map where these see it; (K,) bool, whose priors that is made of.

    The map keeps its shape but for an affine motion, so that no landmark strays; the other views move along
    with it. A prior is left out by which its view sees the map further off than OUTLIER times what its sigmas explain.
    """
    used = np.isfinite(known.center_sigma)
    explained = _explained_px(scene, known)
    while True:
        views = replace(scene.views, body_from_cam=_chosen(used, known.body_from_cam, scene.views.body_from_cam))
        found = triangulate_tracks(_of_views(scene.tracks, used), views)
        misfit = np.where(used, _misfit_px(scene, views, found) / explained, 0.0)
        worst = int(np.argmax(misfit))
        if misfit[worst] <= OUTLIER or used.sum() <= MIN_PRIORS:
            break
        used = used & (np.arange(len(used)) != worst)
    position, normal = _follow(scene.landmarks.position, scene.landmarks.normal, found)
    along = transform_poses(align_similarity(scene.landmarks.position, position), views.body_from_cam)
    poses = _chosen(used, views.body_from_cam, along)
    turn = poses.rotation @ np.swapaxes(scene.views.body_from_cam.rotation, -1, -2)
    views = replace(views, body_from_cam=poses, sun=np.einsum("kij,kj->ki", turn, scene.views.sun))
    return scene.with_estimate(views, replace(scene.landmarks, position=position, normal=normal)), used


def _chosen(used: np.ndarray, yes: Rigid, no: Rigid) -> Rigid:
    """Of two poses for each view (K,) the first where `used`."""
    rotation = np.where(used[:, None, None], yes.rotation, no.rotation)
    return Rigid(rotation, np.where(used[:, None], yes.translation, no.translation))


def _explained_px(scene: Scene, known: PosePriors) -> np.ndarray:
    """(K,) how far off a view sees the map by one sigma of its prior and as much of the others', and a pixel."""
    angle = np.hypot(known.rotation_sigma, known.center_sigma / camera_distance(scene))
    return 1.0 + 2.0 * scene.views.intrinsics[:, 0] * angle


def _misfit_px(scene: Scene, views: Views, position: np.ndarray) -> np.ndarray:
    """(K,) median distance of the keypoints of views from where they see positions (J, 3), NaN where there is none."""
    tracks, misfit = scene.tracks, np.zeros(len(views))
    for k in range(len(views)):
        seen = (tracks.view == k) & np.isfinite(position[tracks.landmark, 0])
        if seen.any():
            offset = views.project(k, position[tracks.landmark[seen]]) - tracks.keypoint[seen]
            misfit[k] = np.median(np.linalg.norm(offset, axis=-1))
    return misfit


def _of_views(tracks: Tracks, used: np.ndarray) -> Tracks:
    """What some views (K,) bool observe, of all landmarks."""
    kept = used[tracks.view]
    count = np.bincount(tracks.landmark[kept], minlength=len(tracks.start) - 1)
    fields = ("view", "keypoint", "keypoint_sigma", "brightness", "lit")
    start = np.concatenate([[0], np.cumsum(count)])
    return Tracks(start=start, **{name: getattr(tracks, name)[kept] for name in fields})


def _follow(position: np.ndarray, normal: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals (J, 3) after the affine motion that brings most to their targets (J, 3), NaN for none."""
    known = np.isfinite(target[:, 0])
    offset = position - position.mean(0)
    rows = np.column_stack([offset, np.ones(len(offset))])
    for _ in range(3):
        motion = np.linalg.lstsq(rows[known], target[known], rcond=None)[0]
        distance = np.linalg.norm(rows @ motion - target, axis=-1)
        known = np.isfinite(target[:, 0]) & (distance <= 3.0 * np.nanmedian(distance))
    return rows @ motion, unit(normal @ np.linalg.inv(motion[:3].T))
