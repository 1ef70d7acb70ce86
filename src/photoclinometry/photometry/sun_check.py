"""Views that contradict the others: a Sun direction that is wrong, or brightness of another place.

The sparse points, projected into every view, are a coarse map. Normals (planes through neighbours, then shading) and
albedos of all views but one say how that one looks under any Sun; its own brightness says under which Sun it was
taken (`sun_fit`). The other views are its witnesses. No dense match is needed, and none is made in vain.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Image, Landmarks, Region, Scene, Tracks, Views
from photoclinometry.model.sparse import SparseModel
from photoclinometry.photometry.initialize import normals_from_neighbours, predicted_ratio, sample_brightness
from photoclinometry.photometry.shading import normals_from_shading
from photoclinometry.photometry.sun_fit import Ground, SunFit, fit_sun
from photoclinometry.surface.sampling import blurred

log = logging.getLogger(__name__)

POINTS = 3000
"""Sparse points that are used at most, drawn at random: more do not make the Suns better."""

NEIGHBOURS = 32
"""Points through which a plane is fitted; the images are blurred as much as that blurs the ground."""

MIN_COSINE = 0.3
"""Points are used where the cosine of emission is above this: others may be hidden."""

MIN_POINTS = 50
"""A view that sees fewer points is not judged."""


def coarse_scene(
    sparse: SparseModel, images: Sequence[Image], views: Views, reflectance: Reflectance, brightness: str
) -> Scene:
    """The sparse points as landmarks, observed wherever they lie in the frame of a registered view.

    images, views: all K. The scene's views are the registered ones. Brightness is that of images blurred as the planes
    blur the ground; albedos are 1 and scales as given. Reference, region and pixels mean nothing.
    """
    kept = np.flatnonzero(sparse.registered)
    views = views[kept]
    normal, radius = _planes(sparse.points, views.body_from_cam.translation)
    chosen = np.arange(len(normal))
    if len(chosen) > POINTS:
        chosen = np.sort(np.random.default_rng(0).choice(chosen, POINTS, replace=False))
    position, normal = sparse.points[chosen], normal[chosen]
    sigma_px = [radius / views.gsd(n, position) for n in range(len(views))]
    pictures = [blurred(images[k], max(sigma, 0.5)) for k, sigma in zip(kept.tolist(), sigma_px, strict=True)]
    tracks = _projected(position, normal, views, pictures)
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
        tracks=tracks,
        reference=0,
        region=Region(row=0, col=0, height=1, width=1),
    )


def sun_by_witnesses(scene: Scene, used: np.ndarray, view: int) -> SunFit | None:
    """The Sun of one view (of a `coarse_scene`) as the brightness of the views `used` (K,) bool tells it.

    The view itself is never its own witness. None where it shares fewer than MIN_POINTS lit points with them.
    """
    others = used & (np.arange(len(used)) != view)
    ground, known = ground_of(scene, others)
    tracks = scene.tracks
    mine = np.flatnonzero((tracks.view == view) & tracks.lit & known[tracks.landmark])
    if len(mine) < MIN_POINTS or scene.reflectance is None:
        return None
    at = tracks.landmark[mine]
    marks = ground.landmarks
    seen = Ground(
        position=marks.position[at],
        normal=marks.normal[at],
        albedo=marks.albedo[at],
        camera_center=scene.views.body_from_cam.translation[view],
    )
    bias_sigma = 1e-3 if scene.brightness == "iof" else 0.1
    return fit_sun(seen, tracks.brightness[mine], scene.views.sun[view], scene.reflectance, bias_sigma)


def ground_of(scene: Scene, used: np.ndarray) -> tuple[Scene, np.ndarray]:
    """Normals and albedos of the landmarks from some views (K,) bool, and (J,) bool: which of them these views light.

    Gains of all views are free. Albedo and gains are medians, in turns, which a minority of wrong views does not
    move far; shading then turns the normals, with Huber's loss.
    """
    marks, tracks = scene.landmarks, scene.tracks
    assert scene.reflectance is not None
    landmark, lit = tracks.landmark, tracks.lit & used[tracks.view]
    ratio, seen = predicted_ratio(marks.position, marks.normal, landmark, tracks.view, scene.views, scene.reflectance)
    usable = np.flatnonzero(lit & seen & (ratio > 0))
    albedo, gain = _albedo_and_gains(
        tracks.brightness[usable] / ratio[usable], landmark[usable], tracks.view[usable], len(marks), len(used)
    )
    known = np.isfinite(albedo)
    fitted = replace(
        scene,
        views=replace(scene.views, scale=gain),
        landmarks=replace(marks, albedo=np.where(known, albedo, 1.0)),
        tracks=replace(tracks, lit=lit & known[landmark]),
    )
    return normals_from_shading(fitted), known


def _albedo_and_gains(
    unscaled: np.ndarray, landmark: np.ndarray, view: np.ndarray, landmarks: int, views: int
) -> tuple[np.ndarray, np.ndarray]:
    """Albedo (J,), NaN where unseen, and gain (K,), with unscaled (N,) = albedo * gain, by medians in turns."""
    gain, albedo = np.ones(views), np.full(landmarks, np.nan)
    groups = [(k, np.flatnonzero(view == k)) for k in np.unique(view)]
    for k, mine in groups:
        gain[k] = np.median(unscaled[mine])
    for _ in range(3):
        albedo = _median_by(landmark, unscaled / gain[view], landmarks)
        for k, mine in groups:
            gain[k] = np.median(unscaled[mine] / albedo[landmark[mine]])
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


def _planes(position: np.ndarray, camera_centers: np.ndarray) -> tuple[np.ndarray, float]:
    """Normals (P, 3), and the standard deviation of the blur that a plane through neighbours is: half their radius."""
    from scipy.spatial import KDTree

    count = min(NEIGHBOURS, len(position))
    farthest = np.asarray(KDTree(position).query(position, k=count)[0])[:, -1]
    return normals_from_neighbours(position, camera_centers, count), 0.5 * float(np.median(farthest))


def _projected(position: np.ndarray, normal: np.ndarray, views: Views, images: Sequence[Image]) -> Tracks:
    """Every point (P, 3) where it lies in each view's frame and is not seen too obliquely."""
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
    number = np.bincount(landmark, minlength=len(position))
    return Tracks(
        start=np.concatenate([[0], np.cumsum(number)]).astype(np.int64),
        view=view.astype(np.int32),
        keypoint=keypoint,
        keypoint_sigma=np.ones(len(view)),
        brightness=brightness,
        lit=lit,
    )
