"""Views held out of the map, to measure it on images that it was not made from.

They take part in the sparse stage, which gives their approximate poses. The map is made without them: neither their
dense matches, nor their sparse keypoints, nor their brightness enter. Then each is matched with the finished map, and
only its pose is fitted to the map (resection); its Sun is the measured one.
"""

from __future__ import annotations

import difflib
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.io.site import MIN_VIEWS
from photoclinometry.matching.interface import Matcher, MatchSetup
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, skew, so3_exp
from photoclinometry.model.image import Image
from photoclinometry.model.projection import project
from photoclinometry.model.scene import Scene, Views
from photoclinometry.model.warning import warn
from photoclinometry.photometry.albedo import predicted_ratio
from photoclinometry.photometry.predict import exposure_is_free
from photoclinometry.photometry.sampled_brightness import sample_brightness
from photoclinometry.registration.alignment import align_views, transform_poses
from photoclinometry.surface.depth_fit import landmark_depth

log = logging.getLogger(__name__)

MIN_MATCHES = 50
"""Fewest landmarks that must be found in a held-out view, and to which its exposure may be fitted; a view with fewer is
left out."""


@dataclass(frozen=True, kw_only=True)
class Resected:
    """H held-out views after their resection, as a stage's result."""

    index: np.ndarray
    """(H,) int: which of all views."""
    body_from_cam: Rigid
    """(H,) in the frame of the map."""
    scale: np.ndarray
    """(H,) 1 where brightness is predicted absolutely, else fitted to the image."""
    bias: np.ndarray
    """(H,) 0, or fitted with the scale."""
    keypoints: np.ndarray
    """(H,) int: landmarks found in the view."""
    keypoint_rms_px: np.ndarray
    """(H,) RMS distance of these from the projections of the map [px]."""


@dataclass(frozen=True, kw_only=True)
class _Resection:
    """One held-out view after its resection; the fields are those of `Resected`."""

    index: int
    body_from_cam: Rigid
    scale: float
    bias: float
    keypoints: int
    keypoint_rms_px: float


def held_out_mask(names: Sequence[str], hold_out: Sequence[str], reference: str | None = None) -> np.ndarray:
    """(K,) bool: which views `hold_out` names.

    Raises InputError for unknown names, for the reference, and where fewer than MIN_VIEWS others remain.
    """
    for name in hold_out:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1, cutoff=0.0)
            raise InputError(f"--hold-out (hold_out=): no view {name!r} in the site; nearest: {', '.join(near)}")
        if name == reference:
            raise InputError(
                f"--hold-out (hold_out=): {name} is the site's reference view; hold out others, or choose another"
            )
    mask = np.isin(np.array(names, object), list(hold_out))
    if mask.any() and np.count_nonzero(~mask) < MIN_VIEWS:
        raise InputError(
            f"--hold-out (hold_out=): {np.count_nonzero(mask)} of {len(names)} views are held out, at least "
            f"{MIN_VIEWS} must remain to be mapped; hold out fewer"
        )
    return mask


def resect_views(scene: Scene, views: Views, index: np.ndarray, images: Sequence[Image], matcher: Matcher) -> Resected:
    """Poses of views[index] from their matches with the finished map; those that do not show it are left out.

    views, images: all K of the site, `views` with rough poses in the map's frame.
    """
    found = []
    for k in index:
        resection = _resect_one(scene, views, int(k), images, matcher)
        if resection is None:
            name = views.name[k]
            warn(log, "held-out-unseen", "%s: held out, but shows too little of the map to measure", name, view=name)
        else:
            found.append(resection)
    poses = [one.body_from_cam for one in found]
    return Resected(
        index=np.array([one.index for one in found], int),
        body_from_cam=Rigid(
            np.array([p.rotation for p in poses]).reshape(-1, 3, 3),
            np.array([p.translation for p in poses]).reshape(-1, 3),
        ),
        scale=np.array([one.scale for one in found], float),
        bias=np.array([one.bias for one in found], float),
        keypoints=np.array([one.keypoints for one in found], int),
        keypoint_rms_px=np.array([one.keypoint_rms_px for one in found], float),
    )


def held_out_views(views: Views, resected: Resected) -> Views:
    """The held-out views (H,) in the frame of the map, under their measured Suns."""
    chosen = views[resected.index]
    return replace(chosen.at_poses(resected.body_from_cam), scale=resected.scale, bias=resected.bias)


def views_in_frame_of(scene: Scene, views: Views) -> Views:
    """All K views with their rough poses in the scene's frame, aligned by the poses of the views that both have."""
    scene_from_views = align_views(views, scene)
    return replace(
        views,
        body_from_cam=transform_poses(scene_from_views, views.body_from_cam),
        sun=views.sun @ scene_from_views.rotation.T,
    )


def _resect_one(scene: Scene, views: Views, k: int, images: Sequence[Image], matcher: Matcher) -> _Resection | None:
    """One view's pose and exposure; None where too little of the map is found in it."""
    landmarks, reference = scene.landmarks, views.name.index(scene.views.name[scene.reference])
    reference_pose, pose = scene.views.body_from_cam[scene.reference], views.body_from_cam[k]
    setup = MatchSetup(
        images=[images[reference], images[k]],
        cameras=[views.cameras[reference], views.cameras[k]],
        body_from_cam=_stacked(reference_pose, pose),
        reference=0,
        region=scene.region,
    )
    depth = landmark_depth(landmarks.position, landmarks.pixel, reference_pose, setup.padded, setup.cameras[0])
    seen, keypoint, residual = np.zeros(0, int), np.zeros((0, 2)), np.zeros(0)
    for _ in range(2):  # the second time the prediction is good, and the remaining displacements are small
        setup = replace(setup, body_from_cam=_stacked(reference_pose, pose))
        matches = matcher.match(setup.request(1, depth))
        row, col = scene.cells
        seen = np.flatnonzero(matches.valid[row, col])
        if len(seen) < MIN_MATCHES:
            return None
        keypoint, sigma = matches.position[row, col][seen], matches.sigma_px[row, col][seen]
        pose, residual = resect(landmarks.position[seen], keypoint, sigma, views.cameras[k], pose)
    exposure = _exposure(scene, views, k, images[k], pose, seen, keypoint)
    if exposure is None:
        return None
    return _Resection(
        index=k,
        body_from_cam=pose,
        scale=exposure[0],
        bias=exposure[1],
        keypoints=len(seen),
        keypoint_rms_px=float(np.sqrt(np.mean(residual**2))),
    )


def _stacked(first: Rigid, second: Rigid) -> Rigid:
    """(2,) poses."""
    return Rigid(np.stack([first.rotation, second.rotation]), np.stack([first.translation, second.translation]))


def resect(
    position: np.ndarray, keypoint: np.ndarray, sigma: np.ndarray, camera: Camera, initial: Rigid, iterations: int = 30
) -> tuple[Rigid, np.ndarray]:
    """body_from_cam of one view from points (n, 3) and their pixels (n, 2), and the remaining distances (n,) [px].

    sigma: (n,) of the pixels [px]. Gauss-Newton from an `initial` pose good to a few pixels, with squares re-weighted
    by 1 / (1 + (r / m)^2), m the median, so that wrong matches do not count. The steps turn and shift the points about
    their middle, since turns and shifts of a distant camera itself have nearly the same effect.
    """
    pivot = position.mean(0)
    extent = float(np.sqrt(np.mean(np.sum((position - pivot) ** 2, -1))))
    pose = initial
    for _ in range(iterations):
        offset, residual, jacobian = _residual(position, keypoint, camera, pose, pivot, extent)
        size = residual / sigma
        weight = 1.0 / (sigma * np.hypot(1.0, size / max(float(np.median(size)), 1e-9)))
        system = (jacobian * weight[:, None, None]).reshape(-1, 6)
        step = np.linalg.lstsq(system, -(offset * weight[:, None]).ravel(), rcond=1e-9)[0]
        turn = so3_exp(step[:3] / extent)
        moved_from_body = Rigid(turn, pivot + step[3:] - turn @ pivot)
        pose = moved_from_body.inverse() @ pose
        if np.linalg.norm(step) < 1e-10 * extent:
            break
    return pose, _residual(position, keypoint, camera, pose, pivot, extent)[1]


def _residual(
    position: np.ndarray, keypoint: np.ndarray, camera: Camera, pose: Rigid, pivot: np.ndarray, extent: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offsets (n, 2) and their lengths (n,) [px]; derivatives (n, 2, 6) by the points' turn x extent, and shift."""
    pixel, by_shift = project(pose.rotation, pose.translation, camera.intrinsics, position)
    offset = pixel - keypoint
    by_turn = -by_shift @ skew(position - pivot) / extent
    return offset, np.linalg.norm(offset, axis=-1), np.concatenate([by_turn, by_shift], -1)


def _exposure(
    scene: Scene, views: Views, k: int, image: Image, pose: Rigid, seen: np.ndarray, keypoint: np.ndarray
) -> tuple[float, float] | None:
    """Scale and bias of a held-out image: 1 and 0 where the model predicts absolute brightness.

    Otherwise they are fitted to the image itself (a straight line through predicted and measured brightness, fitted
    once more without outliers beyond 3 sigma), since nothing else determines an uncalibrated exposure; None where too
    little of the image is lit.
    """
    model = scene.reflectance
    if model is None or not exposure_is_free(scene.brightness, model):
        return 1.0, 0.0
    sun = pose.rotation @ views.sun_measured[k]
    alone = replace(views[[k]], body_from_cam=Rigid(pose.rotation[None], pose.translation[None]), sun=sun[None])
    zeros = np.zeros(len(seen), int)
    position, normal, albedo = (getattr(scene.landmarks, name)[seen] for name in ("position", "normal", "albedo"))
    ratio, usable = predicted_ratio(position, normal, np.arange(len(seen)), zeros, alone, model)
    measured, lit = sample_brightness([image], zeros, keypoint)
    predicted, used = albedo * ratio, lit & usable
    if used.sum() < MIN_MATCHES:
        return None
    line = np.polyfit(predicted[used], measured[used], 1)
    off = measured - np.polyval(line, predicted)
    used &= np.abs(off) <= 3.0 * np.std(off[used])
    scale, bias = np.polyfit(predicted[used], measured[used], 1)
    return float(scale), float(bias)
