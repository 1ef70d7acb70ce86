"""Laser altimetry: points of the ground that an altimeter measured, track by track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class AltimeterTracks:
    """Shots of a laser altimeter in the body-fixed frame, along L tracks.

    A track is a stretch over which the error of the spacecraft's orbit does not change: all of its shots are off by
    one shift, which is most of their error, and each by an error of its own.
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
