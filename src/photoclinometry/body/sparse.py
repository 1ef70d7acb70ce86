"""All images of a body in one sparse model, in the frame of its pose priors where there are such."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photoclinometry.adjust import PosePriors
from photoclinometry.adjust.bundle import bundle_adjusted, pose_covariances
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.progress import Progress
from photoclinometry.model.scene import Views
from photoclinometry.model.sparse import SparseModel, among_more_views
from photoclinometry.model.warning import warn
from photoclinometry.photometry.relief_shading import relief_shading
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.frame.pose_priors import priors_of_views
from photoclinometry.pipeline.sparse_stages import Inputs, PosedImages, views_from
from photoclinometry.registration.georeference import MIN_PRIORS
from photoclinometry.sfm import SfmOptions, reconstruct_sparse
from photoclinometry.sfm.database import add_relief_keypoints, disk_errors, write_views
from photoclinometry.sfm.known_poses import VerifiedMatches, likely_pairs
from photoclinometry.sfm.mapping import quiet_pycolmap
from photoclinometry.sfm.matching import match_views
from photoclinometry.sfm.reconstruct import warn_if_inside_out

log = logging.getLogger(__name__)

FIRST_GATE = 3.0
"""Observations count in the first bundle adjustment if they agree with the priors within this multiple of the priors'
sigma in pixels."""
GATE_SHRINKS = 3.0
"""Factor by which the limit decreases from one bundle adjustment to the next, down to that of the options."""
KEYPOINT_SIGMA_PX = 0.3
"""Standard deviation of SIFT keypoints [px]."""
LOOSE_PX = 10.0
"""Standard deviation of sparse poses where there are no priors [px]: they hold the frame, and nothing else."""
FEWEST_POINTS = 15
"""Fewest points of the model in a registered view: with fewer its pose is hardly better than its prior."""


@dataclass(frozen=True, kw_only=True)
class BodySparse(Stage[SparseModel]):
    """Poses and sparse points of all views of a body.

    With MIN_PRIORS pose priors or more, points are triangulated by these, and bundle adjustments with priors and
    points together follow, under limits that become tighter. Matches between groups of images, which are too few to
    join models made from images alone, then count. Without priors the model is that of `reconstruct_sparse`.
    """

    name = "body_sparse"
    result = SparseModel
    inputs: Keyed[Inputs]
    priors: Mapping[str, PosePrior]
    """By name of view."""
    options: SfmOptions

    def make(self, tools: Tools) -> SparseModel:
        inputs = self.inputs.value
        by_priors = len(self.priors) >= MIN_PRIORS
        known = np.array([not by_priors or image.name in self.priors for image in inputs.images])
        usable = np.array([image.name not in inputs.unusable for image in inputs.images])
        rows = np.flatnonzero(known & usable)
        chosen = replace(
            inputs,
            images=[inputs.images[k] for k in rows],
            site=replace(inputs.site, views=tuple(inputs.site.views[k] for k in rows)),
        )
        if by_priors:
            found = self._by_priors(chosen, tools)
        else:
            sun = chosen.site.sun_in_cam
            found = reconstruct_sparse(chosen.images, chosen.cameras, tools.scratch, self.options, tools.progress, sun)
        say_found(
            f"{found.registered.sum()} of {len(inputs.images)} views, {len(found.points):,} points, "
            f"{found.mean_reprojection_px:.2f} px"
        )
        without = [inputs.unusable.get(image.name, "it has no pose prior") for image in inputs.images]
        return among_more_views(found, known & usable, without)

    def _by_priors(self, inputs: Inputs, tools: Tools) -> SparseModel:
        names = [image.name for image in inputs.images]
        nowhere = Rigid(np.tile(np.eye(3), (len(names), 1, 1)), np.zeros((len(names), 3)))
        priors = priors_of_views(names, nowhere, {name: self.priors[name] for name in names})
        with disk_errors(tools.scratch), quiet_pycolmap(self.options.seed):
            matches = self._matched(inputs, priors.body_from_cam, tools.scratch, tools.progress)
            found = self._adjusted(inputs, priors, matches)
        number = np.bincount(found.point_view, minlength=len(inputs.images))
        registered = number >= FEWEST_POINTS
        if registered.sum() < MIN_PRIORS:
            raise ReconstructionError(
                f"{registered.sum()} of {len(registered)} views share points with others that agree with the pose "
                "priors; check cam_from_body (x_C = R x_B + t, metres) and its sigmas, or leave the priors out"
            )
        reason = [
            "" if own >= FEWEST_POINTS else f"not registered, it shares {own} points with other views" for own in number
        ]
        for view in np.flatnonzero(~registered):
            warn(log, "view-unregistered", "%s is left out: %s", names[view], reason[view], view=names[view])
        # Observations of the others stay: adjusted with their priors they are good enough for the coarse shape, which #
        # is 2.2 instead of 2.1 GSD off without them (`topshape`, 80 images of 192 px), and 1.6 instead of 1.4.
        found = replace(found, registered=registered, reason=np.array(reason))
        warn_if_inside_out(relief_shading(found, inputs.images, inputs.cameras, inputs.site.sun_in_cam))
        return found

    def _matched(self, inputs: Inputs, poses: Rigid, work_dir: Path, progress: Progress) -> VerifiedMatches:
        work_dir.mkdir(parents=True, exist_ok=True)
        focal = np.array([np.mean(camera.focal_px) for camera in inputs.cameras])
        distance = np.linalg.norm(poses.translation, axis=-1)
        pairs = likely_pairs(unit(poses.translation), distance / focal)
        write_views(inputs.images, inputs.cameras, work_dir, self.options, progress)
        if self.options.relief_keypoints:
            add_relief_keypoints(inputs.images, inputs.cameras, inputs.site.sun_in_cam, work_dir, self.options)
        inliers = match_views(len(inputs.images), pairs, work_dir, self.options, "matches", progress)
        log.info("%d of %d pairs match", np.count_nonzero(inliers) // 2, len(pairs))
        return VerifiedMatches(work_dir, self.options)

    def _adjusted(self, inputs: Inputs, priors: PosePriors, matches: VerifiedMatches) -> SparseModel:
        """Triangulated and adjusted, again and again, as poses improve."""
        poses, used = priors.body_from_cam, np.ones(len(inputs.images), bool)
        gate, last = first_gate(inputs.cameras, priors), False
        while True:
            found = matches.triangulated(inputs.cameras, poses, used, gate)
            views = views_from(inputs.site, found)
            found = bundle_adjusted(found, views, priors, KEYPOINT_SIGMA_PX)
            log.info(
                "bundle adjustment of %d points within %.3g px: %.3f px mean reprojection error",
                len(found.points), gate, found.mean_reprojection_px,
            )  # fmt: skip
            if last:
                return found
            poses, last = found.body_from_cam, gate <= self.options.max_reprojection_px
            gate = max(gate / GATE_SHRINKS, self.options.max_reprojection_px)


def first_gate(cameras: Sequence[Camera], priors: PosePriors) -> float:
    """Distance of observations from projections by the priors [px]."""
    focal = np.array([np.mean(camera.focal_px) for camera in cameras])
    distance = np.linalg.norm(priors.body_from_cam.translation, axis=-1)
    return FIRST_GATE * float(np.max(focal * np.hypot(priors.rotation_sigma, priors.center_sigma / distance)))


@dataclass(frozen=True, kw_only=True)
class PoseCovariances:
    """Covariances of the sparse model's poses."""

    covariance: np.ndarray
    """(K, 6, 6) as of `KnownPoses`, in units of B."""


@dataclass(frozen=True, kw_only=True)
class PoseUncertainty(Stage[PoseCovariances]):
    """The covariances of the last bundle adjustment of sparse points."""

    name = "pose_covariances"
    result = PoseCovariances
    posed: PosedImages
    priors: Mapping[str, PosePrior]
    """By name of view."""

    def make(self, tools: Tools) -> PoseCovariances:
        views, sparse = self.posed.views, self.posed.sparse.value
        priors = frame_priors(self.priors, views, sparse)
        return PoseCovariances(covariance=pose_covariances(sparse, views, priors, KEYPOINT_SIGMA_PX))


def frame_priors(known: Mapping[str, PosePrior], views: Views, sparse: SparseModel) -> PosePriors:
    """Pose priors of navigation, by name of view; without them the sparse poses, loosely."""
    if known:
        return priors_of_views(views.name, sparse.body_from_cam, known)
    focal = np.array([np.mean(camera.focal_px) for camera in views.cameras])
    distance = np.linalg.norm(sparse.body_from_cam.translation - sparse.points.mean(0), axis=-1)
    return PosePriors(
        body_from_cam=sparse.body_from_cam,
        rotation_sigma=LOOSE_PX / focal,
        center_sigma=LOOSE_PX / focal * distance,
    )
