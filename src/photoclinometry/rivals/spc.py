"""Classic stereophotoclinometry (SPC): slopes, heights, landmarks and pointing by turns, until nothing moves.

Gaskell et al. (2008), Meteoritics & Planetary Science 43, doi:10.1111/j.1945-5100.2008.tb00692.x; section II of the
paper. One iteration, each step with the results of the others held:

1. Images are resampled on the surface. At each cell of the maplet, slopes and albedo are those of least squares on the
   brightness, with the slopes of the heights as prior: sum_k ((I_k - scale_k a rho(n, s_k, e_k) - bias_k) / sigma)^2.
2. Heights are those of least squares on the slopes, tied to control heights (`integrate.py`).
3. Each image is correlated with the relit maplet, in windows that overlap by half (`correlate.py`). A shift is where
   that window's landmark is seen in that image.
4. Landmarks follow from the shifts by triangulation; their changes of height are the control heights of the next
   iteration. The pointing of each camera follows from the landmarks, by least squares on its shifts. Camera centres are
   navigation's, which here is the run's.

The maplet has the reference image's grid, so that all methods are compared at the same points; Gaskell's is a grid on
a local plane. The first surface is the run's map as an earlier, coarser map would have it: smoothed to 16 px, without
its normals and albedos.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from photoclinometry.matching.triangulation import triangulate_tracks
from photoclinometry.model.geometry import Rigid, skew, so3_exp
from photoclinometry.model.image import Image
from photoclinometry.model.progress import Progress, no_progress
from photoclinometry.model.projection import project
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.scene import Scene, Tracks, Views
from photoclinometry.photometry.albedo import initial_albedo
from photoclinometry.photometry.predict import brightness_residuals, exposure_is_free, reflectance_of, shading
from photoclinometry.photometry.render import landmark_brightness
from photoclinometry.photometry.shading import brightness_on_surface, normals_from_shading
from photoclinometry.rivals.correlate import correlation_shifts
from photoclinometry.rivals.integrate import integrate_normals, surface_normals
from photoclinometry.rivals.outcome import Outcome, rendered_map
from photoclinometry.rivals.problem import Problem
from photoclinometry.surface.depth_fit import landmark_depth
from photoclinometry.surface.relief import reference_depth

log = logging.getLogger(__name__)

PRIOR_SPACING_PX = 16
"""Resolution of the first surface [px]: that of points of structure from motion."""
SHIFT_SIGMA_PX = 0.05
"""Standard deviation of a correlation's shift [px], the same for all views, so that it weighs none more."""
REACH = 2
"""Largest shift that is looked for [cells]: the run's poses are good to a tenth of a pixel."""
LEAST_CORRELATION = 0.6
"""Windows that correlate less are not matched [-]."""
TURN_REWEIGHTINGS = 3
"""Iterations of a camera's pointing, each with less weight on shifts that do not fit."""


@dataclass(frozen=True, kw_only=True)
class SpcOptions(Ranged):
    """Classic stereophotoclinometry."""

    iterations: Annotated[int, Range(least=1, most=1000)] = 20
    """Iterations at most."""
    window: Annotated[int, Range(least=5, most=201)] = 17
    """Cells across a window that is correlated, odd (even ones count as one more); windows overlap by half."""
    normal_sigma: Annotated[float, Range(above=0)] = 0.03
    """Standard deviation of a slope from brightness [rad], against that of control heights."""
    control_sigma: Annotated[float, Range(above=0)] = 0.2
    """Standard deviation of control heights [GSD]."""
    poses: Literal["estimated", "fixed"] = "estimated"
    """estimated: the pointing of all cameras but the reference's follows from the landmarks. fixed: the run's."""
    settled_gsd: Annotated[float, Range(above=0)] = 0.005
    """No further iteration once heights move by less, RMS [GSD]."""


def run_spc(problem: Problem, options: SpcOptions | None = None, progress: Progress = no_progress) -> Outcome:
    """The map and the predictions of classic stereophotoclinometry.

    `Outcome.history` has `residual_share` at the start and after each iteration. An iteration that would raise it is
    not taken, and is the last: errors of shifts then drive slow waves into the heights.
    """
    options = options or SpcOptions()
    images = list(problem.images[: problem.train])
    scene = _first(problem.scene, images)
    history = [residual_share(scene)]
    for n in range(options.iterations):
        progress("spc", n, options.iterations)
        moved = _iterate(scene, images, options)
        step, residual = _height_change(scene, moved), residual_share(moved)
        if residual >= history[-1]:
            break
        scene, history = moved, [*history, residual]
        log.info("spc: iteration %d: residual %.3f %%, heights moved %.4f GSD", n + 1, 100.0 * residual, step)
        if step < options.settled_gsd:
            break
    progress("spc", options.iterations, options.iterations)
    rendered, covered = rendered_map(problem, scene)
    return Outcome(
        name="spc", rendered=rendered, covered=covered, knows_light=True, scene=scene, history=tuple(history)
    )


def _first(scene: Scene, images: Sequence[Image]) -> Scene:
    """The map before the first iteration: heights smoothed, and slopes and albedos that follow from these."""
    own, camera = scene.views.body_from_cam[scene.reference], scene.views.cameras[scene.reference]
    smooth = landmark_depth(
        scene.landmarks.position, scene.landmarks.pixel, own, scene.region, camera, PRIOR_SPACING_PX
    )[scene.region.grid_slices]
    moved = _seen_everywhere(_with_depth(scene, smooth[scene.cells]))
    return _with_slopes(_with_albedo(brightness_on_surface(moved, images)))


def _iterate(scene: Scene, images: Sequence[Image], options: SpcOptions) -> Scene:
    """The map after one iteration."""
    landmark, keypoint, seen = _landmarks_seen(scene, options)
    turned = _pointed(scene, landmark, keypoint, seen) if options.poses == "estimated" else scene
    control = _control_depth(turned, landmark, keypoint, seen)
    moved = _seen_everywhere(_integrated(turned, landmark, control, options))
    return _with_slopes(brightness_on_surface(moved, images))


def _with_slopes(scene: Scene) -> Scene:
    """The map with the slopes and albedos of its brightness, and the exposures that follow from these."""
    return _with_exposure(normals_from_shading(scene))


def residual_share(scene: Scene) -> float:
    """RMS residual of lit brightness over its mean [-]."""
    lit = scene.tracks.lit
    rms = np.sqrt(np.mean(brightness_residuals(scene)[lit] ** 2))
    return float(rms / scene.tracks.brightness[lit].mean())


def _with_depth(scene: Scene, depth: np.ndarray) -> Scene:
    """The map with its landmarks at depths (J,) on the reference's rays, and the normals of that surface."""
    pose, camera = scene.views.body_from_cam[scene.reference], scene.views.cameras[scene.reference]
    ray = camera.ray_in_cam(scene.landmarks.pixel[:, ::-1] + 0.5)
    position = pose(ray * depth[:, None])
    normal = surface_normals(scene.grid(position), pose.translation)[scene.cells]
    known = np.array(np.isfinite(normal).all(-1))
    normal = np.where(known[:, None], normal, scene.landmarks.normal)
    return replace(scene, landmarks=replace(scene.landmarks, position=position, normal=normal))


def _seen_everywhere(scene: Scene) -> Scene:
    """The map with an observation of every landmark in every view whose frame it projects into, without brightness."""
    views, position = scene.views, scene.landmarks.position
    xy = np.stack([views.project(k, position) for k in range(len(views))], 1)
    size = np.array([(camera.width, camera.height) for camera in views.cameras])
    inside = ((xy >= 0.5) & (xy <= size - 0.5)).all(-1)
    start = np.r_[0, np.cumsum(inside.sum(1))].astype(np.int64)
    view = np.nonzero(inside)[1].astype(np.int32)
    return replace(scene, tracks=Tracks.of_keypoints(start, view, xy[inside], SHIFT_SIGMA_PX))


def _with_albedo(scene: Scene) -> Scene:
    """The map with the mean albedo of its brightness; scales of uncalibrated images start from their medians."""
    reflectance = reflectance_of(scene)
    albedo, scale, _ = initial_albedo(
        scene.landmarks.position,
        scene.landmarks.normal,
        scene.tracks,
        scene.views,
        reflectance,
        scene.reference,
        estimate_scale=exposure_is_free(scene.brightness, reflectance),
    )
    return replace(scene, landmarks=replace(scene.landmarks, albedo=albedo), views=replace(scene.views, scale=scale))


def _with_exposure(scene: Scene) -> Scene:
    """The map with the scale of each view by least squares on its lit brightness; uncalibrated ones with a bias, too.

    The reference's are held, since albedos have the same factor.
    """
    views, tracks = scene.views, scene.tracks
    rho = shading(
        tracks.landmark, tracks.view, views, scene.landmarks.position, scene.landmarks.normal, reflectance_of(scene)
    )[2]
    model = scene.landmarks.albedo[tracks.landmark] * rho
    scale, bias = views.scale.copy(), views.bias.copy()
    for k in range(len(views)):
        own = (tracks.view == k) & tracks.lit
        if k == scene.reference or np.count_nonzero(own) < 2:
            continue
        if scene.brightness == "dn":
            scale[k], bias[k] = np.polyfit(model[own], tracks.brightness[own], 1)
        else:
            scale[k] = model[own] @ (tracks.brightness[own] - bias[k]) / (model[own] @ model[own])
    return replace(scene, views=replace(views, scale=scale, bias=bias))


def _landmarks_seen(scene: Scene, options: SpcOptions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Maplets' landmarks (M,) as indices of the map's, their pixels (M, K, 2) by correlation, and (M, K) bool."""
    height, width = scene.region.grid_shape
    half = options.window // 2
    index = scene.grid(np.arange(len(scene.landmarks)), fill=-1).astype(int)
    rows, cols = (np.arange(min(half, size // 2), size - min(half, size // 2 - 1), half) for size in (height, width))
    chosen = index[np.ix_(rows, cols)].ravel()
    chosen = chosen[chosen >= 0]
    cell = np.stack(scene.cells, -1)[chosen]
    count = len(scene.views)
    keypoint, seen = np.zeros((len(chosen), count, 2)), np.zeros((len(chosen), count), bool)
    for k in range(count):
        own = scene.tracks.view == k
        measured, relit = np.full((2, len(scene.landmarks)), np.nan)
        lit = own & scene.tracks.lit
        measured[scene.tracks.landmark[lit]] = scene.tracks.brightness[lit]
        relit[:] = landmark_brightness(scene, k)
        shift, seen[:, k] = correlation_shifts(
            scene.grid(relit), scene.grid(measured), cell, options.window | 1, REACH, LEAST_CORRELATION
        )
        xy = scene.grid(scene.views.project(k, scene.landmarks.position))
        keypoint[:, k] = xy[cell[:, 0], cell[:, 1]] + _pixels_of(shift, xy, cell, options.window)
    return chosen, keypoint, seen


def _pixels_of(shift: np.ndarray, xy: np.ndarray, cell: np.ndarray, window: int) -> np.ndarray:
    """Shifts (n, 2) of cells as shifts (n, 2) [px] of a view that sees the cells at pixels (h, w, 2)."""
    row, col = cell.T
    half, out = window // 2, np.zeros((len(cell), 2))
    by_row, by_col = np.gradient(xy, axis=(0, 1))
    for n in range(len(cell)):
        around = np.s_[max(row[n] - half, 0) : row[n] + half + 1, max(col[n] - half, 0) : col[n] + half + 1]
        out[n] = shift[n, 0] * np.nanmean(by_row[around], (0, 1)) + shift[n, 1] * np.nanmean(by_col[around], (0, 1))
    return out


def _control_depth(scene: Scene, landmark: np.ndarray, keypoint: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(M,) reference depths of the landmarks triangulated from their pixels; NaN of those that two views do not see."""
    start = np.r_[0, np.cumsum(seen.sum(1))].astype(np.int64)
    view = np.nonzero(seen)[1].astype(np.int32)
    tracks = Tracks.of_keypoints(start, view, keypoint[seen], SHIFT_SIGMA_PX)
    position = np.full((len(landmark), 3), np.nan)
    several = seen.sum(1) >= 2
    position[several] = triangulate_tracks(tracks, scene.views)[several]
    return scene.views.depth(scene.reference, position)


def _integrated(scene: Scene, landmark: np.ndarray, control: np.ndarray, options: SpcOptions) -> Scene:
    """The map with the heights of its slopes and of the landmarks at `control` depths (M,)."""
    pose, camera = scene.views.body_from_cam[scene.reference], scene.views.cameras[scene.reference]
    known = np.isfinite(control)
    if not known.any():
        return scene
    ray = camera.ray_in_cam(scene.landmarks.pixel[:, ::-1] + 0.5)
    depth = integrate_normals(
        scene.grid(ray),
        scene.grid(scene.landmarks.normal @ pose.rotation),
        scene.spacing,
        options.normal_sigma,
        np.stack(scene.cells, -1)[landmark[known]],
        control[known],
        options.control_sigma * scene.gsd,
    )[scene.cells]
    before = reference_depth(scene)
    return _with_depth(scene, np.where(np.isfinite(depth), depth, before))


def _pointed(scene: Scene, landmark: np.ndarray, keypoint: np.ndarray, seen: np.ndarray) -> Scene:
    """The map with all cameras but the reference's turned about their centres to see the landmarks at their pixels."""
    views, rotation = scene.views, scene.views.body_from_cam.rotation.copy()
    for k in range(len(views)):
        if k != scene.reference and np.count_nonzero(seen[:, k]) >= 3:
            rotation[k] = _turned(views, k, scene.landmarks.position[landmark[seen[:, k]]], keypoint[seen[:, k], k])
    moved = Rigid(rotation, views.body_from_cam.translation)
    # The Suns are the run's, in the body's frame.
    return replace(scene, views=replace(views, body_from_cam=moved))


def _turned(views: Views, k: int, position: np.ndarray, keypoint: np.ndarray) -> np.ndarray:
    """body_from_cam rotation (3, 3) of a view that sees points (n, 3) at pixels (n, 2), from its own; reweighted."""
    camera, pose = views.cameras[k], views.body_from_cam[k]
    weight, rotation = np.ones(len(position)), pose.rotation
    for _ in range(TURN_REWEIGHTINGS):
        pixel, by_position = project(rotation, pose.translation, camera.intrinsics, position)
        residual = pixel - keypoint
        # A turn w of the camera, R exp(w), moves the points in its frame by p x w.
        point = Rigid(rotation, pose.translation).inverse()(position)
        by_turn = by_position @ rotation @ skew(point)
        system = (by_turn * weight[:, None, None]).reshape(-1, 3)
        step = np.linalg.lstsq(system, -(residual * weight[:, None]).ravel(), rcond=1e-9)[0]
        rotation = rotation @ so3_exp(step)
        size = np.linalg.norm(residual + by_turn @ step, axis=-1)
        weight = 1.0 / np.hypot(1.0, size / max(float(np.median(size)), 1e-9))
    return rotation


def _height_change(before: Scene, after: Scene) -> float:
    """RMS distance of the landmarks [GSD]."""
    off = after.landmarks.position - before.landmarks.position
    return float(np.sqrt(np.mean(np.sum(off**2, -1))) / before.gsd)
