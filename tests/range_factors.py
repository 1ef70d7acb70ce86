"""A group of factors that somebody adds to the graph: measured ranges, without a kernel."""

from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust.graph.general import JacobianBlock, Rows


@dataclass(frozen=True)
class Ranges:
    """Measured distances from views to landmarks."""

    view: np.ndarray
    landmark: np.ndarray
    distance: np.ndarray
    sigma: float
    name: str = "range"

    def rows(self, estimate):
        center, position = estimate.views.body_from_cam.translation[self.view], estimate.landmarks.position
        offset = position[self.landmark] - center
        distance = np.linalg.norm(offset, axis=1)
        along = offset / distance[:, None] / self.sigma
        by_view, by_landmark = np.zeros((2, len(along), 1, 10)), np.zeros((len(along), 1, 6))
        by_view = by_view[0]
        by_view[:, 0, :3] = np.cross(along, center - estimate.pivot)
        by_view[:, 0, 3:6] = -along
        by_landmark[:, 0, :3] = along
        residual = ((distance - self.distance) / self.sigma)[:, None]
        blocks = JacobianBlock("view", self.view, by_view), JacobianBlock("landmark", self.landmark, by_landmark)
        return [Rows(residual, blocks)]
