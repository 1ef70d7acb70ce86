"""Cosmic rays and hot pixels, found by what the other views predict.

A pixel that a particle has struck is far brighter than the map predicts from all views, and the ground around it is
not. A map does not fit all ground, either: edges of boulders and of shadows differ by as much, but in both directions,
along lines, and in some views only: particles strike all.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.robust import robust_sigma
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import brightness_residuals
from photoclinometry.photometry.sampled_brightness import landmark_spacing_px

STRUCK_SIGMAS = 8.0
"""Robust standard deviations of a view's residuals by which a struck pixel is brighter than its surroundings at least:
of a million normal errors the largest reaches 5."""

MISFITS = 0.1
"""Share, at most, of observations that are darker than their surroundings by as much, among those that count as struck:
no particle makes a pixel darker, so that these tell how many are misfits of the ground."""

STRUCK_VIEWS = 0.5
"""Share of the views at least in which something is struck: a detector is hit as often in each image. Of 32
views of three sound sites 5 have misfits of the ground that look like particles, of ten views with particles all do."""

SPOT_PX = 3.0
"""Longest side of what a struck pixel raises [px of the view], as the spline between pixels spreads it."""

AROUND = 7
"""Side of the square of landmarks whose median residual is that of the surroundings: more than twice SPOT_PX."""


def is_struck(scene: Scene) -> np.ndarray:
    """(N,) bool: lit observations whose brightness a cosmic ray or a hot pixel has raised, and their neighbours.

    None where fewer than STRUCK_VIEWS of the views have any. The scene must have a reflectance model; its normals and
    albedos are of all views, so that one of several cannot raise what is predicted.
    """
    from scipy.ndimage import binary_dilation, median_filter

    tracks, landmark, (row, col) = scene.tracks, scene.tracks.landmark, scene.cells
    spacing = landmark_spacing_px(scene.views, scene.landmarks.position, scene.reference)
    brighter, struck = -brightness_residuals(scene), np.zeros(len(tracks), bool)
    for view in range(len(scene.views)):
        mine = np.flatnonzero((tracks.view == view) & tracks.lit)
        if not len(mine):
            continue
        cells = row[landmark[mine]], col[landmark[mine]]
        excess = np.nan_to_num(scene.grid_of_observations(brighter, mine) - np.median(brighter[mine]))
        sigma = robust_sigma(excess[cells])
        spike = excess - median_filter(excess, AROUND)
        beyond = spike >= _least_spike(spike[cells], STRUCK_SIGMAS * sigma)
        spots = _no_larger(beyond, max(SPOT_PX / (spacing[view] * scene.region.stride), 1.0))
        struck[mine] = binary_dilation(spots, np.ones((3, 3), bool))[cells]
    with_any = np.unique(tracks.view[struck])
    return struck if len(with_any) >= STRUCK_VIEWS * len(scene.views) else np.zeros_like(struck)


def _no_larger(there: np.ndarray, side: float) -> np.ndarray:
    """Cells (h, w) of the parts that are no longer than `side` cells, down and across."""
    from scipy.ndimage import find_objects, label

    part = np.empty(there.shape, np.int32)
    label(there, np.ones((3, 3)), output=part)
    larger = [n for n, box in enumerate(find_objects(part), 1) if max(s.stop - s.start for s in box) > side]
    return there & ~np.isin(part, larger)


def _least_spike(spike: np.ndarray, least: float) -> float:
    """The size, `least` at least, from which on only MISFITS of the spikes (n,) are negative; infinite without any."""
    up, down = (np.sort(side[side > least]) for side in (spike, -spike))
    larger_up = np.arange(len(up), 0, -1)
    larger_down = len(down) - np.searchsorted(down, up)
    enough = np.flatnonzero(larger_down <= MISFITS * larger_up)
    return float(up[enough[0]]) if len(enough) else np.inf
