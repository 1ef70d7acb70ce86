"""What is known of the variables beforehand: Gaussian about given values, each variable by its own standard deviation.

The Suns' measurements are factors of their own (`factors.sun_direction`). An infinite standard deviation leaves a
variable free, a tiny one holds it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust.kernels import CAMERA_SIZE
from photoclinometry.adjust.variables import Estimate
from photoclinometry.model.geometry import skew, so3_log, tangent_basis
from photoclinometry.model.scene import Landmarks, Views


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Values and standard deviations; infinite where free."""

    views: Views
    """The values of poses, scales and biases."""
    pose_rotation: np.ndarray
    """(K,) [rad], about each axis."""
    pose_translation: np.ndarray
    """(K,) in units of B, along each axis."""
    scale: np.ndarray
    """(K,)."""
    bias: np.ndarray
    """(K,) in the images' brightness."""
    landmarks: Landmarks
    """The values of positions, normals and albedos."""
    position: np.ndarray
    """(J,) in units of B, along each axis."""
    normal: np.ndarray
    """(J,) [rad], about each tangent axis."""
    albedo: np.ndarray
    """(J,)."""
    view_factor: float = 1.0
    """How many times smaller than stated the standard deviations of Suns, scales and biases are taken to be."""
    scale_scatter: float = np.inf
    """Scales are known to that at least, however they are stated."""
    reflectance: float = np.inf
    """Relative, of every reflectance parameter about its start; nothing where these are held."""

    @property
    def scale_sigma(self) -> np.ndarray:
        """(K,) standard deviations of scales as they are taken to be."""
        return np.minimum(self.scale / self.view_factor, self.scale_scatter)

    def cost(self, estimate: Estimate) -> float:
        """Squared whitened differences, summed."""
        now, start = estimate.views, self.views
        turned, moved = _pose_offset(now, start)
        total = np.sum((turned / self.pose_rotation[:, None]) ** 2)
        total += np.sum((moved / self.pose_translation[:, None]) ** 2)
        total += np.sum(((now.scale - start.scale) / self.scale_sigma) ** 2)
        total += np.sum((self.view_factor * (now.bias - start.bias) / self.bias) ** 2)
        total += np.sum((estimate.parameters / self.reflectance) ** 2)
        points, known = estimate.landmarks, self.landmarks
        i = _finite(self.position)
        total += np.sum(((points.position[i] - known.position[i]) / self.position[i, None]) ** 2)
        i = _finite(self.normal)
        tilt, _ = _tilt(points.normal[i], known.normal[i])
        total += np.sum((tilt / self.normal[i, None]) ** 2)
        i = _finite(self.albedo)
        return float(total + np.sum(((points.albedo[i] - known.albedo[i]) / self.albedo[i]) ** 2))

    def of_cameras(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Blocks (K, 10, 10) and gradient (K, 10) by view."""
        now, start = estimate.views, self.views
        count = len(now)
        turned, moved = _pose_offset(now, start)
        free = np.full((count, 2), np.inf)
        rotation, translation = np.tile(self.pose_rotation, (3, 1)).T, np.tile(self.pose_translation, (3, 1)).T
        sigma = np.column_stack([rotation, translation, free, self.scale_sigma, self.bias / self.view_factor])
        nothing = np.zeros((count, 2))
        offset = np.column_stack([turned, moved, nothing, now.scale - start.scale, now.bias - start.bias])
        rows = np.tile(np.eye(CAMERA_SIZE), (count, 1, 1))
        rows[:, 3:6, :3] = -skew(now.body_from_cam.translation - estimate.pivot)
        block = np.einsum("kri,kr,krj->kij", rows, sigma**-2.0, rows)
        return block, np.einsum("kri,kr,kr->ki", rows, sigma**-2.0, offset)

    def add_landmarks(self, estimate: Estimate, block: np.ndarray, rest: np.ndarray, gradient: np.ndarray) -> None:
        """Adds to the landmarks' blocks (J, 6, 6), to the part of these that is not from observations, and to their
        gradients (J, 6)."""
        points, known = estimate.landmarks, self.landmarks
        i = _finite(self.position)
        weight = self.position[i] ** -2.0
        gradient[i, :3] += weight[:, None] * (points.position[i] - known.position[i])
        for part in (block, rest):
            part[i[:, None], range(3), range(3)] += weight[:, None]
        i = _finite(self.normal)
        tilt, by_step = _tilt(points.normal[i], known.normal[i])
        weight = self.normal[i] ** -2.0
        gradient[i, 3:5] += weight[:, None] * np.einsum("nri,nr->ni", by_step, tilt)
        for part in (block, rest):
            part[i, 3:5, 3:5] += weight[:, None, None] * np.einsum("nri,nrj->nij", by_step, by_step)
        i = _finite(self.albedo)
        weight = self.albedo[i] ** -2.0
        gradient[i, 5] += weight * (points.albedo[i] - known.albedo[i])
        for part in (block, rest):
            part[i, 5, 5] += weight


def _finite(sigma: np.ndarray) -> np.ndarray:
    return np.flatnonzero(np.isfinite(sigma))


def _pose_offset(now: Views, start: Views) -> tuple[np.ndarray, np.ndarray]:
    """Turn (K, 3) [rad] and move (K, 3) from `start` to `now`, in B.

    The turn is the rotation vector: its derivative by omega is the identity up to half its length, which the
    tightness of any useful pose prior keeps below 1e-3.
    """
    turn = so3_log(now.body_from_cam.rotation @ np.swapaxes(start.body_from_cam.rotation, -1, -2))
    return turn, now.body_from_cam.translation - start.body_from_cam.translation


def _tilt(now: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals (n, 3) in the tangent plane of others: (n, 2) and the derivative (n, 2, 2) by a step on the sphere."""
    basis = tangent_basis(start)
    return np.einsum("nir,ni->nr", basis, now), np.einsum("nir,nij->nrj", basis, tangent_basis(now))
