"""Shots of a laser altimeter over a map: the landmark that each shot met, and its distance from the map.

The beam is narrower than the distance between landmarks, or about as wide. A shot is compared with the tangent plane of
the landmark nearest to it as seen from above. Within half the distance between landmarks the ground departs from this
plane by little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust.graph.altimetry import Altimetry
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.geometry import tangent_basis, unit
from photoclinometry.model.robust import SIGNIFICANT, robust_sigma
from photoclinometry.model.scene import Landmarks

BESIDE = 0.9
"""A shot meets no landmark if the nearest is further than this to the side, in distances between landmarks: the corners
of a map's squares lie 0.71 from the nearest, more where the reference view looks obliquely."""

NEARER = 0.25
"""Departure of the ground from a tangent plane anywhere within the square around a landmark, over that at the eight
landmarks around: an eighth for smooth curves, a third for ground whose heights grow like distances."""

_AROUND = 8
"""Neighbours of a landmark at which the ground's departure from its tangent plane is measured."""


@dataclass(frozen=True, kw_only=True)
class AltimetryFit:
    """Shots of an altimeter compared with an estimate."""

    tracks: AltimeterTracks
    """The n shots, along L tracks."""
    met: np.ndarray
    """(n,) bool: on the map."""
    used: np.ndarray
    """(n,) bool: of these, those that took part in the estimate."""
    off: np.ndarray
    """(n,) height of each shot above the map's tangent planes, less its track's shift, in units of B; NaN off the
    map."""
    stated_sigma: np.ndarray
    """(n,) standard deviations of `off`, from those of the shots and of the ground between landmarks."""
    inflation: float
    """Factor on these in the estimate, at least 1: it lowers the weight of shots whose residuals are larger than
    stated."""
    landmark: np.ndarray
    """(n,) nearest landmark of each, seen from above."""
    shift: np.ndarray
    """(L, 3) of the tracks."""


def altimetry_at(tracks: AltimeterTracks, estimate: Estimate, mapped: int, spacing: float, first: int) -> AltimetryFit:
    """The shots compared with an estimate.

    mapped: number of the map's landmarks, which come first in the estimate; spacing: between them; first: index of the
    first track's shift among the systematic errors. The stated sigmas of shots give their weights, lowered where
    residuals are larger.
    """
    from scipy.spatial import KDTree

    landmarks = estimate.landmarks[:mapped]
    from_above = tangent_basis(unit(landmarks.normal.mean(0)))
    tree = KDTree(landmarks.position @ from_above)
    shift = estimate.systematic[first : first + len(tracks.name), :3]
    place = tracks.position - shift[tracks.track]
    beside, nearest = map(np.asarray, tree.query(place @ from_above))
    off = np.sum((place - landmarks.position[nearest]) * landmarks.normal[nearest], axis=-1)
    met = beside <= BESIDE * spacing
    sigma, used, inflation = tracks.sigma, met.copy(), 1.0
    if met.any():
        around = np.asarray(tree.query(landmarks.position[nearest[met]] @ from_above, k=_AROUND + 1)[1])[:, 1:]
        sigma = np.hypot(sigma, departure_from_planes(landmarks, nearest[met], around))
        inflation = max(1.0, robust_sigma(off[met] / sigma[met]))
        used &= np.abs(off) <= SIGNIFICANT * inflation * sigma
    return AltimetryFit(
        tracks=tracks,
        met=met,
        used=used,
        off=np.where(met, off, np.nan),
        stated_sigma=sigma,
        inflation=inflation,
        landmark=nearest,
        shift=shift,
    )


def altimetry_group(fit: AltimetryFit, first: int) -> Altimetry:
    """The factors of the shots that are used. first: as of `altimetry_at`."""
    tracks, used = fit.tracks, fit.used
    return Altimetry(
        landmark=fit.landmark[used],
        track=tracks.track[used],
        position=tracks.position[used],
        sigma=fit.inflation * fit.stated_sigma[used],
        shift_sigma=tracks.shift_sigma,
        first=first,
    )


def departure_from_planes(landmarks: Landmarks, middle: np.ndarray, around: np.ndarray) -> float:
    """Standard deviation of the ground from the tangent plane of the nearest landmark, in units of B.

    That of the landmarks `around` (n, 8) from the planes of those in the middle (n,), times NEARER.
    """
    arm = landmarks.position[around] - landmarks.position[middle][:, None]
    return NEARER * robust_sigma(np.sum(arm * landmarks.normal[middle][:, None], axis=-1).ravel())
