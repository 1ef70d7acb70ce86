"""Priors as groups of factors: prior knowledge of poses, exposures, landmarks and the reflectance.

Each is Gaussian about a given value. An infinite standard deviation leaves a variable free, a tiny one holds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from photoclinometry.adjust.graph.general import JacobianBlock, Rows
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, VIEW_SIZE, Estimate
from photoclinometry.model.geometry import Rigid, skew, so3_log, tangent_basis
from photoclinometry.model.scene import Landmarks

_HELD = 1e-12
"""Standard deviation that holds the part of a common error which is known to be zero [rad, units of B]."""


@dataclass(frozen=True, kw_only=True)
class PosePriors:
    """Poses known beforehand, such as those of spacecraft navigation, in the frame B of the estimate."""

    body_from_cam: Rigid
    """(K,)."""
    rotation_sigma: np.ndarray
    """(K,) [rad], about each axis; infinite where nothing is known."""
    center_sigma: np.ndarray
    """(K,) in units of B, along each axis; infinite where nothing is known."""
    common_rotation_sigma: float = 0.0
    """[rad] of a common rotation error in C of all attitudes of an arc, about each axis."""
    common_center_sigma: float = 0.0
    """In units of B, of a common shift in B of all centres of an arc, along each axis."""
    arc: np.ndarray | None = None
    """(K,) int: number of each view's arc; None where all are of one."""
    name: str = "pose prior"

    @property
    def common_errors(self) -> int:
        """Number of arcs with a common error; each has one of the first of the estimate's systematic errors: rotation 3
        and shift 3."""
        if self.common_rotation_sigma <= 0.0 and self.common_center_sigma <= 0.0:
            return 0
        return 1 if self.arc is None else int(self.arc.max()) + 1

    def rows(self, estimate: Estimate) -> list[Rows]:
        known = np.isfinite(self.rotation_sigma) | np.isfinite(self.center_sigma)
        which = np.flatnonzero(known)
        prior, sigma = self.body_from_cam[which], (self.rotation_sigma[which], self.center_sigma[which])
        alone = pose_rows(estimate, which, prior, *sigma)
        count = self.common_errors
        if not count:
            return [alone]
        arc = np.zeros(len(which), int) if self.arc is None else self.arc[which]
        by_common = np.zeros((len(which), 6, 6))
        by_common[:, :3, :3] = -prior.rotation / sigma[0][:, None, None]
        by_common[:, 3:, 3:] = -np.eye(3) / sigma[1][:, None, None]
        common = estimate.systematic[:count, :6]
        sigmas = np.repeat([self.common_rotation_sigma, self.common_center_sigma], 3)
        whiten = 1.0 / np.where(sigmas > 0.0, sigmas, _HELD)
        moved = (by_common @ common[arc][..., None])[..., 0]
        stated = np.tile(np.diag(whiten), (count, 1, 1))
        return [
            Rows(alone.residual + moved, (*alone.touches, JacobianBlock("systematic", arc, by_common))),
            Rows(whiten * common, (JacobianBlock("systematic", np.arange(count), stated),)),
        ]


@dataclass(frozen=True, kw_only=True)
class KnownPoses:
    """Poses of a larger model of other measurements, with their covariances.

    Images determine a camera's line of sight far better than its position: rotation and centre together are known much
    better than each.
    """

    body_from_cam: Rigid
    """(K,)."""
    covariance: np.ndarray
    """(K, 6, 6) of rotation vector [rad] and centre [units of B], both about the camera's own axes."""
    name: str = "known pose"

    def rows(self, estimate: Estimate) -> list[Rows]:
        pose, known = estimate.views.body_from_cam, self.body_from_cam
        into = np.swapaxes(known.rotation, -1, -2)
        turned = so3_log(pose.rotation @ into)
        moved = pose.translation - known.translation
        off = np.concatenate([_along(into, turned), _along(into, moved)], axis=1)
        jacobian = np.zeros((len(off), 6, VIEW_SIZE))
        jacobian[..., :6] = pose_along_axes(into, pose.translation - estimate.pivot)
        whiten = self._whiten
        return [Rows(_along(whiten, off), (JacobianBlock("view", np.arange(len(off)), whiten @ jacobian),))]

    @cached_property
    def _whiten(self) -> np.ndarray:
        """(K, 6, 6)."""
        return np.linalg.inv(np.linalg.cholesky(self.covariance))


@dataclass(frozen=True, kw_only=True)
class Gauge:
    """Holds the similarity that images leave open: by the reference view's pose, and one landmark for the scale."""

    view: int
    body_from_cam: Rigid
    """() of that view."""
    rotation_sigma: float
    """[rad]."""
    center_sigma: float
    """In units of B."""
    landmark: int
    position: np.ndarray
    """(3,) of that landmark."""
    position_sigma: float
    """In units of B."""
    name: str = "gauge"

    def rows(self, estimate: Estimate) -> list[Rows]:
        pose = Rigid(self.body_from_cam.rotation[None], self.body_from_cam.translation[None])
        sigma = np.array([self.rotation_sigma]), np.array([self.center_sigma])
        return [
            pose_rows(estimate, np.array([self.view]), pose, *sigma),
            position_rows(estimate, np.array([self.landmark]), self.position[None], np.array([self.position_sigma])),
        ]


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """Brightness scales about 1 and biases about 0."""

    scale_sigma: np.ndarray
    """(K,)."""
    bias_sigma: np.ndarray
    """(K,) in the images' brightness."""
    name: str = "exposure"

    def rows(self, estimate: Estimate) -> list[Rows]:
        views, count = estimate.views, len(estimate.views)
        jacobian = np.zeros((count, 2, VIEW_SIZE))
        jacobian[:, 0, 8], jacobian[:, 1, 9] = 1.0 / self.scale_sigma, 1.0 / self.bias_sigma
        residual = np.column_stack([(views.scale - 1.0) / self.scale_sigma, views.bias / self.bias_sigma])
        return [Rows(residual, (JacobianBlock("view", np.arange(count), jacobian),))]


@dataclass(frozen=True, kw_only=True)
class LandmarkPriors:
    """Landmarks about given positions, normals and albedos."""

    landmarks: Landmarks
    """(J,) the values."""
    position_sigma: np.ndarray
    """(J,) in units of B, along each axis."""
    normal_sigma: np.ndarray
    """(J,) [rad], about each tangent axis."""
    albedo_sigma: np.ndarray
    """(J,)."""
    name: str = "landmark prior"

    def rows(self, estimate: Estimate) -> list[Rows]:
        known, now = self.landmarks, estimate.landmarks
        out = []
        which = np.flatnonzero(np.isfinite(self.position_sigma))
        if len(which):
            out.append(position_rows(estimate, which, known.position[which], self.position_sigma[which]))
        which = np.flatnonzero(np.isfinite(self.normal_sigma))
        if len(which):
            tilt, by_step = _tilt(now.normal[which], known.normal[which])
            sigma = self.normal_sigma[which, None]
            jacobian = np.zeros((len(which), 2, LANDMARK_SIZE))
            jacobian[:, :, 3:5] = by_step / sigma[..., None]
            out.append(Rows(tilt / sigma, (JacobianBlock("landmark", which, jacobian),)))
        which = np.flatnonzero(np.isfinite(self.albedo_sigma))
        if len(which):
            sigma = self.albedo_sigma[which, None]
            jacobian = np.zeros((len(which), 1, LANDMARK_SIZE))
            jacobian[:, :, 5] = 1.0 / sigma
            residual = (now.albedo[which] - known.albedo[which])[:, None] / sigma
            out.append(Rows(residual, (JacobianBlock("landmark", which, jacobian),)))
        return out


@dataclass(frozen=True, kw_only=True)
class ReflectancePrior:
    """Relative changes of the reflectance parameters about zero."""

    sigma: float
    name: str = "reflectance prior"

    def rows(self, estimate: Estimate) -> list[Rows]:
        count = len(estimate.parameters)
        if count == 0:
            return []
        touch = JacobianBlock("parameter", np.zeros(1, int), np.eye(count)[None] / self.sigma)
        return [Rows(estimate.parameters[None] / self.sigma, (touch,))]


def pose_rows(
    estimate: Estimate, which: np.ndarray, known: Rigid, rotation_sigma: np.ndarray, center_sigma: np.ndarray
) -> Rows:
    """Poses of views `which` (n,) less those that are known (n,), rotation 3 and centre 3.

    The residual of a rotation is the rotation vector: its derivative by omega is the identity up to half its length,
    which the tightness of any useful pose prior keeps below 1e-3.
    """
    pose = estimate.views.body_from_cam[which]
    turned = so3_log(pose.rotation @ np.swapaxes(known.rotation, -1, -2))
    sigma = np.concatenate([np.tile(rotation_sigma, (3, 1)).T, np.tile(center_sigma, (3, 1)).T], axis=1)
    jacobian = np.zeros((len(which), 6, VIEW_SIZE))
    jacobian[:, range(6), range(6)] = 1.0
    jacobian[:, 3:6, :3] = -skew(pose.translation - estimate.pivot)
    residual = np.concatenate([turned, pose.translation - known.translation], axis=1) / sigma
    return Rows(residual, (JacobianBlock("view", which, jacobian / sigma[..., None]),))


def position_rows(estimate: Estimate, which: np.ndarray, known: np.ndarray, sigma: np.ndarray) -> Rows:
    """Positions of landmarks `which` (n,) less those that are known (n, 3), over sigma (n,) or (n, 3)."""
    sigma = np.broadcast_to(sigma[:, None] if sigma.ndim == 1 else sigma, known.shape)
    jacobian = np.zeros((len(which), 3, LANDMARK_SIZE))
    jacobian[:, range(3), range(3)] = 1.0 / sigma
    residual = (estimate.landmarks.position[which] - known) / sigma
    return Rows(residual, (JacobianBlock("landmark", which, jacobian),))


def pose_along_axes(axes: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """(K, 6, 6) derivatives of rotation vectors and centres along axes (K, 3, 3) by orbit and shift of the cameras.

    arm: (K, 3) from the pivot to the centres.
    """
    out = np.zeros((len(arm), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = axes
    out[:, 3:, :3] = -axes @ skew(arm)
    return out


def _along(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(K, m) products of matrices (K, m, n) and vectors (K, n)."""
    return np.einsum("kmn,kn->km", axes, vectors)


def _tilt(now: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals (n, 3) in the tangent plane of others: (n, 2) and the derivative (n, 2, 2) by a step on the sphere."""
    basis = tangent_basis(start)
    return np.einsum("nir,ni->nr", basis, now), np.einsum("nir,nij->nrj", basis, tangent_basis(now))
