"""Laser altimetry: points of the ground that an altimeter measured, track by track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.errors import InputError


@dataclass(frozen=True, kw_only=True)
class AltimeterTracks:
    """Shots of a laser altimeter in the body-fixed frame, along L tracks.

    A track is a stretch over which the error of the spacecraft's orbit does not change. All of its shots share one
    shift, which is most of their error, and each has an error of its own.
    """

    name: tuple[str, ...]
    """(L,) of the tracks."""
    shift_sigma: np.ndarray
    """(L,) standard deviation of each track's shift, along each axis of B [m]."""
    track: np.ndarray
    """(n,) index of each shot's track."""
    position: np.ndarray
    """(n, 3) where each shot met the ground, in B, body-fixed [m]."""
    sigma: np.ndarray
    """(n,) standard deviation of each shot's own error, across the ground [m]."""

    def __len__(self) -> int:
        return len(self.track)


def track_of_surface(points: np.ndarray, spacing: float, sigma: float, shift_sigma: float) -> AltimeterTracks:
    """A coarse shape or terrain model as one track, thinned until the errors of its points are independent.

    points: (n, 3) of the surface in B [m], vertices of a mesh or cells of a grid; of two that are nearer to each other
    than `spacing`, the first stays. spacing: side of the square of ground whose points share an error [m]; where the
    correlation of errors falls to 1/e over a distance l, 2.5 l (the integral of exp(-d / l) over the plane is 2 pi
    l^2). sigma: standard deviation of heights of the surface from the true ground, the detail that it lacks included
    [m];
    shift_sigma: of a shift of it as a whole, along each axis [m]. Raises InputError for points that are not finite, and
    for numbers that are not positive.
    """
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
        raise InputError(f"points of a surface are of shape {points.shape}, or not finite; give (n, 3) numbers [m]")
    for name, value in (("spacing", spacing), ("sigma", sigma), ("shift_sigma", shift_sigma)):
        if not 0.0 < value < np.inf:
            raise InputError(f"{name} is {value:g}; give metres above 0")
    kept = points[_apart(points, spacing)]
    return AltimeterTracks(
        name=("surface",),
        shift_sigma=np.array([float(shift_sigma)]),
        track=np.zeros(len(kept), int),
        position=kept,
        sigma=np.full(len(kept), float(sigma)),
    )


def _apart(points: np.ndarray, spacing: float) -> np.ndarray:
    """Indices of points (n, 3) of which no two are within `spacing`: each that has none before it."""
    from scipy.spatial import KDTree

    tree, free, kept = KDTree(points), np.ones(len(points), bool), []
    for k in range(len(points)):
        if free[k]:
            kept.append(k)
            free[tree.query_ball_point(points[k], spacing)] = False
    return np.array(kept)
