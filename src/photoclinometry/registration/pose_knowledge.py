"""The information of keypoints on the poses of a map's views, and the disagreement of each pose prior with all else.

In a narrow field of view a shift of the camera across its line of sight has nearly the same effect on the image as a
turn, and a shift along it nearly the same as another size of the map. Images alone then determine neither a camera's
place nor its attitude well, but a combination of both. Compared with its own sigmas alone, a sound prior looks wrong by
tens of sigmas.
"""

from __future__ import annotations

import math

import numpy as np

from photoclinometry.model.geometry import skew
from photoclinometry.model.projection import project
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views

POSE = 6
"""Numbers of a pose: rotation vector [rad] and centre, along the axes of B."""
SHARED_PX = 12
"""Side of the squares of the reference image of which one landmark each counts [px]: nearer ones share the errors of
matches. These errors reach 24 px and more in large images; in windows of 24 px, small maps have too few landmarks to
detect a shift of a camera along its line of sight."""
MOST_LANDMARKS = 1000
"""Squares are larger where there would be more landmarks: poses are known well enough by then."""
UNTOLD = 1e-6
"""A direction in which the pose without its prior has more than 1 / sqrt(UNTOLD) times the prior's sigma does not test
the prior."""
_RIDGE = 1e-13
"""Share of each number's own information that is added to keep undetermined views invertible."""


def pose_information(scene: Scene) -> np.ndarray:
    """(6 K, 6 K) information of keypoints about the poses of the K views, per view as POSE, in the scene's own frame.

    The landmarks are unknown, too: they are eliminated (Schur complement; Triggs et al. 2000, Bundle adjustment - a
    modern synthesis, section 6.1). The frame itself is not determined: seven directions have none.
    """
    count = len(scene.views)
    chosen = _apart(scene.landmarks, scene.tracks)
    tracks, _ = scene.tracks.of_landmarks(chosen)
    by_point, by_pose = _derivatives(tracks, scene.landmarks.position[chosen], scene.views)
    information = np.zeros((count, POSE, count, POSE))
    for first, end in zip(tracks.start, tracks.start[1:], strict=False):
        views, seen = tracks.view[first:end], end - first
        held = np.linalg.qr(by_point[first:end].reshape(-1, 3))[0]
        whole = np.zeros((seen, 2, seen, POSE))
        whole[range(seen), :, range(seen)] = by_pose[first:end]
        whole = whole.reshape(2 * seen, -1)
        free = whole - held @ (held.T @ whole)
        information[views[:, None], :, views] += np.moveaxis((free.T @ free).reshape(seen, POSE, seen, POSE), 2, 1)
    return information.reshape(POSE * count, -1)


def disagreement(
    information: np.ndarray, offset: np.ndarray, sigma: np.ndarray, view: np.ndarray, used: np.ndarray
) -> np.ndarray:
    """(n,) difference of each prior from the pose by the images and the other priors, in standard deviations.

    It is the root mean square over POSE, without the prior's own influence (leave one out; Cook & Weisberg 1982,
    Residuals and influence in regression, section 2.2). With the images' information H and that of the priors P, all
    poses x solve (H + P) x = P p, with covariance C. The residual p_k - x_k of a prior of covariance S_k has the
    covariance S_k - C_k if it takes part, S_k + C_k if not.

    information: of `pose_information`. offset, sigma: (n, 6) of the priors from the scene's poses, in its frame. view:
    (n,) their views. used: (n,) bool, those that take part.
    """
    count = len(information) // POSE
    at = POSE * view[:, None] + np.arange(POSE)
    weight, told = np.zeros(POSE * count), np.zeros(POSE * count)
    weight[at[used]] = sigma[used] ** -2.0
    told[at] = offset
    whole = information + np.diag(weight)
    size = np.sqrt(np.where(np.diag(whole) > 0, np.diag(whole), 1.0))
    covariance = np.linalg.inv(whole / np.outer(size, size) + _RIDGE * np.eye(len(whole))) / np.outer(size, size)
    found = covariance @ (weight * told)
    off = (told - found)[at] / sigma
    own = covariance[at[:, :, None], at[:, None, :]] / (sigma[:, :, None] * sigma[:, None, :])
    spread, axes = np.linalg.eigh(np.eye(POSE) - np.where(used, 1.0, -1.0)[:, None, None] * own)
    along = np.einsum("nij,ni->nj", axes, off)
    squares = np.where(spread > UNTOLD, along**2 / np.maximum(spread, UNTOLD), 0.0)
    return np.sqrt(squares.sum(-1) / POSE)


def _apart(landmarks: Landmarks, tracks: Tracks) -> np.ndarray:
    """(j,) indices of landmarks whose matches have independent errors: in each square the one that most views see."""
    extent = np.ptp(landmarks.pixel, axis=0) + 1
    side = max(SHARED_PX, math.ceil(math.sqrt(float(np.prod(extent, dtype=float)) / MOST_LANDMARKS)))
    square = landmarks.pixel // side
    order = np.lexsort((-np.diff(tracks.start), square[:, 1], square[:, 0]))
    first = np.ones(len(order), bool)
    first[1:] = np.any(np.diff(square[order], axis=0) != 0, axis=1)
    return order[first]


def _derivatives(tracks: Tracks, position: np.ndarray, views: Views) -> tuple[np.ndarray, np.ndarray]:
    """Of keypoints in sigmas: (N, 2, 3) by positions, and (N, 2, 6) by poses, as exp(w) R and c.

    position: (j, 3) of the tracks' landmarks.
    """
    pose, point = views.body_from_cam[tracks.view], position[tracks.landmark]
    _, by_point = project(pose.rotation, pose.translation, views.intrinsics[tracks.view], point)
    by_point = by_point / tracks.keypoint_sigma[:, None, None]
    return by_point, np.concatenate([by_point @ skew(point - pose.translation), -by_point], axis=-1)
