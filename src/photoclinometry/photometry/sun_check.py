"""The leave-one-out Sun check: each view's Sun direction from ground that the other views determine.

The sparse points, projected into every view, are a coarse map. Its normals (planes through neighbours, then shading)
and albedos come from all views but one. They predict how that view looks under any Sun, so that its own brightness
determines its Sun (`sun_fit`). No dense match is needed: wrong views are found before any effort is spent on them.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.geometry import unit
from photoclinometry.model.image import Image
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Landmarks, Scene, Tracks, Views
from photoclinometry.model.sparse import SparseModel
from photoclinometry.photometry.albedo import SCALE_SWEEPS, predicted_ratio
from photoclinometry.photometry.predict import BIAS_SIGMA
from photoclinometry.photometry.sampled_brightness import sample_brightness
from photoclinometry.photometry.shading import normals_from_shading
from photoclinometry.photometry.sparse_planes import as_blurred, sparse_planes
from photoclinometry.photometry.sun_fit import SeenGround, SunFit, fit_sun

log = logging.getLogger(__name__)

POINTS = 3000
"""Sparse points that are used at most, drawn at random: more cost time and do not make the Suns better, since the
errors of neighbouring points are correlated."""

MIN_COSINE = 0.3
"""Points are used where the cosine of emission is above this: at 73 degrees and more relief hides others."""

MIN_POINTS = 50
"""Fewest points of a view that is checked: the fit has four unknowns and its patches need some points each."""


def coarse_scene(
    sparse: SparseModel, images: Sequence[Image], views: Views, reflectance: Reflectance, brightness: str
) -> Scene:
    """The sparse points as landmarks, observed wherever they lie in the frame of a registered view.

    images, views: all K. The scene's views are the registered ones. Images are blurred as much as the planes through
    neighbouring points blur the ground. Albedos are 1, scales as given; reference, region and pixels have no meaning.
    """
    kept = np.flatnonzero(sparse.registered)
    views = views[kept]
    normal, blur = sparse_planes(sparse)
    chosen = np.arange(len(normal))
    if len(chosen) > POINTS:
        chosen = np.sort(np.random.default_rng(0).choice(chosen, POINTS, replace=False))
    position, normal = sparse.points[chosen], normal[chosen]
    smooth = [as_blurred(images[k], blur, views.gsd(n, position)) for n, k in enumerate(kept.tolist())]
    return Scene(
        name="sparse points",
        body=None,
        brightness=brightness,
        reflectance=reflectance,
        views=views,
        landmarks=Landmarks(
            position=position,
            normal=normal,
            albedo=np.ones(len(chosen)),
            pixel=np.zeros((len(chosen), 2), np.int32),
        ),
        tracks=_projected(position, normal, views, smooth),
        reference=0,
        region=Region(row=0, col=0, height=1, width=1),
    )


def sun_from_other_views(scene: Scene, used: np.ndarray, view: int) -> SunFit | None:
    """The Sun of one view of a `coarse_scene`, fitted on the ground that the other views `used` (K,) bool determine.

    The view itself never takes part in determining the ground. None where it shares fewer than MIN_POINTS lit points
    with the others.
    """
    others = used & (np.arange(len(used)) != view)
    fitted, known = ground_from_views(scene, others)
    tracks, landmarks = scene.tracks, fitted.landmarks
    own = np.flatnonzero((tracks.view == view) & tracks.lit & known[tracks.landmark])
    if len(own) < MIN_POINTS or scene.reflectance is None:
        return None
    at = tracks.landmark[own]
    ground = SeenGround(
        position=landmarks.position[at],
        normal=landmarks.normal[at],
        albedo=landmarks.albedo[at],
        camera_center=scene.views.body_from_cam.translation[view],
    )
    bias_sigma = BIAS_SIGMA[scene.brightness]
    return fit_sun(ground, tracks.brightness[own], scene.views.sun[view], scene.reflectance, bias_sigma)


def ground_from_views(scene: Scene, used: np.ndarray) -> tuple[Scene, np.ndarray]:
    """Normals and albedos of the landmarks from some views (K,) bool, and (J,) bool: landmarks that are lit in these
    views.

    Gains of all views are free. Albedos and gains are medians, taken in turns, which a minority of wrong views does not
    move far; shading then turns the normals, with Huber's loss.
    """
    albedo, gain, _ = _unshaded(scene, used)
    landmarks, tracks, known = scene.landmarks, scene.tracks, np.isfinite(albedo)
    start = replace(
        scene,
        views=replace(scene.views, scale=gain),
        landmarks=replace(landmarks, albedo=np.where(known, albedo, 1.0)),
        tracks=replace(tracks, lit=tracks.lit & used[tracks.view] & known[tracks.landmark]),
    )
    return normals_from_shading(start), known


def gains_of_views(scene: Scene, used: np.ndarray) -> np.ndarray:
    """(K,) gains of views `used` (K,) bool, up to a common factor, as `ground_from_views` uses them.

    NaN of views with fewer than MIN_POINTS usable points, and of those out of use.
    """
    _, gain, number = _unshaded(scene, used)
    return np.where(number >= MIN_POINTS, gain, np.nan)


def _unshaded(scene: Scene, used: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Albedo (J,), NaN where unseen; gain (K,) of views `used` (K,) bool; and (K,) the number of points of each
    gain."""
    landmarks, tracks = scene.landmarks, scene.tracks
    assert scene.reflectance is not None
    ratio, oblique = predicted_ratio(
        landmarks.position, landmarks.normal, tracks.landmark, tracks.view, scene.views, scene.reflectance
    )
    usable = np.flatnonzero(tracks.lit & used[tracks.view] & oblique & (ratio > 0))
    landmark, view = tracks.landmark[usable], tracks.view[usable]
    albedo, gain = _albedo_and_gains(
        tracks.brightness[usable] / ratio[usable], landmark, view, len(landmarks), len(used)
    )
    return albedo, gain, np.bincount(view, minlength=len(used))


def _albedo_and_gains(
    unshaded: np.ndarray, landmark: np.ndarray, view: np.ndarray, landmarks: int, views: int
) -> tuple[np.ndarray, np.ndarray]:
    """Albedo (J,), NaN where unseen, and gain (K,), with unshaded (N,) = albedo * gain, by medians in turns."""
    gain, albedo = np.ones(views), np.full(landmarks, np.nan)
    groups = [(k, np.flatnonzero(view == k)) for k in np.unique(view)]
    for k, own in groups:
        gain[k] = np.median(unshaded[own])
    for _ in range(SCALE_SWEEPS):
        albedo = _median_by(landmark, unshaded / gain[view], landmarks)
        for k, own in groups:
            gain[k] = np.median(unshaded[own] / albedo[landmark[own]])
    return albedo, gain


def _median_by(group: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """(count,) medians of the values (N,) of each group; NaN where there are none."""
    number = np.bincount(group, minlength=count)
    start = np.cumsum(number) - number
    ordered = values[np.lexsort((values, group))]
    median, some = np.full(count, np.nan), number > 0
    low, high = (start + (number - 1) // 2)[some], (start + number // 2)[some]
    median[some] = 0.5 * (ordered[low] + ordered[high])
    return median


def _projected(position: np.ndarray, normal: np.ndarray, views: Views, images: Sequence[Image]) -> Tracks:
    """Tracks of every point (P, 3) in all views that contain it and do not see it too obliquely."""
    found = []
    for k, camera in enumerate(views.cameras):
        local = views.body_from_cam[k].inverse()(position)
        towards = unit(views.body_from_cam.translation[k] - position)
        front = (local[:, 2] > 0) & (np.sum(towards * normal, -1) > MIN_COSINE)
        xy = camera.pixel_from_cam(np.where(front[:, None], local, [0.0, 0.0, 1.0]))
        inside = front & np.all((xy > 1) & (xy < [camera.width - 1, camera.height - 1]), -1)
        at = np.flatnonzero(inside)
        found.append((at, np.full(len(at), k), xy[at]))
    landmark, view, keypoint = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.lexsort((view, landmark))
    landmark, view, keypoint = landmark[order], view[order], keypoint[order]
    brightness, lit = sample_brightness(list(images), view, keypoint)
    return Tracks(
        start=row_starts(np.bincount(landmark, minlength=len(position))),
        view=view.astype(np.int32),
        keypoint=keypoint,
        keypoint_sigma=np.ones(len(view)),
        brightness=brightness,
        lit=lit,
    )
