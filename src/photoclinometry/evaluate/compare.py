"""Comparison of a scene with the truth of a simulation, or with another map (Eqs. 36-38)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from photoclinometry.evaluate.evaluate import completeness
from photoclinometry.evaluate.metrics import (
    albedo_error,
    albedo_factor,
    along_and_sideways,
    landmark_error,
    normal_error,
    spread,
)
from photoclinometry.evaluate.pose_errors import frame_metrics, pose_metrics
from photoclinometry.evaluate.sigma_calibration import sigma_metrics
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, angle_between, so3_log
from photoclinometry.model.projection import keypoint_residuals
from photoclinometry.model.scene import BODY_FIXED, Landmarks, Scene, Views
from photoclinometry.photometry.predict import exposure_is_free
from photoclinometry.registration.alignment import (
    Closest,
    align_poses,
    camera_distance,
    refine_on_surface,
    transform_scene,
)
from photoclinometry.registration.closest_points import CloudSurface, MeshSurface
from photoclinometry.surface.closed_mesh import area_vectors

if TYPE_CHECKING:
    from photoclinometry.io.meshes.ply import PlyMap
    from photoclinometry.simulate.truth import Truth

Errors = dict[str, np.ndarray]
"""(J,) by name, units at the end of the name; NaN where there is nothing to compare with."""


@dataclass(frozen=True)
class Comparison:
    """The figures of a comparison, and the errors of every landmark, to draw maps of."""

    metrics: dict[str, float]
    aligned: Scene
    """The scene in the reference's frame and unit."""
    errors: dict[str, np.ndarray]
    """(J,) by name, which ends in the unit; NaN where the reference has no value."""
    similarity: Similarity
    """reference_from_scene, the alignment."""


def evaluate_against_truth(scene: Scene, truth: Truth) -> Comparison:
    """Compare with the exact surface, poses and Suns of a simulated site. Raises InputError.

    The scene is aligned by its cameras' poses, then to the true surface. Positions are compared in three ways: with
    the nearest point of the surface (`surface_distance`); with the nearest of the true points behind the reference
    pixels, as if these were another map (Eq. 36, `landmark_error`); and with the true point behind the landmark's
    pixel (`position_error`), which also shows a shift of the map along the ground: its parts are along the true normal
    there (`position_error_along_normal`), the error of the surface, and `position_error_sideways`. Normals and albedos
    are compared at the landmark's reference pixel: averaged over point-spread function and pixel, the resolution of the
    images, and at the point (`_at_point`).
    """
    from photoclinometry.simulate.truth import nearest_surface, truth_maps

    index = view_indices(scene.views.name, truth.views.name)
    if len(index) < len(scene.views):
        raise InputError(f"the truth has {len(index)} of the scene's {len(scene.views)} views; is it another site's?")

    x_min, x_max, y_min, y_max = truth.surface.extent

    def closest(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _, foot = nearest_surface(truth.surface, points)
        x, y = foot[:, 0], foot[:, 1]
        return foot, (x > x_min) & (x < x_max) & (y > y_min) & (y < y_max)

    maps = truth_maps(truth, scene.views.name[scene.reference], scene.region)
    true_views = truth.views[[index[k] for k in range(len(scene.views))]]
    found = compare_with_truth(scene, true_views, maps, closest)
    lit = maps.hit & (maps.shadow < 0.5)
    found.metrics["completeness_truly_lit_percent"] = 100.0 * completeness(scene, lit)
    return found


FAR_GSD = 10.0
"""A map that the alignment by poses puts farther from the true ground than this is first moved there [GSD]: nearest
points are not found from such a distance. Small errors of poses of narrow-angle cameras at a distance of ten thousand
GSD have this effect."""


def _near(by_poses: Similarity, scene: Scene, true: np.ndarray, seen: np.ndarray) -> Similarity:
    """The alignment, moved where it leaves the landmarks far from the true points (J, 3) behind their pixels."""
    off = np.median((by_poses(scene.landmarks.position) - true)[seen], axis=0)
    if not seen.any() or np.linalg.norm(off) <= FAR_GSD * by_poses.scale * scene.gsd:
        return by_poses
    return replace(by_poses, translation=by_poses.translation - off)


def compare_with_truth(scene: Scene, true_views: Views, maps: Any, closest: Closest) -> Comparison:
    """As `evaluate_against_truth`, given the truth as views, maps and a function.

    true_views: the scene's views in the same order; maps: arrays over the map's grid with the attributes of
    `simulate.truth.TruthMaps`; closest: nearest points of the true surface. Lengths in metres.
    """
    cells = scene.cells
    seen = maps.hit[cells]
    by_poses = align_poses(scene.views.body_from_cam, true_views.body_from_cam, distance=camera_distance(scene))
    start = _near(by_poses, scene, maps.position[cells], seen)
    fit = refine_on_surface(scene.landmarks.position, scene.landmarks.normal, closest, start)
    aligned = transform_scene(fit.similarity, scene)

    def at(values: np.ndarray) -> np.ndarray:
        """A true map (h, w, ...) at the landmarks' reference pixels; NaN where the pixel's ray misses the surface."""
        picked = np.array(values[cells], float)
        picked[~seen] = np.nan
        return picked

    true = Landmarks(
        position=at(maps.position),
        normal=at(maps.normal_mean),
        albedo=at(maps.albedo_mean),
        pixel=scene.landmarks.pixel,
    )
    off, true_normal = aligned.landmarks.position - true.position, at(maps.normal)
    along, sideways = along_and_sideways(off, true_normal)
    errors = {
        "surface_distance_m": fit.distance,
        "landmark_error_m": landmark_error(aligned.landmarks.position, maps.position[maps.hit]),
        "position_error_m": np.linalg.norm(off, axis=-1),
        "position_error_along_normal_m": along,
        "position_error_sideways_m": sideways,
        "normal_error_deg": np.degrees(normal_error(aligned.landmarks.normal, true.normal)),
        "normal_error_at_point_deg": np.degrees(normal_error(aligned.landmarks.normal, true_normal)),
    }
    metrics = _spreads(errors)
    for key in (key.removesuffix("_m") for key in errors if key.endswith("_m")):
        metrics |= spread(errors[f"{key}_m"] / aligned.gsd, key, "gsd")
    metrics |= _alignment_metrics(by_poses, fit.similarity, fit.determined, aligned)
    if scene.frame == BODY_FIXED:
        metrics |= frame_metrics(by_poses, scene.landmarks.position, true.position)
    metrics |= pose_metrics(scene.views.body_from_cam, true_views.body_from_cam, by_poses, "m")
    metrics |= spread(np.degrees(angle_between(aligned.views.sun, true_views.sun)), "sun_error", "deg")
    metrics |= spread(_keypoint_error(scene, true_views, true.position), "keypoint_error", "px")
    factor = 1.0
    if scene.reflectance is not None:
        found, extra = _photometry_metrics(scene, true_views, true.albedo, at(maps.albedo))
        errors, metrics = errors | found, metrics | extra
        if exposure_is_free(scene.brightness, scene.reflectance):
            factor = extra["albedo_factor"]
    metrics |= sigma_metrics(scene, true_views, true, factor)
    return Comparison(metrics, aligned, errors, fit.similarity)


def evaluate_against_map(
    scene: Scene,
    reference: PlyMap,
    *,
    names: Sequence[str] | None = None,
    body_from_cam: Rigid | None = None,
    initial: Similarity | None = None,
    unit: str = "m",
) -> Comparison:
    """Compare with another map, after alignment by camera poses (or `initial`) and to its surface.

    names, body_from_cam: (K') views with poses in the map's frame, matched with the scene's by name (or by file name).
    Without poses and `initial`, the scene must roughly be in the map's frame and unit. unit: the map's, for the names
    of the figures. `landmark_error` (Eq. 36) is dominated by the spacing of a coarse map; `surface_distance` is not.
    Raises InputError.
    """
    by_poses, metrics = initial or Similarity(1.0, np.eye(3), np.zeros(3)), {}
    if names is not None and body_from_cam is not None:
        index = view_indices(scene.views.name, names)
        if len(index) < 2:
            raise InputError(
                f"{len(index)} views are among the {len(names)} reference poses by name, 2 are needed: "
                f"the scene has {scene.views.name[0]}, the reference {names[0] if names else 'none'}"
            )
        ours, theirs = scene.views.body_from_cam[list(index)], body_from_cam[list(index.values())]
        by_poses = align_poses(ours, theirs, distance=camera_distance(scene))
        metrics = pose_metrics(ours, theirs, by_poses, unit)
    normals = _vertex_normals(reference) if reference.normal is None else reference.normal
    if reference.faces is not None and len(reference.faces):
        surface: MeshSurface | CloudSurface = MeshSurface(reference.position, reference.faces)
    else:
        surface = CloudSurface(reference.position, normals)
    fit = refine_on_surface(scene.landmarks.position, scene.landmarks.normal, surface, by_poses)
    aligned = transform_scene(fit.similarity, scene)
    distance, nearest = surface.tree.query(aligned.landmarks.position)
    inside = np.isfinite(fit.distance)
    errors = {
        f"surface_distance_{unit}": fit.distance,
        f"landmark_error_{unit}": np.where(inside, distance, np.nan),
    }
    if normals is not None:
        angle = np.degrees(normal_error(aligned.landmarks.normal, normals[nearest]))
        errors["normal_error_deg"] = np.where(inside, angle, np.nan)
    metrics |= _spreads(errors) | {"overlap_percent": 100.0 * float(inside.mean())}
    for key in ("surface_distance", "landmark_error"):
        metrics |= spread(errors[f"{key}_{unit}"] / aligned.gsd, key, "gsd")
    metrics |= _alignment_metrics(by_poses, fit.similarity, fit.determined, aligned)
    if reference.albedo is not None and scene.reflectance is not None:
        theirs = np.where(inside, reference.albedo[nearest], np.nan)
        found, extra = _albedo_metrics(scene, theirs, "albedo_error")
        errors, metrics = errors | found, metrics | extra
    return Comparison(metrics, aligned, errors, fit.similarity)


def _spreads(errors: dict[str, np.ndarray]) -> dict[str, float]:
    """`spread` of every entry; the last word of its name is the unit."""
    metrics: dict[str, float] = {}
    for key, values in errors.items():
        name, _, unit = key.rpartition("_")
        metrics |= spread(values, name, unit)
    return metrics


def _alignment_metrics(
    by_poses: Similarity, by_surface: Similarity, determined: int, aligned: Scene
) -> dict[str, float]:
    """The alignment by poses, its change by the alignment to the surface, and the ground sample distance."""
    turn = np.linalg.norm(so3_log(by_surface.rotation @ by_poses.rotation.T))
    return {
        "alignment_scale": by_surface.scale,
        "alignment_scale_change_percent": 100.0 * (by_surface.scale / by_poses.scale - 1.0),
        "alignment_rotation_change_deg": float(np.degrees(turn)),
        "alignment_directions_determined": determined,
        "gsd_in_reference_unit": aligned.gsd,
    }


def _albedo_metrics(scene: Scene, reference: np.ndarray, name: str) -> tuple[Errors, dict[str, float]]:
    """Eq. 38 [%] after the best common factor; of calibrated scenes also without a factor (`_absolute`)."""
    albedo = scene.landmarks.albedo
    factor = albedo_factor(albedo, reference)
    errors = {f"{name}_percent": 100.0 * albedo_error(albedo, reference, factor)}
    metrics = {name.replace("error", "factor"): factor}
    if scene.brightness == "iof":
        errors[f"{name}_absolute_percent"] = 100.0 * albedo_error(albedo, reference)
    return errors, metrics | _spreads(errors)


def _photometry_metrics(
    scene: Scene, true_views: Views, albedo: np.ndarray, at_point: np.ndarray
) -> tuple[Errors, dict[str, float]]:
    """Errors and figures of albedos, scales, biases. albedo, at_point: (J,) true, averaged over the pixel and not."""
    errors, metrics = _albedo_metrics(scene, albedo, "albedo_error")
    found, extra = _albedo_metrics(scene, at_point, "albedo_error_at_point")
    factor = metrics["albedo_factor"]  # albedo * factor = truth, so scale / factor = truth
    off = scene.views.scale / factor / true_views.scale - 1.0
    metrics |= extra | spread(100.0 * off, "scale_error", "percent")
    off = (scene.views.offset - true_views.offset) / scene.tracks.brightness[scene.tracks.lit].mean()
    return errors | found, metrics | spread(100.0 * off, "bias_error", "percent_of_brightness")


def _keypoint_error(scene: Scene, true_views: Views, true_position: np.ndarray) -> np.ndarray:
    """(N,) distances [px] of keypoints from where the true point of the reference pixel projects; NaN in the
    reference view, where they are exact by construction."""
    truth = scene.with_estimate(true_views, replace(scene.landmarks, position=true_position))
    error = np.linalg.norm(keypoint_residuals(truth), axis=-1)
    error[scene.tracks.view == scene.reference] = np.nan
    return error


def view_indices(ours: Sequence[str], theirs: Sequence[str]) -> dict[int, int]:
    """Index in `theirs` by index in `ours`: equal names, or else equal file names where those are unique."""
    full = {name: k for k, name in enumerate(theirs)}
    found = {k: full[name] for k, name in enumerate(ours) if name in full}
    if found:
        return found
    short = {name.rsplit("/", 1)[-1]: k for k, name in enumerate(theirs)}
    ours_short = [name.rsplit("/", 1)[-1] for name in ours]
    if len(short) < len(theirs) or len(set(ours_short)) < len(ours_short):
        return {}
    return {k: short[name] for k, name in enumerate(ours_short) if name in short}


def _vertex_normals(reference: PlyMap) -> np.ndarray | None:
    """Area-weighted normals (n, 3) of a mesh's vertices, of any length; None for a cloud of points.

    Faces turn counter-clockwise seen from outside. NaN at vertices without faces.
    """
    if reference.faces is None or not len(reference.faces):
        return None
    face_normal = area_vectors(reference.position, reference.faces)
    total = np.zeros_like(reference.position)
    for k in range(3):
        np.add.at(total, reference.faces[:, k], face_normal)
    total[~total.any(-1)] = np.nan
    return total
