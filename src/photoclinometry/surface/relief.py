"""The shape of a map by itself: its mean plane, and heights above it.

The local frame has its origin in the middle of the map: x to the right and y up in the reference image, both
along the mean plane, z out of the ground. Azimuths count clockwise from y ("up in the reference image"),
elevations from the plane; so they are defined before a map is georeferenced.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.robust import REWEIGHTINGS
from photoclinometry.model.scene import Scene
from photoclinometry.model.tiny import TINY


def mean_plane(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A point (3,) and the unit normal (3,), of either sign, of the plane through points (n, 3).

    Least squares reweighted by 1 / (1 + (d / s)^2), s the median distance, so that spikes do not tilt it.
    """
    weight, center, normal = np.ones(len(position)), position.mean(0), np.zeros(3)
    for _ in range(REWEIGHTINGS):
        center = weight @ position / weight.sum()
        offset = position - center
        normal = np.linalg.eigh((offset * weight[:, None]).T @ offset)[1][:, 0]
        distance = np.abs(offset @ normal)
        weight = 1.0 / (1.0 + (distance / max(np.median(distance), TINY)) ** 2)
    return center, normal


def local_frame(scene: Scene) -> Rigid:
    """body_from_local of the map (the module's docstring defines the local frame)."""
    center, up = mean_plane(scene.landmarks.position)
    reference = scene.views.body_from_cam[scene.reference]
    if up @ (reference.translation - center) < 0:
        up = -up
    image_up = -reference.rotation[:, 1]
    north = unit(image_up - (image_up @ up) * up)
    return Rigid(np.stack([np.cross(north, up), north, up], -1), center)


def reference_depth(scene: Scene) -> np.ndarray:
    """(J,) depths of the landmarks along the reference view's optical axis, in units of B."""
    return scene.views.depth(scene.reference, scene.landmarks.position)


def heights(scene: Scene) -> np.ndarray:
    """(J,) of the landmarks above their mean plane, in units of B."""
    return local_frame(scene).inverse()(scene.landmarks.position)[:, 2]


def on_mean_plane(scene: Scene, pixels: np.ndarray) -> np.ndarray:
    """The points (..., 3) in B where the rays of reference pixels (..., 2) meet the map's mean plane."""
    frame, pose = local_frame(scene), scene.views.body_from_cam[scene.reference]
    rays, up = scene.views.cameras[scene.reference].ray_in_cam(pixels) @ pose.rotation.T, frame.rotation[:, 2]
    distance = (frame.translation - pose.translation) @ up / (rays @ up)
    return pose.translation + distance[..., None] * rays


def sun_from_angles(body_from_local: Rigid, azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector (3,) in B from azimuth, clockwise from the local y, and elevation above the plane [rad]."""
    flat = np.cos(elevation)
    local = np.array([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)])
    return body_from_local.rotation @ local


def angles_from_sun(body_from_local: Rigid, sun: np.ndarray) -> tuple[float, float]:
    """Azimuth and elevation [rad] of a direction (3,) of B: the inverse of `sun_from_angles`."""
    x, y, z = sun @ body_from_local.rotation
    return float(np.arctan2(x, y) % (2 * np.pi)), float(np.arctan2(z, np.hypot(x, y)))


def lambert_shade(normal: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """Hillshade (...,) in [0, 1]: the cosine of incidence of normals (..., 3) under a Sun (3,)."""
    return np.clip(normal @ sun, 0.0, 1.0)
