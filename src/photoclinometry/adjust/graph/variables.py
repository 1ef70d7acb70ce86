"""A value for every variable of the joint estimate, and its change by a step in local coordinates."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from photoclinometry.model.geometry import Rigid, so3_exp, sphere_step
from photoclinometry.model.scene import Landmarks, Views

VIEW_SIZE = 10
"""Local coordinates of a view: orbit about the pivot 3, shift 3, Sun 2, scale 1, bias 1."""
LANDMARK_SIZE = 6
"""Local coordinates of a landmark: position 3, normal 2, albedo 1."""


@dataclass(frozen=True)
class Estimate:
    """A value for every variable."""

    views: Views
    landmarks: Landmarks
    pivot: np.ndarray
    """(3,) the point in B about which cameras orbit; any point in the middle of the map."""
    parameters: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(T,) relative changes of the reflectance parameters that are estimated, from their start."""
    systematic: np.ndarray = field(default_factory=lambda: np.zeros((0, VIEW_SIZE)))
    """(M, 10) errors that many measurements share, such as the shift of an altimeter's track. A group of factors uses
    only the numbers that its error has; the others stay zero."""

    def step(self, view: np.ndarray, landmark: np.ndarray, parameter: np.ndarray | float = 0.0) -> Estimate:
        """Moved by local coordinates (K + M, 10) and (J, 6), as `factors` defines them, and (T,).

        Systematic errors follow the views: the solver eliminates both last. They are added.
        """
        views, landmarks = self.views, self.landmarks
        view, systematic = view[: len(views)], view[len(views) :]
        pose = views.body_from_cam
        turn = so3_exp(view[:, :3])
        arm = np.einsum("kij,kj->ki", turn, pose.translation - self.pivot + view[:, 3:6])
        moved = Rigid(turn @ pose.rotation, self.pivot + arm)
        return Estimate(
            replace(
                views,
                body_from_cam=moved,
                sun=sphere_step(views.sun, view[:, 6:8]),
                scale=views.scale + view[:, 8],
                bias=views.bias + view[:, 9],
            ),
            replace(
                landmarks,
                position=landmarks.position + landmark[:, :3],
                normal=sphere_step(landmarks.normal, landmark[:, 3:5]),
                albedo=landmarks.albedo + landmark[:, 5],
            ),
            self.pivot,
            self.parameters + parameter,
            self.systematic + systematic,
        )
