"""Smooth shapes of small bodies as implicit surfaces: functions that are negative inside and zero on the surface.

Lengths are in units of about the mean radius; z is the axis of rotation. The numbers are chosen by eye, so that the
bodies look like Bennu, Itokawa or Arrokoth, and Eros; nothing in the estimate depends on them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from photoclinometry.surface.closed_mesh import icosahedron, refine

Implicit = Callable[[np.ndarray], np.ndarray]
"""Points (n, 3) -> (n,) values, negative inside; their gradient is about 1 long near the surface."""

_STEP = 1e-5
"""Length of the differences of which gradients are made [radii]."""
_NEWTON_STEPS = 4
"""Steps to the surface at most; new points lie near it already."""
_STILL = 1e-6
"""Points this near to the surface are on it [radii]."""
_FIRST_SPACING = 0.25
"""Edges of the mesh that is first laid around a shape [radii]."""


def spinning_top(points: np.ndarray) -> np.ndarray:
    """Cones of loose ground on both sides of an equatorial ridge, as of Bennu and Ryugu; four-sided from above."""
    x, y, z = points.T
    angle = np.arctan2(y, x)
    outline = 1.0 + 0.025 * np.cos(4.0 * angle + 0.4) + 0.018 * np.cos(2.0 * angle - 0.9) + 0.01 * np.cos(3.0 * angle)
    flat = np.hypot(x, y) / (1.13 * outline)
    high = np.sqrt(z * z + 0.045**2) / np.where(z > 0, 0.97, 1.0)
    power = 1.38
    return (flat**power + high**power + 1e-12) ** (1.0 / power) - 1.0


def contact_binary(points: np.ndarray) -> np.ndarray:
    """A large and a small lobe that touch in a concave neck, as of Itokawa, Arrokoth and 67P."""
    large = _ellipsoid(points, (-0.62, 0.0, 0.0), (1.08, 0.86, 0.74), 0.05)
    small = _ellipsoid(points, (0.93, 0.12, 0.06), (0.70, 0.60, 0.56), -0.30)
    return _joined(large, small, 0.16)


def bent_potato(points: np.ndarray) -> np.ndarray:
    """An elongated body bent about a saddle, with a broad bowl opposite of it, as of Eros."""
    x, y, z = points.T
    straight = np.stack([x, y - 0.20 * (x * x - 1.0), z], -1)
    whole = _ellipsoid(straight, (0.05, 0.0, 0.0), (2.05, 0.80, 0.72), 0.0)
    whole = np.maximum(whole, -4.0)
    taper = 0.10 * x * np.exp(-0.5 * (y * y + z * z))
    saddle = _ellipsoid(points, (0.25, 1.02, 0.10), (0.80, 0.62, 0.95), 0.2)
    bowl = _ellipsoid(points, (-0.55, -1.50, 0.15), (0.62, 0.62, 0.62), 0.0)
    return _cut(_cut(whole + taper, saddle, 0.22), bowl, 0.12)


def mesh_of(shape: Implicit) -> tuple[np.ndarray, np.ndarray]:
    """A coarse closed mesh of a shape that can be seen as a whole from the origin: vertices (V, 3), faces (F, 3)."""
    direction, faces = refine(*icosahedron(), _FIRST_SPACING, lambda p: p / np.linalg.norm(p, axis=1, keepdims=True))
    inside, outside = np.zeros(len(direction)), np.full(len(direction), 4.0)
    for _ in range(50):
        middle = 0.5 * (inside + outside)
        within = shape(middle[:, None] * direction) < 0
        inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
    return inside[:, None] * direction, faces


def onto(shape: Implicit) -> Callable[[np.ndarray], np.ndarray]:
    """The function that moves points (n, 3) near a shape onto it, along its gradient."""

    def place(points: np.ndarray) -> np.ndarray:
        for _ in range(_NEWTON_STEPS):
            value = shape(points)
            if np.abs(value).max() < _STILL:
                break
            gradient = np.stack([(shape(points + axis) - value) / _STEP for axis in _STEP * np.eye(3)], -1)
            step = (value / np.maximum(np.sum(gradient**2, -1), 1e-6))[:, None] * gradient
            points = points - step
        return points

    return place


def _ellipsoid(points: np.ndarray, center: tuple[float, ...], radii: tuple[float, ...], yaw: float) -> np.ndarray:
    """Distance from an ellipsoid, exact on it and of unit gradient there; yaw [rad] turns it about z."""
    c, s = np.cos(yaw), np.sin(yaw)
    local = (points - center) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    near = np.linalg.norm(local / radii, axis=-1)
    slope = np.linalg.norm(local / np.square(radii), axis=-1)
    return near * (near - 1.0) / np.maximum(slope, 1e-9)


def _joined(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """The union of two shapes with its concave edge rounded over `width` (polynomial smooth minimum of Quilez)."""
    near = np.maximum(width - np.abs(a - b), 0.0) / width
    return np.minimum(a, b) - 0.25 * width * near * near


def _cut(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """Shape a without shape b, its edge rounded over `width`."""
    return -_joined(-a, b, width)
