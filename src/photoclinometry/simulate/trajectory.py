"""Camera poses and Sun directions of the simulated exposures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, so3_exp, sphere_step, unit

_DISTANCE_SPREAD = 0.05
"""Largest relative variation of the distance to the site."""
_MAX_JITTER = 2.0
"""Largest pointing error along an axis [standard deviations]."""
_MAX_JITTER_CORNER = 3.0
"""Largest pointing error along a diagonal, rounded up [standard deviations]."""
_EDGE_PX = 8.0
"""Ground kept beyond the frame, for the point-spread function and smear [px]."""
_LOWEST_GROUND = 0.025
"""Depth of the ground below the sphere, as a share of the width of an image."""


@dataclass(frozen=True, kw_only=True)
class Lighting:
    """The variation of the Sun's direction between exposures."""

    azimuth_spread_deg: float
    """Full range of the Sun's azimuth."""
    incidence_deg: tuple[float, float]
    """Range of the incidence angle on level ground at the site."""


LIGHTING = {
    "moderate": Lighting(azimuth_spread_deg=25.0, incidence_deg=(30.0, 60.0)),
    "strong": Lighting(azimuth_spread_deg=90.0, incidence_deg=(25.0, 70.0)),
    "harsh": Lighting(azimuth_spread_deg=360.0, incidence_deg=(25.0, 80.0)),
}


def named_lighting(name: str) -> Lighting:
    """The lighting of that name. Raises InputError for others."""
    if name not in LIGHTING:
        raise InputError(f"no lighting {name!r}; known: {', '.join(LIGHTING)}")
    return LIGHTING[name]


def looking_at(
    center: np.ndarray, target: np.ndarray, roll: float, north: tuple[float, ...] | np.ndarray = (0.0, 1.0, 0.0)
) -> Rigid:
    """body_from_cam of a camera at `center` (3,) that looks at `target` (3,).

    roll [rad]: at 0, up in the image is as close to `north` as possible, by default B's y axis.
    """
    forward = unit(target - center)
    right = unit(np.cross(forward, north))
    down = np.cross(forward, right)
    turned = np.cos(roll) * right + np.sin(roll) * down
    return Rigid(np.stack([turned, np.cross(forward, turned), forward], -1), np.asarray(center, float))


def draw_poses(
    rng: np.random.Generator,
    distances: np.ndarray,
    camera: Camera,
    max_emission: np.ndarray,
    pointing_jitter_px: float,
) -> Rigid:
    """(K,) body_from_cam of views of the origin of B.

    Azimuths advance by the golden angle, emission angles fill the disk evenly up to `max_emission` (K,) [rad],
    `distances` (K,) [m] vary by 5 percent, boresights miss the origin by a few pixels, rolls are uniform.
    """
    count = len(distances)
    order = rng.permutation(count)
    emission = max_emission * np.sqrt((order + 0.5) / count)
    azimuth = order * math.pi * (3.0 - math.sqrt(5.0)) + rng.uniform(0.0, 2.0 * math.pi)
    far = distances * rng.uniform(1.0 - _DISTANCE_SPREAD, 1.0 + _DISTANCE_SPREAD, count)
    direction = np.stack([np.sin(emission) * np.cos(azimuth), np.sin(emission) * np.sin(azimuth), np.cos(emission)], -1)
    center = far[:, None] * direction
    jitter = np.clip(rng.standard_normal((count, 2)), -_MAX_JITTER, _MAX_JITTER) * pointing_jitter_px
    target = np.zeros((count, 3))
    target[:, :2] = jitter * (far / np.mean(camera.focal_px))[:, None]
    roll = rng.uniform(0.0, 2.0 * math.pi, count)
    poses = [looking_at(*view) for view in zip(center, target, roll, strict=True)]
    return Rigid(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))


def draw_suns(rng: np.random.Generator, count: int, lighting: Lighting) -> np.ndarray:
    """(K, 3) unit vectors towards the Sun in B."""
    half = 0.5 * math.radians(lighting.azimuth_spread_deg)
    azimuth = rng.uniform(0.0, 2.0 * math.pi) + half * _spread(rng, count)
    low, high = np.radians(lighting.incidence_deg)
    incidence = 0.5 * (low + high) + 0.5 * (high - low) * _spread(rng, count)
    return np.stack([np.sin(incidence) * np.cos(azimuth), np.sin(incidence) * np.sin(azimuth), np.cos(incidence)], -1)


def measure_suns(
    rng: np.random.Generator, sun: np.ndarray, body_from_cam: Rigid, sigma: float, common_sigma: float
) -> np.ndarray:
    """(K, 3) unit vectors in C as an attitude sensor gives them: off by sigma [rad] about two axes, each by itself, and
    all by one rotation of common_sigma [rad] about each axis of C."""
    in_cam = np.einsum("kij,ki->kj", body_from_cam.rotation, sun)
    noisy = sphere_step(in_cam, sigma * rng.standard_normal((len(sun), 2)))
    return noisy @ so3_exp(common_sigma * rng.standard_normal(3)).T


def _spread(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count,) values spread evenly over [-1, 1], in random order."""
    return 2.0 * (rng.permutation(count) + rng.random(count)) / count - 1.0


def ground_half_extent(
    camera: Camera, distance: float, max_emission: float, pointing_jitter_px: float, radius: float
) -> float:
    """Largest distance from the origin, in x or y [m], at which a view of `draw_poses` sees a sphere of `radius` [m].

    The worst case combines the greatest distance and emission angle [rad], the greatest pointing error, a corner of
    the image turned away from nadir, and ground below the sphere by 2.5 percent of the image's width.
    """
    focal = float(np.mean(camera.focal_px))
    corner = np.array([[x, y] for x in (0, camera.width) for y in (0, camera.height)], float)
    farthest = float(np.linalg.norm(camera.ray_in_cam(corner)[:, :2], axis=1).max())
    off_axis = focal * farthest + _MAX_JITTER_CORNER * pointing_jitter_px + _EDGE_PX
    far = (1.0 + _DISTANCE_SPREAD) * distance
    low = radius - _LOWEST_GROUND * max(camera.width, camera.height) * far / focal
    center = np.array([far * math.sin(max_emission), radius + far * math.cos(max_emission)])
    angle = -max_emission - math.atan(off_axis / focal)
    ray = np.array([math.sin(angle), -math.cos(angle)])
    along = -center @ ray
    inside = low * low - (center @ center - along * along)
    if inside <= 0:
        raise InputError(
            f"the images see past the edge of a body of radius {radius:.4g} m; choose smaller images "
            "or a finer ground sample distance"
        )
    return abs(float((center + (along - math.sqrt(inside)) * ray)[0]))
