"""The ground around a map, fitted to the shadows that it casts onto the map.

Sparse points give that ground to about half a ground sample distance. Under a low Sun the edge of a shadow is off by
several times the error of the height, and the images show where the edge is. If a landmark is in sunlight, all ground
towards the Sun is below its ray; if it is in shadow, some ground is above the ray (shadow carving, Savarese et al.
2007, doi:10.1007/s11263-006-8323-9). One node of the ground decides each ray: the node where the ray passes deepest
below the ground, or lowest above it. Each node moves to the depth that decides most of its rays correctly, weighed
against its depth from the sparse points, until the cost falls no further.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.image import Image
from photoclinometry.model.sampling import sample_image
from photoclinometry.model.scene import Scene, Surroundings
from photoclinometry.model.threads import in_threads
from photoclinometry.photometry.render import landmark_brightness, sunlit_share
from photoclinometry.surface.map_rays import MapRays

log = logging.getLogger(__name__)

SHADED = 0.5
"""Share of the brightness that the map predicts in sunlight, below which a landmark counts as shaded: halfway to none.
"""

FAINT = 0.1
"""Share below which light is not used. Landmarks predicted darker than this share of the median may be dark without a
shadow if their slopes are off by degrees. If this share of the ground around a landmark lies in the map's own shadow,
the shadow's edge is in the pixel."""

SIGMA_GSD = 4.0
"""Standard deviation of the interpolated depths between sparse points [ground sample distances]: for slopes that change
by 0.1 per pixel (`surroundings.GROUND`), 17 pixels from a point, 0.1 x 17^1.5 / sqrt(3). With 2 and with infinity,
renderings of six sites differ by 0.1 dB; on a seventh, lit from all sides, 2 loses 1.1 of 2.3 dB."""

PAST_GSD = 0.05
"""Distance by which the ground is moved past the last ray that it is to let through or obstruct [ground sample
distances]: more than rounding, and little compared with the errors of positions."""

HIGHEST = 3.0
"""Rays that pass higher above all ground than this [SIGMA_GSD] are ignored."""

LEAST_GAIN = 1.0
"""Least reduction of the cost for another round: one ray."""


@dataclass(frozen=True, kw_only=True)
class _Seen:
    """Landmarks whose sunlight an image shows."""

    sun: np.ndarray
    """(3,) towards the Sun in B."""
    landmark: np.ndarray
    """(n,) int."""
    shaded: np.ndarray
    """(n,) bool."""


def surroundings_by_shadows(scene: Scene, images: Sequence[Image]) -> Surroundings | None:
    """The scene's surroundings, moved so that they cast the shadows that the images show.

    images: of the scene's views, in their order. Minimises the number of rays that are wrongly in shadow or not, plus
    half of the squared moves of the nodes in standard deviations, one node at a time. Nodes that no ray passes stay.
    None where the scene has no surroundings. Raises InputError where it has no reflectance model.
    """
    before = scene.surroundings
    if before is None:
        return None
    chosen, sigma = _chosen(scene, before), SIGMA_GSD * scene.gsd
    if not len(chosen):
        return before
    rays = MapRays(scene)
    seen = in_threads(lambda k: _seen(scene, k, images[k], chosen, rays), range(len(images)))
    around = best = before
    costs: list[float] = []
    while True:
        node, below, shaded = _decided(scene, around, seen)
        moved, wrong = (around.depth - before.depth) / sigma, (below > 0.0) != shaded
        costs.append(float(np.count_nonzero(wrong) + 0.5 * np.nansum(moved**2)))
        if len(costs) > 1 and costs[-1] > costs[-2] - LEAST_GAIN:
            break
        best, depth = around, around.depth.copy()
        moving = np.unique(node[wrong & (node >= 0)])
        rows = np.flatnonzero(np.isin(node, moving))
        for n in moving:
            mine = rows[node[rows] == n]
            depth.flat[n] += sigma * _shift(below[mine] / sigma, shaded[mine], moved.flat[n])
        around = replace(around, depth=depth)
    log.info("shadows of the ground around: cost %.0f -> %.0f, of %d rays", costs[0], costs[-2], len(shaded))
    return best


def _chosen(scene: Scene, around: Surroundings) -> np.ndarray:
    """(n,) indices of landmarks, two or more to a node of the ground around, down and across."""
    row, col = scene.cells
    step = max(1, around.stride // (2 * scene.region.stride))
    return np.flatnonzero((row % step == 0) & (col % step == 0))


def _seen(scene: Scene, view: int, image: Image, chosen: np.ndarray, rays: MapRays) -> _Seen:
    """The chosen landmarks that an image shows, that face the Sun, and that no shadow of the map itself touches.

    rays: of all landmarks, over the map alone.
    """
    views = scene.views
    pose, sun = views.body_from_cam[view], unit(views.sun[view])
    expected = landmark_brightness(scene, view, with_scale_and_bias=False)[chosen]
    at = views.cameras[view].pixel_from_cam(pose.inverse()(scene.landmarks.position[chosen]))
    brightness, there = sample_image(image, at)
    there &= rays.of(chosen).free_up_to(pose.translation)
    there &= sunlit_share(scene, rays.unoccluded_towards(sun))[chosen] >= 1.0 - FAINT
    there &= expected > FAINT * np.median(expected)
    shaded = (brightness - views.bias[view]) / views.scale[view] < SHADED * expected
    return _Seen(sun=sun, landmark=chosen[there], shaded=shaded[there])


def _decided(scene: Scene, around: Surroundings, seen: Sequence[_Seen]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all rays (n,): the node that decides it, how far the ray is below the ground there (`Decided`), and whether
    the image shows shadow."""
    rays, above = MapRays(scene, around), HIGHEST * SIGMA_GSD * scene.gsd
    decided = [rays.of(view.landmark).decided(view.sun, above) for view in seen]
    return (
        np.concatenate([each.node for each in decided]),
        np.concatenate([each.below for each in decided]),
        np.concatenate([view.shaded for view in seen]),
    )


def _shift(below: np.ndarray, shaded: np.ndarray, moved: float) -> float:
    """The shift of a node's depth that costs least; all lengths in SIGMA_GSD.

    below: (n,) of the rays that the node decides; rays with `below` greater than the shift are then obstructed. moved:
    distance of the node from its start.
    """
    order = np.argsort(below, kind="stable")
    below, shaded = below[order], shaded[order]
    # After a shift between the rays i - 1 and i those from i on are obstructed.
    wrong = np.append(0, np.cumsum(shaded)) + np.append(np.cumsum(~shaded[::-1])[::-1], 0)
    low, high = np.append(-np.inf, below), np.append(below, np.inf)
    room = np.minimum(PAST_GSD / SIGMA_GSD, 0.5 * (high - low))
    shift = np.clip(0.0, low + room, high - room)
    return float(shift[np.argmin(wrong + 0.5 * (moved + shift) ** 2)])
