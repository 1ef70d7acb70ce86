"""Measured Sun directions as a group of factors: errors of each view's own, and one that all have in common.

Suns of one spacecraft come from one alignment, one attitude solution and one frame of the body. What is wrong with
those turns all Suns alike, by much more than attitudes scatter from image to image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust.graph.factors import sun_direction
from photoclinometry.adjust.graph.general import JacobianBlock, Rows
from photoclinometry.adjust.graph.variables import VIEW_SIZE, Estimate
from photoclinometry.model.geometry import skew, tangent_basis
from photoclinometry.model.robust import robust_sigma
from photoclinometry.model.scene import Views


@dataclass(frozen=True, kw_only=True)
class SunDirections:
    """Measured Suns of K views (Eqs. 33-34). Errors are each view's own, and one rotation that all have in common."""

    measured: np.ndarray
    """(K, 3) unit vectors towards the Sun, in C."""
    sigma: np.ndarray
    """(K,) of each view's own error, along each of two axes [rad]."""
    common_sigma: np.ndarray
    """(K,) of the common rotation, about each of three axes [rad]; zeros where there is none."""
    weight: float = 1.0
    """How many times smaller than stated the standard deviations are taken to be."""
    name: str = "sun"

    @classmethod
    def of(cls, views: Views, weight: float = 1.0) -> SunDirections:
        """Those that were measured of some views."""
        return cls(
            measured=views.sun_measured, sigma=views.sun_sigma, common_sigma=views.sun_common_sigma, weight=weight
        )

    def rows(self, estimate: Estimate) -> list[Rows]:
        residual, by_turn_and_sun = self.alone(estimate.views)
        count = len(residual)
        jacobian = np.zeros((count, 2, VIEW_SIZE))
        jacobian[:, :, [0, 1, 2, 6, 7]] = self.weight * by_turn_and_sun
        residual *= self.weight
        if not self.common_sigma.any():
            return [Rows(residual, (JacobianBlock("view", np.arange(count), jacobian),))]
        parted = self.parted()
        touches = tuple(
            JacobianBlock("view", np.array([k]), (parted[:, 2 * k : 2 * k + 2] @ jacobian[k])[None])
            for k in range(count)
        )
        return [Rows((parted @ residual.ravel())[None], touches)]

    def alone(self, views: Views) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (K, 2) and Jacobians (K, 2, 5) over each view's own sigma, see `factors.sun_direction`."""
        return sun_direction(views.body_from_cam.rotation, views.sun, self.measured, self.sigma)

    def parted(self) -> np.ndarray:
        """(2 K + 3, 2 K): from residuals r over their own sigmas to r - A w and w, which minimise |r - A w|^2 + |w|^2.

        A (2 K, 3) has how a rotation w of all Suns in C, in its standard deviations, changes r. The minimum is
        r^T (I + A A^T)^-1 r, the cost of Gaussian errors of which these are the two parts.
        """
        share = self.common_sigma / self.sigma
        across = np.swapaxes(tangent_basis(self.measured), 1, 2)
        changes = (share[:, None, None] * (across @ skew(self.measured))).reshape(-1, 3)
        common = np.linalg.solve(np.eye(3) + changes.T @ changes, changes.T)
        return np.concatenate([np.eye(len(changes)) - changes @ common, common])


def sun_offsets(views: Views) -> tuple[np.ndarray, np.ndarray]:
    """How far Suns are from what was measured, in standard deviations: each view's own part (K, 2), and the rotation by
    which all were measured in C (3,), as the most probable division has them. Their squares sum to the cost."""
    suns = SunDirections.of(views)
    residual = suns.alone(views)[0].ravel()
    both = suns.parted() @ residual
    return both[: len(residual)].reshape(-1, 2), both[len(residual) :]


def unexplained_variance(views: Views, variance: np.ndarray) -> np.ndarray:
    """(K,) variances [rad2] of errors of Suns that neither their measurements nor `variance` (K,) allow for.

    All are of each of two axes; variance: stated of the estimated Suns. Suns may differ from what was measured by
    either one's error. What their differences have beyond that, typically, is an error of the brightness that moved
    them.
    """
    move = sun_offsets(views)[0] * views.sun_sigma[:, None]
    allowed = views.sun_sigma**2 + variance
    return allowed * max(0.0, robust_sigma(move / np.sqrt(allowed)[:, None]) ** 2 - 1.0)


def common_turn(views: Views) -> np.ndarray:
    """The rotation vector (3,) in C by which measured Suns have to be turned to lie where the estimate has them, as far
    as all have it in common [rad]; zero where they have no common error."""
    if not views.sun_common_sigma.any():
        return np.zeros(3)
    return -float(np.max(views.sun_common_sigma)) * sun_offsets(views)[1]
