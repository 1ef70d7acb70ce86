"""Ground control points in a run: they place the map, take part in the joint estimate, and are compared with it."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from photoclinometry.adjust import GroundControl
from photoclinometry.matching.triangulation import triangulate_tracks
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.control import ControlPoint
from photoclinometry.model.geometry import align_similarity
from photoclinometry.model.robust import SIGNIFICANT
from photoclinometry.model.scene import BODY_FIXED, Scene, Tracks, Views
from photoclinometry.model.tiny import TINY
from photoclinometry.model.warning import warn
from photoclinometry.registration.alignment import transform_scene

log = logging.getLogger(__name__)

MIN_POINTS = 3
"""Points that determine seven numbers of a frame: origin, orientation and scale."""

MIN_WIDTH = 1e-3
"""Points lie on a line if their extent across it is less than this share of that along it."""

FRAME_NUMBERS, FEWEST_FREE = 7, 5
"""Numbers of a similarity; and the fewest measurements that the others must have beyond them before one point is told
from them: four points. Of three the F test asks for residuals of thousands of times the scatter, which is that of two
numbers."""

ONE_IN = 1e-3
"""Probability, for all points of a table together, that a sound one is left out."""


@dataclass(frozen=True, kw_only=True)
class ControlRow:
    """How far the estimate of a control point is from its known position and from its pixels."""

    name: str
    """The point's."""
    used: bool
    """Whether it took part in the estimate; one that did not is triangulated."""
    views: int
    """Those of the map in which it was measured."""
    off_m: float
    """Distance from its known position."""
    sigma_m: float
    """Of that position: root mean square over the axes."""
    off_sigmas: float
    """Root mean square over the axes."""
    pixels_off_px: float
    """From where it was measured: root mean square over both axes of its pixels."""
    pixels_off_sigmas: float
    """Likewise."""


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


def agreeing_points(points: Sequence[ControlPoint], views: Views) -> tuple[ControlPoint, ...]:
    """The points without those that contradict the others, as the views see them.

    Points are triangulated from their pixels, and a similarity is fitted from there to where they are known. A point is
    left out if the others then fit better by far more than chance makes it (an F test of its three residuals), and if
    it is more than SIGNIFICANT of its sigmas from where these put it. The worst goes first. The measure is the scatter
    of the others, so that neither the errors of pixels nor those of the poses need be known. Of fewer than five points
    none can be told.
    """
    control = ground_control(points, views)
    if control is None:
        return tuple(points)
    found, known = triangulate_tracks(control.tracks, views), control.position
    sigma = np.sqrt(np.mean(control.sigma**2, axis=1))
    seen = np.asarray(np.isfinite(found).all(axis=1))
    used = seen.copy()
    while (worst := _worst(found, known, sigma, used)) is not None:
        used[worst] = False
    wrong = {control.name[n] for n in np.flatnonzero(seen & ~used)}
    return tuple(point for point in points if point.name not in wrong)


def _worst(found: np.ndarray, known: np.ndarray, sigma: np.ndarray, used: np.ndarray) -> int | None:
    """Of points found at (n, 3) and known to be at (n, 3) that which contradicts the others most; None where none
    does."""
    freedom = 3 * (np.count_nonzero(used) - 1) - FRAME_NUMBERS
    if freedom < FEWEST_FREE:
        return None
    whole = _misfit(found, known, sigma, used)[0]
    worst, likelihood = None, ONE_IN
    for n in map(int, np.flatnonzero(used)):
        others = used & (np.arange(len(used)) != n)
        left, off = _misfit(found, known, sigma, others, n)
        by_chance = float(fdtrc(3, freedom, (whole - left) / 3.0 / max(left / freedom, TINY))) * np.count_nonzero(used)
        if off > SIGNIFICANT and by_chance < likelihood:
            worst, likelihood = n, by_chance
    return worst


def _misfit(
    found: np.ndarray, known: np.ndarray, sigma: np.ndarray, used: np.ndarray, aside: int = 0
) -> tuple[float, float]:
    """Squared residuals of the points used, in their sigmas, after the best similarity, and how many sigmas the point
    `aside` is from its place."""
    fit = align_similarity(found[used], known[used], sigma[used] ** -2.0)
    off = np.linalg.norm(fit(found) - known, axis=1) / sigma
    return float(np.sum(off[used] ** 2)), float(off[aside])


def place_by_control(scene: Scene, points: Sequence[ControlPoint]) -> Scene | None:
    """The scene moved by the similarity that brings its control points to where they are known, in metres.

    The points are triangulated from their pixels; those that contradict the others do not count. None, with the reason
    in the log, where fewer than MIN_POINTS of them are seen in two views, or all lie on a line.
    """
    control = ground_control(agreeing_points(points, scene.views), scene.views)
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
    similarity = align_similarity(found[fixed], known, 1.0 / np.mean(control.sigma[fixed] ** 2, axis=1))
    off = np.linalg.norm(similarity(found[fixed]) - known, axis=1)
    log.info("%d control points place the map, %.4g m off (RMS)", len(known), np.sqrt(np.mean(off**2)))
    return replace(transform_scene(similarity, scene), frame=BODY_FIXED)


def control_table(
    points: Sequence[ControlPoint], estimated: Mapping[str, np.ndarray], views: Views
) -> list[ControlRow]:
    """One row per control point that was used, or left out.

    estimated: position (3,) by name, as `Adjustment.control`; views: as estimated, with which points that were left out
    are triangulated.
    """
    if not estimated:
        return []
    used, estimated = set(estimated), {**_triangulated(points, views), **estimated}
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
            ControlRow(
                name=point.name,
                used=point.name in used,
                views=len(pixels),
                off_m=float(np.linalg.norm(off)),
                sigma_m=float(np.sqrt(np.mean(point.sigma**2))),
                off_sigmas=float(np.sqrt(np.mean((off / point.sigma) ** 2))),
                pixels_off_px=float(np.sqrt(np.mean(missed**2))),
                pixels_off_sigmas=float(np.sqrt(np.mean((missed / sigma) ** 2))),
            )
        )
    return rows


def _triangulated(points: Sequence[ControlPoint], views: Views) -> dict[str, np.ndarray]:
    """Positions (3,) by name of the points that two views or more see."""
    control = ground_control(points, views)
    if control is None:
        return {}
    found = triangulate_tracks(control.tracks, views)
    return {name: at for name, at in zip(control.name, found, strict=True) if np.isfinite(at).all()}


def warn_of_contradictions(rows: Sequence[ControlRow]) -> None:
    """Names control points in the log that were left out, and those that images or other points contradict."""
    for row in rows:
        if not row.used:
            warn(
                log,
                "control-contradicts",
                "control point %s is left out: it is %.4g m (%.3g sigmas) from where the images and the other points "
                "put it; check its pixels and its position",
                row.name,
                row.off_m,
                row.off_sigmas,
            )
        elif max(row.off_sigmas, row.pixels_off_sigmas) > SIGNIFICANT:
            warn(
                log,
                "control-contradicts",
                "control point %s: the estimate is %.4g m from its position (%.3g sigmas) and %.3g px from its pixels "
                "(%.3g sigmas); check its pixels, its position and its sigma",
                row.name,
                row.off_m,
                row.off_sigmas,
                row.pixels_off_px,
                row.pixels_off_sigmas,
            )


def control_metrics(rows: Sequence[ControlRow]) -> dict[str, float]:
    """Figures of `control_table`, of the points that were used."""
    used = [row for row in rows if row.used]
    if not used:
        return {}
    return {
        "control_points": float(len(used)),
        "control_points_left_out": float(len(rows) - len(used)),
        "control_point_off_rms_m": float(np.sqrt(np.mean([row.off_m**2 for row in used]))),
        "control_point_off_rms_sigmas": float(np.sqrt(np.mean([row.off_sigmas**2 for row in used]))),
    }
