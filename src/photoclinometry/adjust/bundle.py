"""Bundle adjustment: poses and points from keypoints and pose priors alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import Keypoints, ObservationTable
from photoclinometry.adjust.graph.priors import Exposure, PosePriors
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.solve.solver import SolverOptions, minimize
from photoclinometry.model.scene import Landmarks, Tracks, Views
from photoclinometry.model.sparse import SparseModel

LOSS = 3.0
"""Huber's loss of keypoints turns linear beyond so many standard deviations."""


def bundle_adjusted(sparse: SparseModel, views: Views, priors: PosePriors, sigma_px: float) -> SparseModel:
    """The model with poses and points of least squares.

    views: (K,) at the model's poses; priors: that determine the frame; sigma_px: standard deviation of keypoints.
    """
    points, tracks = len(sparse.points), tracks_of(sparse, sigma_px)
    landmarks = landmarks_of(sparse)
    keypoints = Keypoints(
        name="sparse",
        table=ObservationTable(tracks, len(views)),
        landmarks=np.ones(points, bool),
        sigma=tracks.keypoint_sigma,
        limit=LOSS,
    )
    held = Exposure(scale_sigma=np.ones(len(views)), bias_sigma=np.ones(len(views)))  # nothing else touches these
    start = Estimate(views, landmarks, np.median(sparse.points, axis=0))
    found = minimize(FactorGraph([keypoints, priors, held]), start, SolverOptions()).estimate
    moved = replace(sparse, body_from_cam=found.views.body_from_cam, points=found.landmarks.position)
    return replace(moved, mean_reprojection_px=float(np.mean(reprojection_px(moved, views))))


def tracks_of(sparse: SparseModel, sigma_px: float) -> Tracks:
    """The keypoints of the model's points, without brightness."""
    return Tracks.of_keypoints(sparse.point_start, sparse.point_view, sparse.point_xy, sigma_px)


def landmarks_of(sparse: SparseModel) -> Landmarks:
    """The model's points as landmarks; nothing is known of them but their positions."""
    count = len(sparse.points)
    return Landmarks(
        position=sparse.points,
        normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
        albedo=np.ones(count),
        pixel=np.zeros((count, 2), np.int32),
    )


def reprojection_px(sparse: SparseModel, views: Views) -> np.ndarray:
    """(M,) distances from the observed pixels to where the model's points project in its poses [px].

    views: (K,) of which only the cameras count.
    """
    distance = np.empty(len(sparse.point_view))
    points = sparse.points[sparse.point_of_observation]
    cam_from_body = sparse.body_from_cam.inverse()
    for k, camera in enumerate(views.cameras):
        own = sparse.point_view == k
        found = camera.pixel_from_cam(cam_from_body[k](points[own]))
        distance[own] = np.linalg.norm(found - sparse.point_xy[own], axis=-1)
    return distance
