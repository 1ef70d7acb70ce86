"""The gain by one more image: the drop of the mean sigmas, by the information of its brightness and its rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust import TiePoints
from photoclinometry.io.site import Site
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.errors import InputError
from photoclinometry.model.first_few import first_reasons
from photoclinometry.model.geometry import Rigid, angle_between, unit
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.projection import projected_keypoints
from photoclinometry.model.scene import Scene, Tracks, Views, join_views
from photoclinometry.plan.exposures import cropped_views
from photoclinometry.plan.forecast import KINDS, Forecast, stated_at
from photoclinometry.plan.options import CandidateOptions
from photoclinometry.plan.place import LISTED, PlannedViews, views_in, views_that_see
from photoclinometry.plan.table import read_table
from photoclinometry.simulate.trajectory import looking_at

MAP_PX, TIE_POINTS = 32, 300
"""Candidates are compared on a square in the middle of the map, whose side [px] is the first number, with no more tie
points than the second: ratios of sigmas change little with the size of a map, and there are many candidates."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One more view, with its whole image, and the directions of it and of its Sun from the place."""

    name: str
    view: Views
    """(1,) in the local frame."""
    tries: str
    """"Sun", "camera" or "table": the varied quantity."""


@dataclass(frozen=True, kw_only=True)
class Gain:
    """The gain by a candidate."""

    candidate: Candidate
    drop_percent: dict[str, float]
    """By kind, as of `drop_percent`; empty where the image shows nothing of the map."""
    angles: dict[str, float]
    """As of `view_angles`."""


def view_angles(views: Views, k: int) -> dict[str, float]:
    """Directions of a view and its Sun from the place [deg]; azimuths clockwise from north. And the resolution [m]."""
    camera, sun = unit(views.body_from_cam.translation[k]), views.sun[k]
    return {
        "emission_deg": _zenith(camera),
        "camera_azimuth_deg": _azimuth(camera),
        "incidence_deg": _zenith(sun),
        "sun_azimuth_deg": _azimuth(sun),
        "phase_deg": float(np.degrees(angle_between(camera, sun))),
        "gsd_m": views.gsd(k, np.zeros((1, 3))),
    }


def _zenith(direction: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.hypot(direction[0], direction[1]), direction[2])))


def _azimuth(direction: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(direction[0], direction[1])) % 360.0)


def candidates(planned: PlannedViews, options: CandidateOptions) -> tuple[list[Candidate], dict[str, str]]:
    """Candidates of the table that see the place by day, and by name the reasons why others do not; or directions of
    Suns, then of cameras. Raises InputError for a table that is wrong."""
    if options.table is not None:
        return _of_table(planned, read_table(options.table))
    return _varied(planned.views[[planned.reference]], options), {}


def _of_table(planned: PlannedViews, site: Site) -> tuple[list[Candidate], dict[str, str]]:
    seen, not_seen = views_that_see(site.views, planned.place)
    if not seen:
        raise InputError(
            f"{site.path}: none of the {len(site.views)} candidates sees the place. {first_reasons(not_seen, LISTED)}"
        )
    by_name = {view.name: view for view in site.views}
    views = views_in(planned.body_from_local, [by_name[found.name] for found in seen], site)
    return [Candidate(name=name, view=views[[k]], tries="table") for k, name in enumerate(views.name)], not_seen


def _varied(like: Views, options: CandidateOptions) -> list[Candidate]:
    """A view under other Suns, then from other directions."""
    found = [
        Candidate(
            name=f"Sun {azimuth:.0f}/{elevation:g}", view=_under(like, _direction(azimuth, 90 - elevation)), tries="Sun"
        )
        for elevation in options.sun_elevations_deg
        for azimuth in _around(options.sun_azimuths)
    ]
    return found + [
        Candidate(
            name=f"camera {azimuth:.0f}/{emission:g}", view=_from(like, _direction(azimuth, emission)), tries="camera"
        )
        for emission in options.emissions_deg
        for azimuth in _around(options.view_azimuths if emission > 0.0 else min(1, options.view_azimuths))
    ]


def _around(count: int) -> np.ndarray:
    return 360.0 * np.arange(count) / max(count, 1)


def _direction(azimuth_deg: float, zenith_deg: float) -> np.ndarray:
    azimuth, zenith = np.radians(azimuth_deg), np.radians(zenith_deg)
    return np.array([np.sin(zenith) * np.sin(azimuth), np.sin(zenith) * np.cos(azimuth), np.cos(zenith)])


def _under(like: Views, sun: np.ndarray) -> Views:
    """A view under another Sun."""
    return replace(like, sun=sun[None], sun_measured=(sun @ like.body_from_cam.rotation[0])[None])


def _from(like: Views, direction: np.ndarray) -> Views:
    """A view from elsewhere, as far away, under the same Sun."""
    far = float(np.linalg.norm(like.body_from_cam.translation[0]))
    pose = looking_at(far * direction, np.zeros(3), 0.0)
    moved = replace(like, body_from_cam=Rigid(pose.rotation[None], pose.translation[None]))
    return replace(moved, sun_measured=(like.sun[0] @ pose.rotation)[None])


def gains(found: Forecast, tried: Sequence[Candidate], progress: Progress = no_progress) -> list[Gain]:
    """The gain by each candidate, in the given order. The sigmas without and with it are computed from the same
    information."""
    _, noise = stated_at(found, found.scene, found.images, found.tie_points)
    found = _middle(found)
    base, _ = stated_at(found, found.scene, found.images, found.tie_points, noise=noise)
    out = []
    for done, candidate in enumerate(tried):
        progress("candidates", done, len(tried))
        drop: dict[str, float] = {}
        joined = _joined(found, candidate.view)
        if joined is not None:
            scene, tie_points = joined
            last = len(scene.views) - 1
            images = (*found.images, found.ground.image(scene.views, last))
            after, _ = stated_at(found, scene, images, tie_points, noise=noise, fitted=last)
            drop = {kind: drop_percent(base[kind], after[kind]) for kind in KINDS}
        out.append(Gain(candidate=candidate, drop_percent=drop, angles=view_angles(candidate.view, 0)))
    progress("candidates", len(tried), len(tried))
    return out


def drop_percent(before: np.ndarray, after: np.ndarray) -> float:
    """Drop of the mean of sigmas (J,) [%], over the landmarks that are measured before and after.

    Others have infinite sigmas. A landmark that only the new image measures is no change of a sigma.
    """
    both = np.isfinite(before) & np.isfinite(after)
    return float(100.0 * (1.0 - np.mean(after[both]) / np.mean(before[both])))


def ranked(found: Sequence[Gain], kind: str) -> list[Gain]:
    """Best first; those that show nothing of the map are left out."""
    return sorted((gain for gain in found if gain.drop_percent), key=lambda gain: -gain.drop_percent[kind])


def _middle(found: Forecast) -> Forecast:
    """The middle of the map and some of the tie points."""
    scene, points = found.scene, found.tie_points
    corner = np.array([scene.region.row, scene.region.col]) + 0.5 * (scene.region.width - MAP_PX)
    offset = scene.landmarks.pixel - corner
    chosen = np.flatnonzero(np.all((offset >= 0) & (offset < MAP_PX), axis=1))
    tracks, _ = scene.tracks.of_landmarks(chosen)
    cut = replace(scene, landmarks=scene.landmarks[chosen], tracks=tracks, uncertainty={})
    if points is not None and len(points.position) > TIE_POINTS:
        some = np.linspace(0, len(points.position) - 1, TIE_POINTS).astype(int)
        points = TiePoints(position=points.position[some], tracks=points.tracks.of_landmarks(some)[0])
    return replace(found, adjustment=replace(found.adjustment, scene=cut), tie_points=points)


def _joined(found: Forecast, whole: Views) -> tuple[Scene, TiePoints | None] | None:
    """The map with one more view, and the tie points likewise; None where its image does not show the map."""
    scene = found.scene
    half_side = 0.5 * scene.region.width * scene.gsd
    cut, shows = cropped_views(_exposed_like(scene, whole), half_side)
    if not shows[0]:
        return None
    views = join_views(scene.views, cut)
    other = scene.tracks.view != scene.reference
    sigma = float(np.median(scene.tracks.keypoint_sigma[other]))
    tracks = _with_view(scene.tracks, views, scene.landmarks.position, views, sigma)
    tie_points = found.tie_points
    if tie_points is not None:
        uncut = join_views(scene.views, whole)
        known = float(tie_points.tracks.keypoint_sigma[0])
        extended = _with_view(tie_points.tracks, uncut, tie_points.position, views, known)
        tie_points = TiePoints(position=tie_points.position, tracks=extended)
    joined = replace(scene, views=views, tracks=tracks, uncertainty={})
    return replace(joined, tracks=replace(tracks, keypoint=projected_keypoints(joined))), tie_points


def _exposed_like(scene: Scene, view: Views) -> Views:
    """The view with the mean scale and bias of the scene's."""
    return replace(view, scale=np.full(1, scene.views.scale.mean()), bias=np.full(1, scene.views.bias.mean()))


def _with_view(tracks: Tracks, seeing: Views, position: np.ndarray, views: Views, sigma: float) -> Tracks:
    """The tracks of points (J, 3) with those observations of the last view that `seeing` has within its image.

    views: those in whose pixels the keypoints are given.
    """
    last = len(views) - 1
    camera, pixel = seeing.cameras[last], seeing.project(last, position)
    depth = seeing.depth(last, position)
    seen = np.flatnonzero((depth > 0) & np.all((pixel > 0) & (pixel < (camera.width, camera.height)), axis=1))
    landmark = np.concatenate([tracks.landmark, seen])
    order = np.argsort(landmark, kind="stable")
    new = Tracks.of_keypoints(
        np.zeros(1, np.int64), np.full(len(seen), last, np.int32), views.project(last, position[seen]), sigma
    )
    names = ("view", "keypoint", "keypoint_sigma", "brightness", "lit")
    joined = {name: np.concatenate([getattr(tracks, name), getattr(new, name)])[order] for name in names}
    return Tracks(start=row_starts(np.bincount(landmark, minlength=len(position))), **joined)
