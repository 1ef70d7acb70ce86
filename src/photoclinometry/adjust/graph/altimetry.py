"""Laser altimetry: places where a beam met the ground, along tracks that are shifted as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust.graph.general import JacobianBlock, Rows
from photoclinometry.adjust.graph.variables import LANDMARK_SIZE, Estimate
from photoclinometry.model.geometry import tangent_basis


@dataclass(frozen=True, kw_only=True)
class Altimetry:
    """Distance of each shot from the tangent plane of the landmark that it met, over sigma.

    All shots of a track share the error of the spacecraft's orbit: a shift, whose sigma is known.
    """

    landmark: np.ndarray
    """(n,) index of the landmark nearest to each shot."""
    track: np.ndarray
    """(n,) index of each shot's track."""
    position: np.ndarray
    """(n, 3) as measured, in the estimate's frame B."""
    sigma: np.ndarray
    """(n,) standard deviation of a shot's own error, along the normal."""
    shift_sigma: np.ndarray
    """(L,) standard deviations of the tracks' shifts, along each axis of B."""
    first: int = 0
    """Index of the first track's shift among the systematic errors of the estimate."""
    name: str = "altimetry"

    def rows(self, estimate: Estimate) -> list[Rows]:
        landmarks = estimate.landmarks[self.landmark]
        shift = self.shifts(estimate)
        off = self.position - shift[self.track] - landmarks.position
        by_position = -landmarks.normal / self.sigma[:, None]
        by_landmark = np.zeros((len(off), 1, LANDMARK_SIZE))
        by_landmark[:, 0, :3] = by_position
        by_landmark[:, 0, 3:5] = np.einsum("ni,nij->nj", off, tangent_basis(landmarks.normal)) / self.sigma[:, None]
        known = np.eye(3) / self.shift_sigma[:, None, None]
        number = self.first + np.arange(len(shift))
        return [
            Rows(
                -np.sum(by_position * off, axis=-1, keepdims=True),
                (
                    JacobianBlock("landmark", self.landmark, by_landmark),
                    JacobianBlock("systematic", self.first + self.track, by_position[:, None, :]),
                ),
            ),
            Rows(shift / self.shift_sigma[:, None], (JacobianBlock("systematic", number, known),)),
        ]

    def shifts(self, estimate: Estimate) -> np.ndarray:
        """(L, 3) of the tracks: measured minus true."""
        return estimate.systematic[self.first : self.first + len(self.shift_sigma), :3]
