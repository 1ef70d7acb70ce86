"""Points triangulated from verified matches, with approximately known poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.sparse import SparseModel
from photoclinometry.sfm.adjustment import RobustAdjustment
from photoclinometry.sfm.database import DATABASE
from photoclinometry.sfm.mapping import from_colmap, tune_triangulation
from photoclinometry.sfm.options import SfmOptions
from photoclinometry.sfm.reversal import resolve_pose_reversals

MIN_RATIO, MAX_RATIO = 0.5, 2.0
"""Pairs of views by priors: bounds of the ratio of their resolutions; SIFT bridges a factor of two safely."""
MAX_APART_DEG = 50.0
"""Pairs of views by priors: largest angle between the lines of sight. Keypoints of relief are found again up to angles
of 30 degrees on smooth ground, and beyond 50 hardly anywhere."""


def likely_pairs(towards_camera: np.ndarray, gsd: np.ndarray) -> list[tuple[int, int]]:
    """Pairs (a, b), b < a, of views that see the same ground from similar directions at similar resolutions.

    towards_camera: (K, 3) unit vectors from the body; gsd: (K,) ground sample distances, in any unit.
    """
    near = towards_camera @ towards_camera.T >= np.cos(np.radians(MAX_APART_DEG))
    ratio = gsd[:, None] / gsd
    first, second = np.nonzero(np.tril(near & (ratio >= MIN_RATIO) & (ratio <= MAX_RATIO), -1))
    return list(zip(first.tolist(), second.tolist(), strict=True))


class VerifiedMatches:
    """All keypoints and verified matches of a work folder, in memory."""

    def __init__(self, work_dir: Path, options: SfmOptions):
        import pycolmap

        self.options = options
        self._cache: Any
        wanted = pycolmap.DatabaseCacheOptions()
        wanted.min_num_matches = options.min_pair_matches
        with pycolmap.Database.open(work_dir / DATABASE) as database:
            self._cache = pycolmap.DatabaseCache.create(database, wanted)

    def triangulated(
        self, cameras: list[Camera], body_from_cam: Rigid, used: np.ndarray, gate_px: float
    ) -> SparseModel:
        """The points on which the views `used` (K,) bool agree within `gate_px`; poses are taken as they are given.

        Views that see no such point count as not registered; their poses stay, too.
        """
        model = self._posed(body_from_cam, used)
        self._triangulate(model, cameras, gate_px)
        return replace(_only_seeing(from_colmap(model, cameras), used), body_from_cam=body_from_cam)

    def adjusted(self, cameras: list[Camera], body_from_cam: Rigid, used: np.ndarray, gate_px: float) -> SparseModel:
        """As `triangulated`, and adjusted: points and poses, in a frame that two of the cameras hold.

        Views whose own pose was reversed are turned round.
        """
        adjustment = RobustAdjustment(self.options.threads)
        model = self._posed(body_from_cam, used)
        self._triangulate(model, cameras, gate_px)
        adjustment.of_model(model)
        model = resolve_pose_reversals(model, adjustment)
        return _only_seeing(from_colmap(model, cameras), used)

    def _posed(self, body_from_cam: Rigid, used: np.ndarray) -> Any:
        """A pycolmap reconstruction of the views `used` (K,) bool, without points."""
        import pycolmap

        model = pycolmap.Reconstruction()
        model.load(self._cache)
        cam_from_body = body_from_cam.inverse()
        for image in model.images.values():
            view = int(Path(image.name).stem)
            if used[view]:
                rotation = pycolmap.Rotation3d(cam_from_body.rotation[view])
                pose = pycolmap.Rigid3d(rotation, cam_from_body.translation[view])
                image.frame.set_cam_from_world(image.camera_id, pose)
                model.register_frame(image.frame_id)
        return model

    def _triangulate(self, model: Any, cameras: list[Camera], gate_px: float) -> None:
        import pycolmap

        limits = pycolmap.IncrementalTriangulatorOptions()
        tune_triangulation(limits, cameras, replace(self.options, max_reprojection_px=gate_px))
        graph = self._cache.correspondence_graph
        observed = pycolmap.ObservationManager(model, graph)
        triangulator = pycolmap.IncrementalTriangulator(graph, model, observed)
        for image_id in model.reg_image_ids():
            triangulator.triangulate_image(limits, image_id)
        triangulator.complete_all_tracks(limits)
        triangulator.merge_all_tracks(limits)
        triangulator.retriangulate(limits)
        observed.filter_all_points3D(gate_px, self.options.min_triangulation_deg)
        model.update_point_3d_errors()


def _only_seeing(found: SparseModel, used: np.ndarray) -> SparseModel:
    """The model in which only those of the views `used` (K,) that see points count as registered."""
    seen = np.bincount(found.point_view, minlength=len(used)) > 0
    return replace(found, registered=used & seen)
