"""Bundle adjustment: poses and points from keypoints and pose priors alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photoclinometry.adjust.covariance.linearized_graph import linearized_graph
from photoclinometry.adjust.covariance.marginals import marginals
from photoclinometry.adjust.graph.general import FactorGroup
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import Keypoints, ObservationTable
from photoclinometry.adjust.graph.priors import Exposure, LandmarkPriors, PosePriors, pose_along_axes
from photoclinometry.adjust.graph.variables import VIEW_SIZE, Estimate
from photoclinometry.adjust.solve.solver import SolverOptions, minimize
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.robust import HUBER_LIMIT
from photoclinometry.model.scene import Landmarks, Tracks, Views
from photoclinometry.model.sparse import SparseModel

TO_THE_MINIMUM = SolverOptions(relative_decrease=1e-9, absolute_decrease=1e-3, settled=0.0, final_truncation=1e-6)
"""Poses are to be right to a small part of their covariances, and steps are cheap here."""


def bundle_adjusted(sparse: SparseModel, views: Views, priors: PosePriors, sigma_px: float | np.ndarray) -> SparseModel:
    """The model with poses and points of least squares.

    views: (K,) at the model's poses; priors: that determine the frame; sigma_px: standard deviation of keypoints, or
    one (N,) of each.
    """
    problem = _problem(sparse.points, tracks_of(sparse, sigma_px), views, priors)
    found = minimize(*problem, TO_THE_MINIMUM).estimate
    moved = replace(sparse, body_from_cam=found.views.body_from_cam, points=found.landmarks.position)
    return replace(moved, mean_reprojection_px=float(np.mean(reprojection_px(moved, views))))


def pose_covariances(sparse: SparseModel, views: Views, priors: PosePriors, sigma_px: float | np.ndarray) -> np.ndarray:
    """(K, 6, 6) covariances of a bundle adjustment's poses, as of `KnownPoses`. Given as for `bundle_adjusted`, but the
    model is the adjusted one."""
    graph, estimate = _problem(sparse.points, tracks_of(sparse, sigma_px), views, priors)
    count = len(views)
    whole = marginals(linearized_graph(graph, estimate)).views.reshape(count, VIEW_SIZE, count, VIEW_SIZE)
    local = whole[range(count), :6, range(count), :6]
    pose = views.body_from_cam
    by_local = pose_along_axes(np.swapaxes(pose.rotation, -1, -2), pose.translation - estimate.pivot)
    return by_local @ local @ np.swapaxes(by_local, -1, -2)


def resected(
    points: np.ndarray, point_sigma: float, keypoint: np.ndarray, sigma_px: float, views: Views, priors: PosePriors
) -> Rigid:
    """(1,) the pose of one view that sees known points (n, 3) at pixels (n, 2), and has a prior.

    point_sigma: of the points, in units of B, along each axis; sigma_px: of the pixels; views: (1,) at the start.
    """
    count = len(points)
    tracks = Tracks.of_keypoints(np.arange(count + 1), np.zeros(count, np.int32), keypoint, sigma_px)
    free = np.full(count, np.inf)
    known = LandmarkPriors(
        landmarks=_landmarks_at(points),
        position_sigma=np.full(count, point_sigma),
        normal_sigma=free,
        albedo_sigma=free,
    )
    return minimize(*_problem(points, tracks, views, known, priors), TO_THE_MINIMUM).estimate.views.body_from_cam


def _problem(points: np.ndarray, tracks: Tracks, views: Views, *known: FactorGroup) -> tuple[FactorGraph, Estimate]:
    """The factors of a bundle adjustment, and its start: keypoints of points (P, 3), and other knowledge."""
    keypoints = Keypoints(
        name="sparse",
        table=ObservationTable(tracks, len(views)),
        landmarks=np.ones(len(points), bool),
        sigma=tracks.keypoint_sigma,
        limit=HUBER_LIMIT,
    )
    held = Exposure(scale_sigma=np.ones(len(views)), bias_sigma=np.ones(len(views)))  # nothing else touches these
    start = Estimate(views, _landmarks_at(points), np.median(points, axis=0))
    return FactorGraph([keypoints, *known, held]), start


def tracks_of(sparse: SparseModel, sigma_px: float | np.ndarray) -> Tracks:
    """The keypoints of the model's points, without brightness."""
    return Tracks.of_keypoints(sparse.point_start, sparse.point_view, sparse.point_xy, sigma_px)


def landmarks_of(sparse: SparseModel) -> Landmarks:
    """The model's points as landmarks; nothing is known of them but their positions."""
    return _landmarks_at(sparse.points)


def _landmarks_at(points: np.ndarray) -> Landmarks:
    count = len(points)
    return Landmarks(
        position=points,
        normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
        albedo=np.ones(count),
        pixel=np.zeros((count, 2), np.int32),
    )


def reprojection_px(sparse: SparseModel, views: Views) -> np.ndarray:
    """(M,) distances from the observed pixels to the projections of the model's points by its poses [px].

    views: (K,); only their cameras are used.
    """
    distance = np.empty(len(sparse.point_view))
    points = sparse.points[sparse.point_of_observation]
    cam_from_body = sparse.body_from_cam.inverse()
    for k, camera in enumerate(views.cameras):
        own = sparse.point_view == k
        found = camera.pixel_from_cam(cam_from_body[k](points[own]))
        distance[own] = np.linalg.norm(found - sparse.point_xy[own], axis=-1)
    return distance
