"""Laser altimetry in a run: it takes part in the joint estimate, and is compared with it track by track."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photoclinometry.adjust import AltimetryFit
from photoclinometry.io.altimetry_csv import write_altimetry
from photoclinometry.io.run_files import ALTIMETRY_FILE
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.geometry import Similarity
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.robust import SIGNIFICANT
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.frame.pose_priors import changes_beside_priors
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.registration.altimetry import REACH, shift_to_altimetry

log = logging.getLogger(__name__)

FEW_SHOTS = 3
"""So many shots may lie within the distance between two landmarks."""

SINGLE_SHOT_SHARE = 0.5
"""A table that gives more than this share of its tracks one shot has most likely numbered its shots."""

SCATTERS = 3.0
"""A track contradicts the map if its shift is SIGNIFICANT, root mean square over the three axes, or if its shots are
further off the map than this many of their standard deviations (RMS): hundreds of shots that state theirs rightly are
1.0 off. A map in a wrong place shows so."""

MOST_LEFT_OUT = 0.1
"""Likewise if more than this share of its shots on the map lie too far off to be used: of good shots one in a million
does, and ground that is steeper than the map's landmarks tell apart leaves a few in a hundred."""


@dataclass(frozen=True, kw_only=True)
class TrackRow:
    """How far the shots of an altimeter's track are off the map after the track was shifted, and by how much it was."""

    name: str
    """The track's."""
    shots: int
    """Those on the map."""
    left_out: int
    """Those of them that lie too far off to be used."""
    off_m: float
    """Heights of the shots used above the map: root mean square."""
    off_sigmas: float
    """Likewise, over the sigmas that the table of shots and the ground between landmarks state."""
    shift_m: float
    """Length of the track's shift."""
    shift_sigma_m: float
    """As stated, along each axis."""
    shift_off_sigmas: float
    """Root mean square over the axes."""


def tracks_over(scene: Scene, tracks: AltimeterTracks) -> AltimeterTracks | None:
    """The shots over a scene in their frame, or so near that they may yet come to lie on it as its frame gets better
    (REACH of `registration.altimetry`), with their tracks alone.

    None where there are none, or where all lie on one landmark, as kilometres do that are called metres.
    """
    from scipy.spatial import KDTree

    ground = scene.landmarks.position
    width = float(np.max(np.ptp(ground, axis=0)))
    near = np.isfinite(KDTree(ground).query(tracks.position, distance_upper_bound=REACH * width)[0])
    if not near.any():
        return None
    if np.count_nonzero(near) > FEW_SHOTS and np.max(np.ptp(tracks.position[near], axis=0)) < scene.spacing:
        return None
    kept, number = np.unique(tracks.track[near], return_inverse=True)
    return AltimeterTracks(
        name=tuple(tracks.name[n] for n in kept),
        shift_sigma=tracks.shift_sigma[kept],
        track=number,
        position=tracks.position[near],
        sigma=tracks.sigma[near],
    )


def on_shots(scene: Scene, tracks: AltimeterTracks) -> Scene:
    """The scene shifted under the shots, where it is off by more than these are (`registration.altimetry`)."""
    shift = shift_to_altimetry(scene, tracks)
    if not shift.any():
        return scene
    moved = transform_scene(Similarity(1.0, np.eye(3), shift), scene)
    return replace(moved, frame=scene.frame)


def altimetry_table(fit: AltimetryFit | None) -> list[TrackRow]:
    """One row for each track with shots on the map."""
    if fit is None:
        return []
    rows = []
    for n, name in enumerate(fit.tracks.name):
        met = fit.met & (fit.tracks.track == n)
        used = fit.used & met
        if not met.any():
            continue
        shift, sigma = fit.shift[n], float(fit.tracks.shift_sigma[n])
        rows.append(
            TrackRow(
                name=name,
                shots=int(met.sum()),
                left_out=int(met.sum() - used.sum()),
                off_m=_rms(fit.off[used]),
                off_sigmas=_rms(fit.off[used] / fit.stated_sigma[used]),
                shift_m=float(np.linalg.norm(shift)),
                shift_sigma_m=sigma,
                shift_off_sigmas=float(np.sqrt(np.mean((shift / sigma) ** 2))),
            )
        )
    return rows


def altimetry_metrics(
    fit: AltimetryFit, scene: Scene, priors: Mapping[str, PosePrior], used: np.ndarray
) -> dict[str, float]:
    """Figures of `altimetry_table`, and what the altimeter has changed beside the pose priors `used` (K,) bool
    (`changes_beside_priors`)."""
    shots, met = fit.used, int(fit.met.sum())
    figures = {"altimetry_shots": float(met), "altimetry_left_out": float(met - int(shots.sum()))}
    if shots.any():
        figures |= {
            "altimetry_off_rms_m": _rms(fit.off[shots]),
            "altimetry_off_rms_sigmas": _rms(fit.off[shots] / fit.stated_sigma[shots]),
        }
    return figures | changes_beside_priors(scene, priors, used, "altimetry")


def warn_of_altimetry(rows: Sequence[TrackRow], *, given: bool) -> None:
    """Names tracks that contradict the map, or says that there are none on it though altimetry was `given`."""
    if given and not rows:
        warn(
            log,
            "altimetry-unused",
            "no shot of the laser altimeter can be used, as none lies over the map, or all lie on one landmark; check "
            "that x_m, y_m, z_m are metres in the frame of the pose priors",
        )
    _warn_of_scatter(rows)
    single = sum(row.shots == 1 for row in rows)
    if single > SINGLE_SHOT_SHARE * len(rows) and single > 1:
        warn(
            log,
            "altimetry-tracks",
            "%d of the %d altimeter tracks on the map have a single shot, so that each shot is shifted by itself; give "
            "all shots of one orbit the same `track`",
            single,
            len(rows),
        )
    for row in rows:
        if row.shift_off_sigmas > SIGNIFICANT:
            warn(
                log,
                "altimetry-contradicts",
                "altimeter track %s lies on the map only where it is shifted by %.4g m, %.3g sigmas; check its "
                "track_sigma_m, and the pose priors",
                row.name,
                row.shift_m,
                row.shift_off_sigmas,
            )
        if row.left_out > MOST_LEFT_OUT * row.shots:
            warn(
                log,
                "altimetry-contradicts",
                "%d of the %d shots of altimeter track %s lie too far off the map to be used; %s names them",
                row.left_out,
                row.shots,
                row.name,
                ALTIMETRY_FILE,
            )


def _warn_of_scatter(rows: Sequence[TrackRow]) -> None:
    """Names the tracks whose shots scatter about the map by far more than they state."""
    far = [row for row in rows if row.off_sigmas > SCATTERS]
    if far:
        warn(
            log,
            "altimetry-contradicts",
            "shots of altimeter track%s %s scatter about the map by %.3g standard deviations (RMS): either sigma_m is "
            "too small, or the map does not lie where the pose priors put it",
            "" if len(far) == 1 else "s",
            ", ".join(row.name for row in far),
            max(row.off_sigmas for row in far),
        )


def write_shots(folder: Path, fit: AltimetryFit | None) -> None:
    """All shots on the map into ALTIMETRY_FILE: the table as given, with what is found of each.

    Removes an older file.
    """
    if fit is None:
        (folder / ALTIMETRY_FILE).unlink(missing_ok=True)
        return
    met = fit.met
    own = replace(
        fit.tracks, track=fit.tracks.track[met], position=fit.tracks.position[met], sigma=fit.tracks.sigma[met]
    )
    found = {
        "off_m": fit.off[met],
        "off_sigmas": fit.off[met] / fit.stated_sigma[met],
        "used": fit.used[met].astype(int),
    }
    write_altimetry(folder / ALTIMETRY_FILE, own, found)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
