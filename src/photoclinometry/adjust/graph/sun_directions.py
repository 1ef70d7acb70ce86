"""Measured Sun directions as a group of factors: errors of each view's own, and one that all of an arc share.

Suns of one arc of a spacecraft come from one alignment, one attitude solution and one frame of the body. Errors of
these turn all Suns alike, by much more than the scatter of attitudes from image to image.
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
    """Measured Suns of K views (Eqs. 33-34). Errors are each view's own, and one rotation of all Suns of an arc."""

    measured: np.ndarray
    """(K, 3) unit vectors towards the Sun, in C."""
    sigma: np.ndarray
    """(K,) of each view's own error, along each of two axes [rad]."""
    common_sigma: np.ndarray
    """(K,) of its arc's common rotation, about each of three axes [rad]; zeros where there is none."""
    arc: np.ndarray
    """(K,) int: number of each view's arc."""
    weight: float = 1.0
    """Factor by which the assumed standard deviations are smaller than the stated ones."""
    name: str = "sun"

    @classmethod
    def of(cls, views: Views, weight: float = 1.0) -> SunDirections:
        """The measured Suns of some views."""
        return cls(
            measured=views.sun_measured,
            sigma=views.sun_sigma,
            common_sigma=views.sun_common_sigma,
            arc=views.arc,
            weight=weight,
        )

    def rows(self, estimate: Estimate) -> list[Rows]:
        residual, by_turn_and_sun = self.alone(estimate.views)
        count = len(residual)
        jacobian = np.zeros((count, 2, VIEW_SIZE))
        jacobian[:, :, [0, 1, 2, 6, 7]] = self.weight * by_turn_and_sun
        residual *= self.weight
        return [self._rows_of(which, residual[which], jacobian[which]) for which in self.arcs]

    def _rows_of(self, which: np.ndarray, residual: np.ndarray, jacobian: np.ndarray) -> Rows:
        """Of one arc's views (n,): residuals (n, 2) and Jacobians (n, 2, 10) over each view's own sigma."""
        if not self.common_sigma[which].any():
            return Rows(residual, (JacobianBlock("view", which, jacobian),))
        parted = self.parted(which)
        touches = tuple(
            JacobianBlock("view", which[n : n + 1], (parted[:, 2 * n : 2 * n + 2] @ jacobian[n])[None])
            for n in range(len(which))
        )
        return Rows((parted @ residual.ravel())[None], touches)

    @property
    def arcs(self) -> list[np.ndarray]:
        """Indices of the views of each arc, by its number."""
        return [np.flatnonzero(self.arc == number) for number in np.unique(self.arc)]

    def alone(self, views: Views) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (K, 2) and Jacobians (K, 2, 5) over each view's own sigma, see `factors.sun_direction`."""
        return sun_direction(views.body_from_cam.rotation, views.sun, self.measured, self.sigma)

    def parted(self, which: np.ndarray) -> np.ndarray:
        """(2 n + 3, 2 n) of the n views `which` of an arc: from their residuals r over their own sigmas to r - A w and
        w, which minimise |r - A w|^2 + |w|^2.

        A (2 n, 3) is the change of r by a rotation w of all these Suns in C, in its standard deviations. The minimum is
        r^T (I + A A^T)^-1 r, the cost of Gaussian errors with these two parts.
        """
        share = self.common_sigma[which] / self.sigma[which]
        across = np.swapaxes(tangent_basis(self.measured[which]), 1, 2)
        changes = (share[:, None, None] * (across @ skew(self.measured[which]))).reshape(-1, 3)
        common = np.linalg.solve(np.eye(3) + changes.T @ changes, changes.T)
        return np.concatenate([np.eye(len(changes)) - changes @ common, common])


def sun_offsets(views: Views) -> tuple[np.ndarray, np.ndarray]:
    """Differences of Suns from the measured ones, in standard deviations: each view's own part (K, 2), and the common
    rotations (A, 3) in C of all Suns of each of A arcs, divided in the most probable way.

    Their squares sum to the cost. Arcs are in the order of their numbers (`np.unique(views.arc)`).
    """
    suns = SunDirections.of(views)
    residual = suns.alone(views)[0]
    own, common = np.empty_like(residual), []
    for which in suns.arcs:
        both = suns.parted(which) @ residual[which].ravel()
        own[which] = both[:-3].reshape(-1, 2)
        common.append(both[-3:])
    return own, np.array(common)


def unexplained_variance(views: Views, variance: np.ndarray) -> np.ndarray:
    """(K,) variances [rad2] of errors of Suns that neither their measurements nor `variance` (K,) allow for.

    All are of each of two axes; variance: stated for the estimated Suns. Estimated and measured Suns may differ by
    either one's error. A typical difference beyond that is due to an error of the brightness that moved them.
    """
    move = sun_offsets(views)[0] * views.sun_sigma[:, None]
    allowed = views.sun_sigma**2 + variance
    return allowed * max(0.0, robust_sigma(move / np.sqrt(allowed)[:, None]) ** 2 - 1.0)


def common_turns(views: Views, arc: np.ndarray) -> np.ndarray:
    """(n, 3) rotation vectors in C from the measured Suns of arcs (n,) to the estimated ones, as far as the turn is
    common to the arc [rad]; zero for arcs without a common error, or of no view."""
    number, index = np.unique(views.arc, return_inverse=True)
    sigma = np.zeros(len(number))
    np.maximum.at(sigma, index, views.sun_common_sigma)
    turns = -sigma[:, None] * sun_offsets(views)[1]
    return np.where(arc[:, None] == number, 1.0, 0.0) @ turns
