"""The sparse model: poses of the views and points with tracks, in a well-scaled gauge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.compressed_rows import row_of_entry, row_starts
from photoclinometry.model.geometry import Rigid, Similarity, unit


@dataclass(frozen=True, kw_only=True)
class SparseModel:
    """Poses of K views and P points, with the tracks (compressed rows) that connect them.

    The world frame is B in the gauge of `normalised`: origin in the middle of the points, z towards the
    cameras, unit of length one ground sample distance.
    """

    registered: np.ndarray
    """(K,) bool."""
    body_from_cam: Rigid
    """(K,) poses; where not registered the identity, or that of a pose prior adjusted by few points."""
    points: np.ndarray
    """(P, 3) in B."""
    point_start: np.ndarray
    """(P + 1,) int64: observations of point p are point_start[p]:point_start[p + 1]."""
    point_view: np.ndarray
    """(M,) int32 index of the view that observed: a registered one, or one at its adjusted pose prior."""
    point_xy: np.ndarray
    """(M, 2) observed pixel."""
    mean_reprojection_px: float
    reason: np.ndarray = field(default_factory=lambda: np.array([], str))
    """(K,) str: why a view is not registered, empty for those that are; (0,) where no reasons were recorded."""
    brought_in: np.ndarray = field(default_factory=lambda: np.array([], str))
    """(K,) str: the additional matches of a view that brightness alone does not register, empty for the others; (0,)
    where this was not recorded."""

    @property
    def point_of_observation(self) -> np.ndarray:
        """(M,) int64: the point of each observation."""
        return row_of_entry(self.point_start)

    def why_unregistered(self) -> dict[int, str]:
        """The reason for each view that is not registered."""
        reason = self.reason if len(self.reason) else np.full(len(self.registered), "not registered")
        return {int(k): str(reason[k]) for k in np.flatnonzero(~self.registered)}

    def how_brought_in(self) -> dict[int, str]:
        """`brought_in` of each registered view that has one."""
        how = self.brought_in if len(self.brought_in) else np.full(len(self.registered), "")
        return {int(k): str(how[k]) for k in np.flatnonzero(self.registered & (how != ""))}

    @property
    def towards_views(self) -> np.ndarray:
        """(P, 3) unit vectors from the points towards the middle of the views that observe them."""
        point, towards = self.point_of_observation, np.zeros_like(self.points)
        np.add.at(towards, point, unit(self.body_from_cam.translation[self.point_view] - self.points[point]))
        return unit(towards)

    def seen_by(self, view: int) -> tuple[np.ndarray, np.ndarray]:
        """Indices (n,) of the points that a view observes, and the observed pixels (n, 2)."""
        own = self.point_view == view
        return self.point_of_observation[own], self.point_xy[own]


def without_views(sparse: SparseModel, views: np.ndarray) -> SparseModel:
    """The model without the observations of some views (K,) bool; they count as not registered.

    Poses stay. Points that fewer than two other views observe are dropped.
    """
    point = sparse.point_of_observation
    keep = ~views[sparse.point_view]
    count = np.bincount(point[keep], minlength=len(sparse.points))
    keep &= count[point] >= 2
    kept = count >= 2
    return replace(
        sparse,
        registered=sparse.registered & ~views,
        points=sparse.points[kept],
        point_start=row_starts(count[kept]),
        point_view=sparse.point_view[keep],
        point_xy=sparse.point_xy[keep],
    )


def of_views(sparse: SparseModel, views: np.ndarray) -> SparseModel:
    """The model of some views (n,) int alone, in that order; points that fewer than two of them observe are dropped."""
    others = np.ones(len(sparse.registered), bool)
    others[views] = False
    kept = without_views(sparse, others)
    number = np.full(len(others), -1, kept.point_view.dtype)
    number[views] = np.arange(len(views))
    return replace(
        kept,
        registered=sparse.registered[views],
        body_from_cam=sparse.body_from_cam[views],
        point_view=number[kept.point_view],
        reason=sparse.reason[views] if len(sparse.reason) else sparse.reason,
        brought_in=sparse.brought_in[views] if len(sparse.brought_in) else sparse.brought_in,
    )


def among_more_views(sparse: SparseModel, used: np.ndarray, reasons: Sequence[str]) -> SparseModel:
    """The model of the views `used` (K,) bool, as one of all K views; the others count as not registered.

    reasons: (K,) why a view was not used, empty for those that were.
    """
    if used.all():
        return sparse
    rows = np.flatnonzero(used)
    registered = np.zeros(len(used), bool)
    registered[rows] = sparse.registered
    rotation, translation = np.tile(np.eye(3), (len(used), 1, 1)), np.zeros((len(used), 3))
    rotation[rows], translation[rows] = sparse.body_from_cam.rotation, sparse.body_from_cam.translation
    reason, brought_in = np.array(reasons, object), np.full(len(used), "", object)
    for all_views, own in ((reason, sparse.reason), (brought_in, sparse.brought_in)):
        if len(own):
            all_views[rows] = own
    return replace(
        sparse,
        registered=registered,
        body_from_cam=Rigid(rotation, translation),
        point_view=rows[sparse.point_view].astype(sparse.point_view.dtype),
        reason=reason.astype(str),
        brought_in=brought_in.astype(str),
    )


def normalised(sparse: SparseModel, cameras: list[Camera]) -> SparseModel:
    """The same model in a well-scaled gauge.

    Origin: the median point. z: from there towards the mean camera centre; x: the first registered view's
    image x axis, made orthogonal. Unit: the median over observations of depth / focal length, so that one
    pixel covers about one unit of length, and lengths in B are ground sample distances. Structure from motion leaves
    these seven parameters open. In this gauge the coordinates of a site span a few hundred, steps of the estimate are
    of the order of 0.1, and tolerances have the same meaning on every body.
    """
    view, depth = sparse.point_view, _observation_depth(sparse)
    focal = np.array([np.mean(camera.focal_px) for camera in cameras])
    gsd = float(np.median(depth / focal[view]))
    origin = np.median(sparse.points, axis=0)
    poses = sparse.body_from_cam
    z = unit(poses.translation[sparse.registered].mean(0) - origin)
    first = poses.rotation[np.flatnonzero(sparse.registered)[0]][:, 0]
    x = unit(first - (first @ z) * z)
    rotation = np.stack([x, np.cross(z, x), z])
    return transformed(sparse, Similarity(1.0 / gsd, rotation, -rotation @ origin / gsd))


def transformed(sparse: SparseModel, new_from_old: Similarity) -> SparseModel:
    """The model with its world frame moved, turned and scaled; observed pixels do not change."""
    keep = sparse.registered
    rotation, translation = sparse.body_from_cam.rotation.copy(), sparse.body_from_cam.translation.copy()
    rotation[keep] = new_from_old.rotation @ rotation[keep]
    translation[keep] = new_from_old(translation[keep])
    poses = Rigid(rotation, translation)
    return replace(sparse, body_from_cam=poses, points=new_from_old(sparse.points))


def connected_groups(inliers: np.ndarray, minimum: int) -> list[list[int]]:
    """Sets of views (sorted, largest first) joined by chains of pairs with at least `minimum` matches."""
    from scipy.sparse.csgraph import connected_components

    _, label = connected_components(inliers >= minimum, directed=False)
    groups = [np.flatnonzero(label == value).tolist() for value in np.unique(label)]
    return sorted(groups, key=len, reverse=True)


def _observation_depth(sparse: SparseModel) -> np.ndarray:
    """(M,) depth of each observed point in its observing view."""
    cam_from_body = sparse.body_from_cam.inverse()[sparse.point_view]
    return cam_from_body(sparse.points[sparse.point_of_observation])[:, 2]
