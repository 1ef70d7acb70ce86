"""Models and poses of single views with reversed depth, and the choice between them and the right ones.

Under parallel projection a shape seen from some directions looks like its mirror image in depth, seen from the opposite
directions (Necker's reversal; Hartley and Zisserman 2004, Multiple View Geometry, 14.8). Rays of a narrow-angle camera
are nearly parallel. Two views then hardly distinguish the two, structure from motion begins with two views, and bundle
adjustment does not lead from one to the other. All views together do distinguish them.

The same holds for a single view where the ground is nearly a plane: seen from the direction mirrored at the plane's
normal it looks the same (the two poses of Schweighofer and Pinz 2006, IEEE TPAMI 28, 2024-2030). The mapper may give a
view the wrong pose; the relief of its points shows which one is right.
"""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from photoclinometry.photometry.relief_shading import ReliefShading
from photoclinometry.sfm.adjustment import RobustAdjustment, keypoints_with_points

log = logging.getLogger(__name__)

UNDETERMINED_RATIO = 1.02
"""Ratio of the two mean reprojection errors below which the images do not determine which is right. The ratio of right
models to reversed ones is 0.36 to 0.6 on simulated sites with a field of view of 2 degrees. For single views it is the
ratio of costs: a reversed pose that adjustment leads back to the view's own has a ratio of 1 up to rounding."""

DOUBTFUL = 1.3
"""The same ratio, below which a model is mapped again. Models with some views reversed have 1.0 to 1.2; right ones of
low relief and a field of view of 1.7 degrees 1.1 and more."""

HOPELESS = 6.0
"""Ratio of the reprojection error of the reverse of a model, or of a pose with the same points, before adjustment, to
that of the model or pose itself, beyond which the reverse is not adjusted: the relief is then plain. Wrong poses have
0.8 to 5.8, right ones of low relief 4 to 9, of other relief 10 and more."""

SETTLED = 1e-4
"""Least relative decrease of the mean reprojection error that counts: one view of hundreds changes it by more, rounding
by less."""

FEWEST_POINTS = 4
"""Fewest points of a view whose pose is examined: three always lie in a plane."""

_DEPTH = np.diag([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class Oriented:
    """A pycolmap reconstruction, adjusted, that explains the images better than its reverse does."""

    model: Any
    error_px: float
    """Mean reprojection error."""
    reverse_px: float
    """That of the reverse, adjusted as well unless that is HOPELESS."""
    shading: ReliefShading | None = None
    """Of the model; None where no Sun is known."""

    @property
    def is_doubtful(self) -> bool:
        """Whether both explain the keypoints nearly equally well, so that views may be mixed: some right, some
        reversed."""
        return self.reverse_px < DOUBTFUL * self.error_px

    @property
    def is_shown(self) -> bool:
        """Whether the images show the model's relief. A mixture of right and reversed views has that of neither."""
        return self.shading is not None and self.shading.shows == "model"

    @property
    def undecided(self) -> tuple[float, float] | None:
        """Mean reprojection errors of the model and of its reverse [px], where they hardly differ and shading does not
        decide; else None."""
        if self.is_shown or self.reverse_px >= UNDETERMINED_RATIO * self.error_px:
            return None
        return self.error_px, self.reverse_px

    @property
    def overruled(self) -> tuple[float, float] | None:
        """Mean reprojection errors of the model and of its reverse [px], where shading shows the model although its
        reverse explains the keypoints better; else None. No right model with this property is known: Suns in the
        opposite direction cause it."""
        if not self.is_shown or self.error_px < UNDETERMINED_RATIO * self.reverse_px:
            return None
        return self.error_px, self.reverse_px


def resolve_depth_reversal(
    model: Any, adjustment: RobustAdjustment, shading_of: Callable[[Any], ReliefShading] | None = None
) -> Oriented:
    """The pycolmap reconstruction, adjusted in place, or its reverse where that explains the images better.

    Where the reprojection errors of the two are less than DOUBTFUL apart, shading decides if it can. Views whose own
    pose is reversed are turned round, too. shading_of: of a reconstruction, by the images; None where no Sun is known.
    """
    found = _better_of_both(model, adjustment, shading_of)
    for _ in range(model.num_reg_images()):
        turned = resolve_pose_reversals(found.model, adjustment)
        if turned is found.model:
            break
        found = _better_of_both(turned, adjustment, shading_of)
    return found


def _better_of_both(
    model: Any, adjustment: RobustAdjustment, shading_of: Callable[[Any], ReliefShading] | None
) -> Oriented:
    """The model, adjusted in place, or its reverse."""
    adjustment.of_model(model)
    other = reversed_model(model)
    shading = shading_of(model) if shading_of else None
    shown = shading.shows if shading else "neither"
    error, reverse = (each.compute_mean_reprojection_error() for each in (model, other))
    if reverse < HOPELESS * error or shown == "reverse":
        adjustment.of_model(other)
        reverse = other.compute_mean_reprojection_error()
    log.info("mean reprojection error %.3g px, with depth and rotations reversed %.3g px", error, reverse)
    if shading:
        log.info("shading and brightness correlate by %.2f, reversed %.2f", shading.correlation, shading.reverse)
    is_wrong = reverse < error
    if shown != "neither" and max(error, reverse) < DOUBTFUL * min(error, reverse):
        is_wrong = shown == "reverse"
    if not is_wrong:
        return Oriented(model, error, reverse, shading)
    return Oriented(other, reverse, error, shading_of(other) if shading_of else None)


def resolve_pose_reversals(model: Any, adjustment: RobustAdjustment) -> Any:
    """The model, adjusted anew after views were turned round whose reversed pose explains their points better.

    One view that is turned may reveal others, so that all are examined again until none is turned, or the mean
    reprojection error no longer decreases (SETTLED). The model itself where none is turned.
    """
    for _ in range(model.num_reg_images()):
        better = {image_id: _better_pose(model, image_id, adjustment) for image_id in model.reg_image_ids()}
        turned = {image_id: pose for image_id, pose in better.items() if pose is not None}
        if not turned:
            break
        found = copy.deepcopy(model)
        for image_id, pose in turned.items():
            _frame(found, image_id).rig_from_world = pose
        adjustment.of_model(found)
        before, after = (each.compute_mean_reprojection_error() for each in (model, found))
        names = ", ".join(model.images[image_id].name for image_id in turned)
        log.info("turned round: %s; mean reprojection error %.3f -> %.3f px", names, before, after)
        if after > (1.0 - SETTLED) * before:
            break
        model = found
    return model


def _better_pose(model: Any, image_id: int, adjustment: RobustAdjustment) -> Any | None:
    """The reversed pose of an image, adjusted with its points, if it explains them better than its pose does."""
    image, frame = model.images[image_id], _frame(model, image_id)
    seen = keypoints_with_points(image)
    if len(seen) < FEWEST_POINTS:
        return None
    points = [model.points3D[keypoint.point3D_id] for keypoint in seen]
    pose, places = copy.copy(frame.rig_from_world), np.array([point.xyz for point in points])
    reverse = reversed_pose(pose, places)
    pixels, camera = np.array([keypoint.xy for keypoint in seen]), model.cameras[image.camera_id]
    error, start = (_reprojection_rms_px(camera, each, places, pixels) for each in (pose, reverse))
    if start > HOPELESS * error:
        return None
    cost = adjustment.cost_of_view(model, image_id)
    frame.rig_from_world = reverse
    other = adjustment.of_view(model, image_id)
    found = copy.copy(frame.rig_from_world)
    frame.rig_from_world = pose
    for point, place in zip(points, places, strict=True):
        point.xyz = place
    return found if UNDETERMINED_RATIO * other < cost else None


def _reprojection_rms_px(camera: Any, pose: Any, points: np.ndarray, pixels: np.ndarray) -> float:
    """Of points (n, 3) that a pycolmap camera sees at pixels (n, 2), from a pose (cam_from_world)."""
    local = points @ pose.rotation.matrix().T + pose.translation
    return float(np.sqrt(np.mean(np.sum((camera.img_from_cam(local) - pixels) ** 2, axis=-1))))


def reversed_pose(pose: Any, points: np.ndarray) -> Any:
    """The pycolmap pose (cam_from_world) that sees the plane of best fit to points (n, 3) the same from its other side.

    With D = diag(1, 1, -1), n the plane's normal, S = 1 - 2 n n^T and m the middle of the points, [R | t] becomes
    [D R S | R m + t - D R S m].
    """
    import pycolmap

    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    rotation = pose.rotation.matrix()
    turned = _DEPTH @ rotation @ (np.eye(3) - 2.0 * np.outer(normal, normal))
    return pycolmap.Rigid3d(pycolmap.Rotation3d(turned), rotation @ middle + pose.translation - turned @ middle)


def reversed_model(model: Any) -> Any:
    """A copy of a pycolmap reconstruction with all points mirrored in depth, and cameras that see nearly the same
    image.

    With D = diag(1, 1, -1) and m the middle of the points, X becomes m + D (X - m), and cam_from_world [R | t] becomes
    [D R D | R m + t - D R D m]: in each camera the depth from the middle changes its sign, and nothing else does.
    """
    import pycolmap

    found = copy.deepcopy(model)
    points = [found.points3D[number] for number in found.point3D_ids()]
    middle = np.mean([point.xyz for point in points], axis=0)
    for point in points:
        point.xyz = middle + _DEPTH @ (point.xyz - middle)
    for image_id in found.reg_image_ids():
        frame = _frame(found, image_id)
        pose = frame.rig_from_world
        rotation = pose.rotation.matrix()
        turned = _DEPTH @ rotation @ _DEPTH
        translation = rotation @ middle + pose.translation - turned @ middle
        frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(turned), translation)
    found.update_point_3d_errors()
    return found


def _frame(model: Any, image_id: int) -> Any:
    return model.frames[model.images[image_id].frame_id]
