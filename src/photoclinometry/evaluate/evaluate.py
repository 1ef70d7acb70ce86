"""How well a scene explains its images: Eqs. 39 and 40, keypoint residuals, completeness.

Figures are numbers in a flat dictionary whose keys end in the unit. Comparisons with the truth or another map are in
`compare.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from photoclinometry.evaluate.diagnosis import albedo_shading_correlation, view_diagnosis
from photoclinometry.evaluate.illumination import light_spans_deg
from photoclinometry.evaluate.metrics import photometric_error, psnr, spread
from photoclinometry.evaluate.sigmas import view_sigmas
from photoclinometry.evaluate.unreliable import known_sigmas, unreliable_counts
from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.projection import (
    keypoint_residuals,
)
from photoclinometry.model.scene import Scene, Views, join_views
from photoclinometry.model.threads import in_threads
from photoclinometry.photometry.predict import (
    brightness_residuals,
    observation_brightness,
)
from photoclinometry.photometry.render import draw_landmarks, render_view

SHADOW_FRACTION = 0.1
"""A reference pixel darker than this share of the region's median brightness is taken for shadow."""
_LIT_WEIGHT = 0.999
"""A pixel is lit if all landmarks around it are: interpolation of 0 and 1 stays above this, up to rounding."""


def landmark_photometric_error(scene: Scene, *, remove_scale_and_bias: bool = False) -> np.ndarray:
    """Eq. 39 (J,) over the lit observations, dimensionless; NaN without any.

    With `remove_scale_and_bias`, predicted and measured brightness are both converted to albedo * rho. An unknown
    bias of an uncalibrated image then does not change the mean by which the error is divided.
    """
    tracks, views = scene.tracks, scene.views
    predicted, measured = observation_brightness(scene), tracks.brightness
    if remove_scale_and_bias:
        scale, bias = views.scale[tracks.view], views.bias[tracks.view]
        predicted, measured = (predicted - bias) / scale, (measured - bias) / scale
    lit = tracks.lit
    return photometric_error(predicted[lit], measured[lit], tracks.landmark[lit], len(scene.landmarks))


def keypoint_residual_px(scene: Scene) -> np.ndarray:
    """(N,) distances [px] between measured keypoints and projected landmarks."""
    return np.linalg.norm(keypoint_residuals(scene), axis=-1)


def view_psnr(scene: Scene, view: int, image: Image, faces: np.ndarray | None = None) -> dict[str, float]:
    """PSNR (Eq. 40) of a view's rendering against its image, in camera geometry.

    psnr_db: over all valid pixels that the map covers, cast shadows included. psnr_lit_db: over those of them between
    landmarks that are lit in this view, so without cast shadows. The peak is the image's greatest valid brightness.
    NaN if there is no such pixel.
    """
    faces = landmark_faces(scene) if faces is None else faces
    rendered, mask = render_view(scene, view, faces=faces, cast_shadows=True)
    mask &= image.valid
    if not image.valid.any():
        return {"psnr_db": float("nan"), "psnr_lit_db": float("nan")}
    peak = float(image.brightness[image.valid].max())
    tracks = scene.tracks
    measured = np.zeros(len(scene.landmarks))
    measured[tracks.landmark[(tracks.view == view) & tracks.lit]] = 1.0
    lit = mask & (draw_landmarks(scene, view, measured, faces)[0] > _LIT_WEIGHT)
    brightness = image.brightness.astype(float)
    return {
        "psnr_db": psnr(brightness, rendered, mask, peak),
        "psnr_lit_db": psnr(brightness, rendered, lit, peak),
    }


def lit_region(scene: Scene, image: Image, threshold: float | None = None) -> np.ndarray:
    """(h, w) bool: pixels of the map's grid that are valid and brighter than `threshold` in the reference image.

    threshold: in the image's unit; default: SHADOW_FRACTION of the median over the region's valid pixels.
    """
    grid = scene.region.grid_slices
    brightness, valid = image.brightness[scene.region.slices][grid], image.valid[scene.region.slices][grid]
    if threshold is None:
        threshold = SHADOW_FRACTION * float(np.median(brightness[valid])) if valid.any() else 0.0
    return valid & (brightness > threshold)


def completeness(scene: Scene, lit: np.ndarray) -> float:
    """Share of the lit pixels (h, w) of the map's grid that carry a landmark; NaN if none is lit."""
    has = np.isfinite(scene.grid(np.zeros(len(scene.landmarks))))
    return float(has[lit].mean()) if lit.any() else float("nan")


def view_table(scene: Scene, images: Sequence[Image] | None = None) -> list[dict[str, Any]]:
    """One row per view: name, keypoints, residuals, brightness residual [% of its mean], scale, bias, PSNR, sigmas, and
    as `view_diagnosis`.

    images: the views' images in any order; without them, or without a reflectance model, there is no PSNR.
    """
    by_name = _by_name(scene, images)
    tracks, views = scene.tracks, scene.views
    pixel_residual = keypoint_residual_px(scene)
    faces = landmark_faces(scene)
    residual = None if scene.reflectance is None else brightness_residuals(scene)
    sigmas, geometry = view_sigmas(scene), view_diagnosis(scene)

    def of_view(k: int) -> dict[str, Any]:
        name, seen = views.name[k], tracks.view == k
        lit = seen & tracks.lit
        row: dict[str, Any] = {"name": name, "keypoints": int(seen.sum()), "lit_keypoints": int(lit.sum())}
        if seen.any():
            row["keypoint_rms_px"] = _rms(pixel_residual[seen])
        if residual is not None:
            row |= _exposure(scene, views, k)
            if lit.any():
                row["brightness_rms_percent"] = 100.0 * _rms(residual[lit]) / float(tracks.brightness[lit].mean())
            if name in by_name:
                row |= {key: v for key, v in view_psnr(scene, k, by_name[name], faces).items() if np.isfinite(v)}
        return row | geometry[k] | {key: float(values[k]) for key, values in sigmas.items()}

    return in_threads(of_view, range(len(views)))


def held_out_table(scene: Scene, held_out: Views, images: Sequence[Image] | None = None) -> list[dict[str, Any]]:
    """One row per view held out of the scene: name, held_out, scale, bias, PSNR (Eq. 40).

    held_out: views with poses in the scene's frame; images: theirs, among others and in any order.
    """
    joined = replace(scene, views=join_views(scene.views, held_out))
    by_name = _by_name(joined, images)
    faces = landmark_faces(scene)
    rows = []
    for k, name in enumerate(held_out.name):
        row: dict[str, Any] = {"name": name, "held_out": True}
        if scene.reflectance is not None:
            row |= _exposure(scene, held_out, k)
            if name in by_name:
                quality = view_psnr(joined, len(scene.views) + k, by_name[name], faces)["psnr_db"]
                row |= {"psnr_db": quality} if np.isfinite(quality) else {}
        rows.append(row)
    return rows


def _exposure(scene: Scene, views: Views, k: int) -> dict[str, float]:
    """Scale and bias of a view, and of an uncalibrated one the dark level that had been taken from its brightness."""
    row = {"scale": float(views.scale[k]), "bias": float(views.bias[k])}
    return row if scene.brightness == "iof" else row | {"dark_level": float(views.dark_level[k])}


def evaluate_scene(
    scene: Scene,
    images: Sequence[Image] | None = None,
    *,
    per_view: Sequence[Mapping[str, Any]] | None = None,
    held_out: Sequence[Mapping[str, Any]] = (),
) -> dict[str, float]:
    """The figures of a scene that need no truth.

    per_view: the result of `view_table(scene, images)`, if it was computed already. held_out: the result of
    `held_out_table`, for the figures of held-out views.
    """
    rows = view_table(scene, images) if per_view is None else per_view
    tracks = scene.tracks
    metrics: dict[str, float] = {
        "views": len(scene.views),
        "landmarks": len(scene.landmarks),
        "observations": len(tracks),
        "observations_per_landmark_mean": len(tracks) / max(1, len(scene.landmarks)),
        "gsd_m" if scene.unit == "m" else "gsd_in_scene_unit": scene.gsd,
        **spread(keypoint_residual_px(scene), "keypoint_residual", "px"),
    }
    if scene.reflectance is not None:
        percent = 100.0 * landmark_photometric_error(scene)
        metrics |= spread(percent, "photometric_error", "percent")
        percent = 100.0 * landmark_photometric_error(scene, remove_scale_and_bias=True)
        metrics |= spread(percent, "photometric_error_without_scale_and_bias", "percent")
    metrics |= unreliable_counts(scene) | light_spans_deg(scene)
    correlation = albedo_shading_correlation(scene)
    if correlation is not None:
        metrics["albedo_shading_correlation"] = correlation
    for name, values in known_sigmas(scene).items():
        quantity, unit = name.rsplit("_", 1)
        metrics |= spread(values, quantity, unit)
    if held_out:
        metrics["views_held_out"] = len(held_out)
    for name, key, table in (
        ("psnr", "psnr_db", rows),
        ("psnr_lit", "psnr_lit_db", rows),
        ("psnr_held_out", "psnr_db", held_out),
    ):
        values = [row[key] for row in table if key in row]
        if values:
            metrics |= {f"{name}_mean_db": float(np.mean(values)), f"{name}_min_db": float(np.min(values))}
    reference = _by_name(scene, images).get(scene.views.name[scene.reference])
    if reference is not None:
        metrics["completeness_percent"] = 100.0 * completeness(scene, lit_region(scene, reference))
    return metrics


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _by_name(scene: Scene, images: Sequence[Image] | None) -> dict[str, Image]:
    """The images by name, checked against the cameras."""
    found = {image.name: image for image in images or ()}
    for name, camera in zip(scene.views.name, scene.views.cameras, strict=True):
        if name in found and found[name].brightness.shape != (camera.height, camera.width):
            height, width = found[name].brightness.shape
            raise InputError(
                f"{name}: the image has {width} x {height} pixels, the scene's camera "
                f"{camera.width} x {camera.height}; is this the run of another site?"
            )
    return found
