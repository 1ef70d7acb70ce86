"""Errors of the images' brightness that are smooth over the ground: errors of the reflectance model in a view.

A reflectance model has the same error on all ground of one slope, light and phase. If every landmark treats such an
error as its own noise, long waves of the slope follow brightness. The surface through the positions has better long
waves, since positions come from parallax, which does not depend on the reflectance model; its short waves are worse.
The long waves of the normals are therefore taken from the surface (`normals_along_surface`). The difference between
predicted and measured brightness of a view, averaged over the same length, is then that view's smooth error
(`smooth_errors`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.sampling import central_difference, gaussian, masked_filter
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.predict import brightness_residuals

NOISE_SHARE = 0.02
"""Largest part of the variance of the averaged tilt between normals and surface that may be noise of the positions."""

LEAST_SIGMA = 1.0
"""Standard deviation of the narrowest average [landmarks]: differences of neighbours do not resolve shorter waves."""

MAP_SHARE = 0.125
"""Standard deviation of the widest average, as a share of the map's side: wider averages give one tilt for the whole
map."""

SIGMA_RATIO = 2.0**0.25
"""Ratio of one average's standard deviation to that of the next one tried."""

STEEPEST = 0.1
"""Cosine of emission below which slopes grow no further: a single one would outweigh the rest of its average."""

LEAST_WEIGHT = 0.1
"""Part of an average's weight that has to fall on landmarks; with less, there is none."""


class SurfaceNormals(NamedTuple):
    """Normals whose long waves are those of the surface."""

    normal: np.ndarray
    """(J, 3)."""
    sigma: float
    """Standard deviation of the Gaussian average that separates long from short waves [landmarks]."""
    tilt: np.ndarray
    """(J,) angle from the averaged normals to the averaged surface [rad]; zero where nothing is known of it."""


def normals_along_surface(scene: Scene, among: np.ndarray) -> SurfaceNormals | None:
    """The scene's normals, each turned by the rotation from the averaged normal to that of the averaged surface.

    among: (J,) bool, landmarks whose positions are to be trusted. The average is the narrowest whose tilt is not caused
    by noise. White noise of the heights with a variance v of the differences of neighbours leaves a variance of v / (4
    pi s^4) after a Gaussian average of standard deviation s. None where no average is wide enough, as on ground whose
    reflectance is that of the model.
    """
    grid, sigma = _Grid(scene, among), LEAST_SIGMA
    widest = MAP_SHARE * np.sqrt(np.count_nonzero(grid.known))
    if widest < sigma:
        return None
    raw = _mean_square(grid.difference()[grid.known])
    while sigma <= widest:
        own, other = grid.averages(sigma)
        there = grid.known[grid.cells] & np.isfinite(own + other).all(-1)
        if raw / (4.0 * np.pi * sigma**4) <= NOISE_SHARE * _mean_square((own - other)[there]):
            return _turned(scene.landmarks.normal, own, other, sigma)
        sigma *= SIGMA_RATIO
    return None


def smooth_errors(scene: Scene, used: np.ndarray, sigma: float) -> np.ndarray:
    """Relative errors (N,) of the brightness of each observation: predicted over measured, less one, averaged by view.

    used: (N,) bool, lit observations, whose brightness counts; sigma: standard deviation of the Gaussian average
    [landmarks]. Zero where too few observations are near. Raises InputError for a scene without reflectance.
    """
    tracks = scene.tracks
    off = np.where(used, brightness_residuals(scene) / np.where(used, tracks.brightness, 1.0), np.nan)
    found = np.zeros(len(tracks))
    for k in range(len(scene.views)):
        seen = np.flatnonzero(tracks.view == k)
        if used[seen].any():
            average = _average(scene.grid_of_observations(off, seen), sigma)[scene.cells][tracks.landmark[seen]]
            found[seen] = np.nan_to_num(average - np.nanmean(off[seen]))
    return found


class _Grid:
    """Slopes of normals and of the surface on the grid of the reference image's pixels.

    Slopes are vectors with a component of one along the line of sight of the reference view: such vectors can be
    averaged.
    """

    def __init__(self, scene: Scene, among: np.ndarray):
        position, normal = scene.landmarks.position, scene.landmarks.normal
        sight = unit(scene.views.body_from_cam[scene.reference].translation - position)
        toward = np.maximum(np.sum(normal * sight, -1, keepdims=True), STEEPEST)
        trusted = scene.grid(np.where(among[:, None], position, np.nan))
        self.cells, self.sight = scene.cells, scene.grid(sight)
        along = (central_difference(trusted, axis) for axis in (0, 1))
        # Rows and columns of the grid, then normals' slopes and the surface's two directions, then x, y and z.
        self.fields = np.stack([scene.grid(normal / toward), *along], axis=2)
        self.fields[np.isnan(trusted).any(-1)] = np.nan
        self.known = np.logical_and.reduce(np.isfinite(self.fields), (2, 3))

    def difference(self) -> np.ndarray:
        """Slopes of normals less those of the surface, between neighbours; NaN where these are not `known`."""
        return np.subtract(*self._slopes(self.fields))

    def averages(self, sigma: float) -> tuple[np.ndarray, np.ndarray]:
        """Averaged slopes (J, 3) of normals and of the surface at all landmarks; NaN where too little is near."""
        own, surface = self._slopes(_average(self.fields, sigma))
        return own[self.cells], surface[self.cells]

    def _slopes(self, fields: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of normals and of the surface (h, w, 3)."""
        own, first, second = np.moveaxis(fields, 2, 0)
        across = np.cross(first, second)
        toward = np.sum(across * self.sight, -1, keepdims=True)
        return own, across / np.where(toward == 0.0, np.nan, toward)


def _average(field: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian average of a field (h, w, ...) over the cells where it is finite; NaN with too little weight."""
    average, share = masked_filter(field, gaussian(sigma))
    average[share < LEAST_WEIGHT] = np.nan
    return average


def _mean_square(values: np.ndarray) -> float:
    return float(np.mean(np.sum(values**2, -1)))


def _turned(normal: np.ndarray, own: np.ndarray, other: np.ndarray, sigma: float) -> SurfaceNormals:
    """`normal` (J, 3), each turned by the rotation from `own` to `other` (J, 3)."""
    known = np.isfinite(own + other).all(-1, keepdims=True)
    start, end = (unit(np.where(known, slope, normal)) for slope in (own, other))
    axis, cosine = np.cross(start, end), np.sum(start * end, -1, keepdims=True)
    turned = cosine * normal + np.cross(axis, normal) + axis * np.sum(axis * normal, -1, keepdims=True) / (1.0 + cosine)
    tilt = np.arctan2(np.linalg.norm(axis, axis=-1), cosine[:, 0])
    return SurfaceNormals(normal=unit(turned), sigma=sigma, tilt=tilt)
