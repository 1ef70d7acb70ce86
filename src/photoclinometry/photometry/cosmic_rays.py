"""Cosmic rays and hot pixels, found by comparison with the prediction from the other views.

A pixel that a particle has struck is far brighter than the map predicts from all views, and the ground around it is
not. Ground that the map does not fit differs by as much, such as edges of boulders and of shadows. It differs in both
directions, along lines, and in some views only, whereas particles strike all views.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.robust import robust_sigma
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import brightness_residuals
from photoclinometry.photometry.sampled_brightness import landmark_spacing_px

STRUCK_SIGMAS = 8.0
"""A struck pixel is brighter than its surroundings by at least this many robust standard deviations of the view's
residuals; the largest of a million normal errors reaches 5."""

MISFITS = 0.1
"""Largest ratio of observations that are darker than their surroundings by as much to those that count as struck. No
particle makes a pixel darker, so that the dark ones show how many of the bright ones are misfits of the ground."""

STRUCK_VIEWS = 0.5
"""Least share of the views in which something is struck: a detector is hit as often in each image. 5 of 32 views of
three sound sites have misfits of the ground that look like particles; all of ten views with particles do."""

SPOT_PX = 3.0
"""Longest side of the spot that a struck pixel brightens [px of the view], spread by the spline between pixels."""

AROUND = 7
"""Side of the square of landmarks whose median residual stands for the surroundings: more than twice SPOT_PX."""


def is_struck(scene: Scene) -> np.ndarray:
    """(N,) bool: lit observations whose brightness a cosmic ray or a hot pixel has raised, and their neighbours.

    None where less than a share STRUCK_VIEWS of the views has any. The scene must have a reflectance model. Its
    normals and albedos are estimated from all views, so that a single view hardly changes the prediction.
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
