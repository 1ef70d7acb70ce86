"""Ground control points in a run: they place the map, take part in the joint estimate, and are compared with it."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from photoclinometry.adjust import GroundControl
from photoclinometry.matching.triangulation import triangulate_tracks
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.control import ControlPoint
from photoclinometry.model.geometry import align_similarity
from photoclinometry.model.scene import BODY_FIXED, Scene, Tracks, Views
from photoclinometry.model.warning import warn
from photoclinometry.registration.alignment import transform_scene

log = logging.getLogger(__name__)

MIN_POINTS = 3
"""Points that determine seven numbers of a frame: origin, orientation and scale."""

MIN_WIDTH = 1e-3
"""Points lie on a line if their extent across it is less than this share of that along it."""

CONTRADICTS = 5.0
"""A control point contradicts the others if the estimate is more than this many sigmas from its position or pixels."""


def ground_control(points: Sequence[ControlPoint], views: Views) -> GroundControl | None:
    """The points that were measured in some of the views; None without any."""
    index = {name: k for k, name in enumerate(views.name)}
    pixels = [[pixel for pixel in point.pixels if pixel.view in index] for point in points]
    seen = [(point, own) for point, own in zip(points, pixels, strict=True) if own]
    if not seen:
        return None
    every = [pixel for _, own in seen for pixel in own]
    return GroundControl(
        name=tuple(point.name for point, _ in seen),
        position=np.array([point.position for point, _ in seen]),
        sigma=np.array([point.sigma for point, _ in seen]),
        tracks=Tracks.of_keypoints(
            row_starts(np.array([len(own) for _, own in seen])),
            np.array([index[pixel.view] for pixel in every], np.int32),
            np.array([(pixel.x_px, pixel.y_px) for pixel in every]),
            np.array([pixel.sigma_px for pixel in every]),
        ),
    )


def place_by_control(scene: Scene, points: Sequence[ControlPoint]) -> Scene | None:
    """The scene moved by the similarity that brings its control points to where they are known, in metres.

    The points are triangulated from their pixels. None, with the reason in the log, where fewer than MIN_POINTS of them
    are seen in two views, or all lie on a line.
    """
    control = ground_control(points, scene.views)
    found = np.zeros((0, 3)) if control is None else triangulate_tracks(control.tracks, scene.views)
    fixed = np.isfinite(found).all(axis=1)
    if control is None or np.count_nonzero(fixed) < MIN_POINTS:
        warn(
            log,
            "control-too-few",
            "%d control points are seen in two registered views, at least %d are needed: the map stays in a frame of "
            "its own",
            np.count_nonzero(fixed),
            MIN_POINTS,
        )
        return None
    known = control.position[fixed]
    extent = np.linalg.svd(known - known.mean(0), compute_uv=False)
    if extent[1] < MIN_WIDTH * extent[0]:
        warn(log, "control-too-few", "the control points lie on a line: the map stays in a frame of its own")
        return None
    similarity = align_similarity(found[fixed], known)
    off = np.linalg.norm(similarity(found[fixed]) - known, axis=1)
    log.info("%d control points place the map, %.4g m off (RMS)", len(known), np.sqrt(np.mean(off**2)))
    return replace(transform_scene(similarity, scene), frame=BODY_FIXED)


def control_table(
    points: Sequence[ControlPoint], estimated: Mapping[str, np.ndarray], views: Views
) -> list[dict[str, Any]]:
    """One row per control point that was used: how far the estimate is from its known position and from its pixels.

    estimated: position (3,) by name, as `Adjustment.control`; views: as estimated. "off_sigmas" is the root mean square
    over the axes, "pixels_off_sigmas" that over its pixels.
    """
    rows = []
    for point in points:
        if point.name not in estimated:
            continue
        off = estimated[point.name] - point.position
        pixels = [pixel for pixel in point.pixels if pixel.view in views.name]
        seen = [views.project(views.name.index(p.view), estimated[point.name][None])[0] for p in pixels]
        missed = np.array([xy - (p.x_px, p.y_px) for xy, p in zip(seen, pixels, strict=True)])
        sigma = np.array([[p.sigma_px] for p in pixels])
        rows.append(
            {
                "name": point.name,
                "views": len(pixels),
                "off_m": float(np.linalg.norm(off)),
                "sigma_m": float(np.sqrt(np.mean(point.sigma**2))),
                "off_sigmas": float(np.sqrt(np.mean((off / point.sigma) ** 2))),
                "pixels_off_px": float(np.sqrt(np.mean(missed**2))),
                "pixels_off_sigmas": float(np.sqrt(np.mean((missed / sigma) ** 2))),
            }
        )
    return rows


def warn_of_contradictions(rows: Sequence[Mapping[str, Any]]) -> None:
    """Names control points in the log that the images or the other points contradict."""
    for row in rows:
        if max(row["off_sigmas"], row["pixels_off_sigmas"]) > CONTRADICTS:
            warn(
                log,
                "control-contradicts",
                "control point %s: the estimate is %.4g m from its position (%.3g sigmas) and %.3g px from its pixels "
                "(%.3g sigmas); check its pixels, its position and its sigma",
                *(row[key] for key in ("name", "off_m", "off_sigmas", "pixels_off_px", "pixels_off_sigmas")),
            )


def control_metrics(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Figures of `control_table`."""
    if not rows:
        return {}
    return {
        "control_points": float(len(rows)),
        "control_point_off_rms_m": float(np.sqrt(np.mean([row["off_m"] ** 2 for row in rows]))),
        "control_point_off_rms_sigmas": float(np.sqrt(np.mean([row["off_sigmas"] ** 2 for row in rows]))),
    }
