"""Rays of a map's views through the box around its ground, and samples along them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.geometry import Rigid
from photoclinometry.model.scene import Scene, Views
from photoclinometry.rivals.radiance.field import Rays
from photoclinometry.surface.relief import local_frame

MARGIN = 4.0
"""Of the box around the landmarks [landmark spacings], in which the field is free to find the surface anew."""

BELOW = 1e6
"""Length of the last step of a ray [sides of the box]: opaque at any density."""


@dataclass(frozen=True)
class Box:
    """A cube whose lower part holds the ground: x and y along the map's mean plane, z up."""

    frame: Rigid
    """B from the frame of the box, whose origin is the cube's lowest corner."""
    side: float
    top: float
    """Height above which there is no ground, in sides."""

    @classmethod
    def around(cls, scene: Scene) -> Box:
        """The box around a map."""
        local = local_frame(scene)
        points = local.inverse()(scene.landmarks.position)
        low, high = points.min(0) - MARGIN * scene.spacing, points.max(0) + MARGIN * scene.spacing
        side = float((high - low).max())
        return cls(local @ Rigid(np.eye(3), low), side, float(high[2] - low[2]) / side)

    def rays(self, views: Views, k: int, pixels: np.ndarray) -> Crossings:
        """Points where rays of a view through pixels (n, 2) (x, y) cross the box's top and bottom."""
        from_cam = self.frame.inverse() @ views.body_from_cam[k]
        ray = from_cam.rotation @ np.moveaxis(views.cameras[k].ray_in_cam(pixels), -1, 0)
        direction = (ray / np.linalg.norm(ray, axis=0)).T
        center = from_cam.translation / self.side
        enter, leave = ((height - center[2]) / direction[:, 2] for height in (self.top, 0.0))
        return Crossings(np.broadcast_to(center, direction.shape), direction, enter, leave)


@dataclass(frozen=True)
class Crossings:
    """n rays and the distances between which they are in the box, in its sides."""

    center: np.ndarray
    """(n, 3)."""
    direction: np.ndarray
    """(n, 3) unit vectors."""
    enter: np.ndarray
    """(n,)."""
    leave: np.ndarray
    """(n,)."""

    def __getitem__(self, rows: np.ndarray | slice) -> Crossings:
        return Crossings(self.center[rows], self.direction[rows], self.enter[rows], self.leave[rows])

    def sampled(self, share: np.ndarray) -> Rays:
        """Samples at (n, S) shares of the way through the box, in their order; each stands for an equal part of it, the
        last one for all below the box, so that nothing is seen through the ground."""
        along = self.distances(share)
        places = self.center[:, None] + along[..., None] * self.direction[:, None]
        steps = np.repeat(((self.leave - self.enter) / share.shape[1])[:, None], share.shape[1], axis=1)
        steps[:, -1] = BELOW
        return Rays(places.astype(np.float32), steps.astype(np.float32), self.direction)

    def distances(self, share: np.ndarray) -> np.ndarray:
        """(n, S) from the camera, in sides."""
        return self.enter[:, None] + share * (self.leave - self.enter)[:, None]


def joined(parts: list[Crossings]) -> Crossings:
    """The rays of several views, one after another."""
    return Crossings(*(np.concatenate([getattr(part, name) for part in parts]) for name in Crossings.__annotations__))
