"""A laser altimeter's tracks over the true ground of a simulated place."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.simulate.surface import Surface

TRACKS = 8
"""Half of them from west to east, half from south to north, as ascending and descending passes cross."""

PAST_EDGE = 1.2
"""Length of a track over the width of the region to map: it comes in from outside and leaves again."""

SHOT_STEP_GSD = 2.0
"""Distance of shots along a track, in ground sample distances."""


def altimeter_tracks(
    surface: Surface, width: float, gsd: float, sigma: tuple[float, float], rng: np.random.Generator
) -> AltimeterTracks:
    """Tracks over a square of ground about the origin.

    width: of the square [m]; sigma: standard deviations of each shot's height and of each track's shift along each
    axis [m].
    """
    reach = 0.5 * PAST_EDGE * width
    along = np.arange(-reach, reach, SHOT_STEP_GSD * gsd)
    parts = []
    for n in range(TRACKS):
        across = width * ((n // 2 + 0.5) / (TRACKS // 2) - 0.5) + rng.normal(0.0, 0.02 * width, 1)
        xy = np.column_stack([along, np.full_like(along, across[0])])
        parts.append(xy if n % 2 == 0 else xy[:, ::-1])
    xy = np.concatenate(parts)
    track = np.repeat(np.arange(TRACKS), len(along))
    height = surface.height_at(xy) + rng.normal(0.0, sigma[0], len(xy))
    shift = rng.normal(0.0, sigma[1], (TRACKS, 3))
    return AltimeterTracks(
        name=tuple(f"track-{n}" for n in range(TRACKS)),
        shift_sigma=np.full(TRACKS, sigma[1]),
        track=track,
        position=np.column_stack([xy, height]) + shift[track],
        sigma=np.full(len(xy), sigma[0]),
    )
