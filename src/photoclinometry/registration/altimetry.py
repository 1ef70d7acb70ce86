"""The shift that brings a map onto a laser altimeter's shots, where its error is larger than theirs.

Pose priors may put a map ten ground samples beside its place. The joint estimate compares each shot with the landmark
nearest to it, and converges from a fraction of the length of the hills, not from farther away.
"""

from __future__ import annotations

import logging

import numpy as np

from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.gauss_newton import MOST_ITERATIONS
from photoclinometry.model.robust import huber_weight, robust_sigma
from photoclinometry.model.scene import Scene
from photoclinometry.surface.relief import local_frame

log = logging.getLogger(__name__)

MOST_SCATTER = 3.0
"""Shots lie on the map if their heights scatter about it by no more than this many of their standard deviations."""

MOST_REMAINING = 0.5
"""Another place is accepted only if the scatter of the shots there is less than this share: equally wrong places differ
by little."""

REACH = 0.75
"""Shifts are sought up to this share of the map's width to either side: beyond, few shots of a track are left on it."""

STEPS = 24
"""Steps of the search to either side: of a 32nd of the map's width, a part of the length of its hills."""

FEWEST_SHOTS, LEAST_SHARE = 20, 0.3
"""Fewest shots on the map, and least share of the largest number at any of the places that are tried: with few shots,
one of the many places fits by chance."""

MOST_SHOTS = 2000
"""Shots that are used at most, for speed: three numbers are sought."""

FLAT = 0.01
"""The map is not shifted along a direction if the ground's normals have less than this share of their largest component
in it: level ground does not determine where along itself a shot fell."""


def shift_to_altimetry(scene: Scene, tracks: AltimeterTracks) -> np.ndarray:
    """(3,) shift of the scene, in its frame, that brings it under the shots; zeros where that is less than the distance
    between landmarks, or where too few shots lie on the map.

    Iterative closest points along the map's normals, starting from the scene's place. Where that does not end on the
    shots, it starts from the place around at which the heights of most of them fit best (MOST_SHOTS of them, evenly
    chosen).
    """
    ground = _Ground(scene)
    every = max(1, -(-len(tracks) // MOST_SHOTS))
    shots = ground.to_local(tracks.position[::every])
    sigma = np.hypot(tracks.sigma, tracks.shift_sigma[tracks.track])[::every]
    found, scatter = _settled(ground, shots, sigma, np.zeros(3))
    if scatter > MOST_SCATTER:
        other, least = _settled(ground, shots, sigma, _best_place(ground, shots))
        if least < MOST_REMAINING * scatter:
            found, scatter = other, least
    if np.linalg.norm(found) < scene.spacing:
        return np.zeros(3)
    log.info(
        "the map is shifted by %.4g m onto the altimeter's shots, which scatter about it by %.3g of their standard "
        "deviations",
        np.linalg.norm(found),
        scatter,
    )
    return ground.turned(found)


class _Ground:
    """A map as a height field over its mean plane."""

    def __init__(self, scene: Scene):
        from scipy.spatial import KDTree

        frame = local_frame(scene)
        self.to_local, self.turned = frame.inverse(), lambda shift: frame.rotation @ shift
        self.position = self.to_local(scene.landmarks.position)
        self.normal = scene.landmarks.normal @ frame.rotation
        self.spacing, self.width = scene.spacing, float(np.max(np.ptp(self.position[:, :2], axis=0)))
        self._tree = KDTree(self.position[:, :2])

    def nearest(self, shots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The landmark (n,) below each shot, and whether there is one (n,)."""
        distance, index = self._tree.query(shots[:, :2])
        return np.asarray(index), np.asarray(distance) <= self.spacing

    def height_above(self, shots: np.ndarray) -> np.ndarray:
        """(n,) of shots (n, 3) above the tangent planes, along z; NaN off the map and over its steepest ground."""
        index, below = self.nearest(shots)
        normal, arm = self.normal[index], shots - self.position[index]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(below & (normal[:, 2] > 0.1), np.sum(normal * arm, axis=1) / normal[:, 2], np.nan)


def _best_place(ground: _Ground, shots: np.ndarray) -> np.ndarray:
    """(3,) the shift of the map, among STEPS to either side, at which the shots' heights above it scatter least; zeros
    where too few lie on the map."""
    steps = np.linspace(-REACH, REACH, 2 * STEPS + 1) * ground.width
    places = []
    for shift in np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2):
        above = ground.height_above(shots - [*shift, 0.0])
        known = above[np.isfinite(above)]
        if len(known) >= FEWEST_SHOTS:
            middle = float(np.median(known))
            places.append((len(known), robust_sigma(known - middle), np.array([*shift, middle])))
    enough = LEAST_SHARE * max((count for count, *_ in places), default=0)
    covered = [(scatter, place) for count, scatter, place in places if count >= enough]
    return min(covered, key=lambda one: one[0], default=(0.0, np.zeros(3)))[1]


def _settled(ground: _Ground, shots: np.ndarray, sigma: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, float]:
    """A shift (3,) of the map improved by closest points, and the scatter of the shots then, in their sigmas (n,).

    Zeros, and infinitely far, where fewer than FEWEST_SHOTS lie on the map.
    """
    scatter = np.inf
    for _ in range(MOST_ITERATIONS):
        moved = shots - shift
        index, below = ground.nearest(moved)
        if np.count_nonzero(below) < FEWEST_SHOTS:
            return np.zeros(3), np.inf
        normal = ground.normal[index][below]
        off = np.sum(normal * (moved - ground.position[index])[below], axis=1)
        scatter = robust_sigma(off / sigma[below])
        weight = huber_weight(off / (sigma[below] * max(scatter, 1.0))) / sigma[below] ** 2
        value, axis = np.linalg.eigh(np.einsum("n,ni,nj->ij", weight, normal, normal))
        told = value > FLAT * value[-1]
        step = axis @ (
            np.where(told, axis.T @ np.einsum("n,ni,n->i", weight, normal, off), 0.0) / np.where(told, value, 1)
        )
        shift = shift + step
        if np.linalg.norm(step) < 0.01 * ground.spacing:
            break
    return shift, scatter
