"""Ground control points: places of known position that can be identified in images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust.graph.general import Rows
from photoclinometry.adjust.graph.priors import position_rows
from photoclinometry.adjust.graph.variables import Estimate


@dataclass(frozen=True, kw_only=True)
class ControlPoints:
    """Position minus known position over sigma. The pixels where points are seen are `Keypoints` of these landmarks."""

    landmark: np.ndarray
    """(n,) index of each point's landmark."""
    position: np.ndarray
    """(n, 3) known, in the estimate's frame B."""
    sigma: np.ndarray
    """(n, 3) standard deviations along the axes of B."""
    name: str = "control point"

    def rows(self, estimate: Estimate) -> list[Rows]:
        return [position_rows(estimate, self.landmark, self.position, self.sigma)]
