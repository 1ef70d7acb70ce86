"""Rigid transforms, rotations and steps on the unit sphere. Batch axes come first everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import SupportsIndex

import numpy as np

METRES = {"m": 1.0, "km": 1000.0}
"""Metres in one unit of length, by its name in files."""

KM_PER_M = 1e-3
"""Kilometres per metre, for formats whose lengths are in km: `1 / METRES["km"]`."""


@dataclass(frozen=True)
class Rigid:
    """target_from_source: x_target = rotation @ x_source + translation (paper Eq. 1)."""

    rotation: np.ndarray
    """(..., 3, 3) orthonormal, determinant +1."""
    translation: np.ndarray
    """(..., 3) origin of the source frame, in the target frame."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the source frame, expressed in the target frame."""
        if self.rotation.ndim == 2:  # one transform of many points: a product of matrices
            return points @ self.rotation.T + self.translation
        return np.einsum("...ij,...j->...i", self.rotation, points) + self.translation

    def inverse(self) -> Rigid:
        rotation = np.swapaxes(self.rotation, -1, -2)
        return Rigid(rotation, -np.einsum("...ij,...j->...i", rotation, self.translation))

    def __matmul__(self, other: Rigid) -> Rigid:
        """(a_from_b @ b_from_c) is a_from_c."""
        return Rigid(self.rotation @ other.rotation, self(other.translation))

    def __getitem__(self, index: SupportsIndex | slice | Sequence[int] | np.ndarray) -> Rigid:
        return Rigid(self.rotation[index], self.translation[index])

    def __len__(self) -> int:
        return len(self.translation)


@dataclass(frozen=True)
class Similarity:
    """target_from_source with a scale: x_target = scale * rotation @ x_source + translation."""

    scale: float
    rotation: np.ndarray
    """(3, 3)."""
    translation: np.ndarray
    """(3,), in units of the target."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return self.scale * np.asarray(points) @ self.rotation.T + self.translation

    def inverse(self) -> Similarity:
        return Similarity(1.0 / self.scale, self.rotation.T, -self.rotation.T @ self.translation / self.scale)

    def __matmul__(self, other: Similarity) -> Similarity:
        return Similarity(self.scale * other.scale, self.rotation @ other.rotation, self(other.translation))


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., n) divided by their length. A zero vector gives NaN: callers check first."""
    vectors = np.asarray(vectors, float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle [rad] between vectors (..., 3), accurate near 0 and pi, where arccos is not."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def skew(v: np.ndarray) -> np.ndarray:
    """The hat operator: skew(v) @ x = v x x. (..., 3) -> (..., 3, 3)."""
    zero = np.zeros_like(v[..., 0])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    rows = [np.stack(row, -1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, -2)


def point_moves(points: np.ndarray, about: np.ndarray) -> np.ndarray:
    """(n, 3, 7): moves of points (n, 3) by rotation, translation and scale about a point (3,)."""
    arm = points - about
    return np.concatenate([-skew(arm), np.broadcast_to(np.eye(3), (len(arm), 3, 3)), arm[:, :, None]], axis=2)


def so3_exp(omega: np.ndarray) -> np.ndarray:
    """Rotation (..., 3, 3) by the rotation vector omega (..., 3) [rad] (Rodrigues)."""
    omega = np.asarray(omega, float)
    angle = np.linalg.norm(omega, axis=-1)[..., None, None]
    hat = skew(omega)
    return np.eye(3) + np.sinc(angle / np.pi) * hat + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (hat @ hat)


def so3_log(rotation: np.ndarray) -> np.ndarray:
    """Rotation vector (..., 3) [rad], of length at most pi, of a rotation (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    rotation = np.asarray(rotation, float)
    flat = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(rotation.shape[:-1])


def tangent_basis(direction: np.ndarray) -> np.ndarray:
    """Orthonormal basis (..., 3, 2) of the plane tangent to the sphere at unit vectors (..., 3).

    Duff et al. (2017), "Building an Orthonormal Basis, Revisited": smooth except across z = 0.
    """
    x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], -1)
    second = np.stack([b, sign + y * y * a, -y], -1)
    return np.stack([first, second], -1)


def sphere_step(direction: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) moved along their great circles by step (..., 2) [rad] in
    `tangent_basis` (paper Eq. 5)."""
    move = np.einsum("...ij,...j->...i", tangent_basis(direction), step)
    angle = np.linalg.norm(move, axis=-1, keepdims=True)
    return unit(np.cos(angle) * direction + np.sinc(angle / np.pi) * move)


def align_similarity(source: np.ndarray, target: np.ndarray, weight: np.ndarray | None = None) -> Similarity:
    """The least-squares target_from_source similarity between paired points (n, 3), n >= 3.

    weight: (n,) of each pair's squared distance; equal ones by default. Raises ValueError for fewer points.
    """
    source, target = np.asarray(source, float), np.asarray(target, float)
    if len(source) < 3:
        raise ValueError(f"a similarity needs at least 3 point pairs, got {len(source)}")
    scale, rotation, translation = similarities_of(source, target, weight)
    return Similarity(float(scale), rotation, translation)


def similarities_of(
    source: np.ndarray, target: np.ndarray, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least-squares target_from_source similarities between paired points (..., n, 3), n >= 3: scales (...), rotations
    (..., 3, 3) and translations (..., 3). Those of points at one place are NaN. weight: (n,), equal ones by default.

    Umeyama (1991), IEEE PAMI 13(4), Eqs. 39-42.
    """
    share = np.full(source.shape[-2], 1.0 / source.shape[-2]) if weight is None else weight / np.sum(weight)
    source_mean, target_mean = share @ source, share @ target
    root = np.sqrt(share)[:, None]
    a, b = root * (source - source_mean[..., None, :]), root * (target - target_mean[..., None, :])
    u, singular, vt = np.linalg.svd(np.swapaxes(b, -1, -2) @ a)
    sign = np.ones(singular.shape)
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * sign[..., None, :]) @ vt
    extent = (a**2).sum((-2, -1))
    scale = (singular * sign).sum(-1) / np.where(extent > 0.0, extent, np.nan)
    return scale, rotation, target_mean - scale[..., None] * (rotation @ source_mean[..., None])[..., 0]
