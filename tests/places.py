"""A scene on a known place of Vesta: its ground has three craters, whose longitudes and latitudes are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.model.geometry import Similarity, unit
from photoclinometry.model.scene import Scene
from photoclinometry.registration.alignment import transform_scene
from scenes import GSD, synthetic_scene

IAU_RADIUS = 255_000.0
"""Of Vesta's sphere in IAU_2015 [m]."""
RADIUS = IAU_RADIUS + 2_000.0
"""Of the ground between the craters [m]."""
CRATERS = np.array([[0.0, 900.0], [700.0, -300.0], [-650.0, -420.0]])
"""East and north of the site's middle [m]: one in the north, one in the south-east, one in the south-west."""
DEPTH, WIDTH = 120.0, 260.0


@dataclass(frozen=True)
class Place:
    scene: Scene
    """In a frame and a unit of its own."""
    body_from_scene: Similarity
    """To the body-fixed frame [m]."""
    lon_deg: float
    lat_deg: float

    @property
    def craters_deg(self) -> np.ndarray:
        """(3, 2) longitude and latitude of the craters' centres."""
        east, north, up = axes_at(self.lon_deg, self.lat_deg)
        x, y, z = (CRATERS[:, :1] * east + CRATERS[:, 1:] * north + RADIUS * up).T
        return np.degrees(np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], -1))


def axes_at(lon_deg: float, lat_deg: float) -> np.ndarray:
    """(3, 3) unit vectors towards east, north and up, in the body-fixed frame."""
    lon, lat = np.radians(lon_deg), np.radians(lat_deg)
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return np.stack([east, np.cross(up, east), up])


def height(xy: np.ndarray) -> np.ndarray:
    """Heights (...,) of the ground above the tangent plane at east and north (..., 2) [m], curvature included."""
    offset2 = np.sum((xy[..., None, :] - CRATERS) ** 2, -1)
    bowls = -DEPTH * np.exp(-0.5 * offset2 / WIDTH**2).sum(-1)
    return bowls + np.sqrt(RADIUS**2 - np.sum(xy**2, -1)) - RADIUS


def cratered_place(lon_deg: float = 15.6, lat_deg: float = -9.4, size: int = 60, scale: float = GSD) -> Place:
    """The scene, made up but for its landmarks: tracks and images of another ground. scale: metres in its unit."""
    flat = synthetic_scene(size=size, views=3)
    xy = flat.landmarks.position[:, :2]
    step = 1e-2 * np.eye(2)
    slope = np.stack([(height(xy + s) - height(xy - s)) / 2e-2 for s in step], -1)
    landmarks = replace(
        flat.landmarks,
        position=np.concatenate([xy, height(xy)[:, None]], -1),
        normal=unit(np.concatenate([-slope, np.ones((len(xy), 1))], -1)),
    )
    body_from_local = Similarity(1.0, axes_at(lon_deg, lat_deg).T, RADIUS * axes_at(lon_deg, lat_deg)[2])
    turn = unit(np.array([[0.3, 0.9, -0.2]]))[0]
    own = Similarity(1.0 / scale, np.linalg.qr(np.stack([turn, [0.1, 0.2, 1.0], [1.0, 0.0, 0.1]]))[0], np.ones(3))
    if np.linalg.det(own.rotation) < 0:
        own = replace(own, rotation=-own.rotation)
    scene = transform_scene(own, flat.with_estimate(flat.views, landmarks))
    return Place(scene, body_from_local @ own.inverse(), lon_deg, lat_deg)
