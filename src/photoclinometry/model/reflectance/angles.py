"""Photometric angles: cosines of incidence (mu0) and emission (mu), and phase [rad]."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

DEG = 180.0 / math.pi
"""Degrees in a radian."""

GRAZING_DEG = 85.0
"""Observations at larger incidence or emission are not used: an error of the normal of 2.5 degrees halves or doubles
their shading."""

GRAZING = math.cos(math.radians(GRAZING_DEG))
"""Cosine of GRAZING_DEG."""

PHASE_FLOOR = 1e-7
"""Sines of the phase angle are kept above this [rad]: 0.02 arc seconds."""


@njit(cache=True)
def phase_angle(cosine, sine):
    """Phase [rad] from s.e and |s x e|: no infinite slope at zero phase."""
    return math.atan2(sine, cosine)


@njit(cache=True, inline="always")
def angles_at(sun, center, position, normal):
    """`photometric_angles` of one point: mu0, mu, phase [rad]; (3,) each."""
    n0, n1, n2 = normal[0], normal[1], normal[2]
    e0, e1, e2 = center[0] - position[0], center[1] - position[1], center[2] - position[2]
    inverse = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    e0, e1, e2 = e0 * inverse, e1 * inverse, e2 * inverse
    s0, s1, s2 = sun[0], sun[1], sun[2]
    x0, x1, x2 = s1 * e2 - s2 * e1, s2 * e0 - s0 * e2, s0 * e1 - s1 * e0
    phase = phase_angle(s0 * e0 + s1 * e1 + s2 * e2, math.sqrt(x0 * x0 + x1 * x1 + x2 * x2))
    return s0 * n0 + s1 * n1 + s2 * n2, e0 * n0 + e1 * n1 + e2 * n2, phase


def photometric_angles(
    sun: np.ndarray, camera_center: np.ndarray, position: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """mu0, mu and phase [rad] at surface points.

    sun: (..., 3) unit vector towards the Sun; camera_center, position, normal: (..., 3); all in B.
    """
    to_camera = camera_center - position
    to_camera = to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
    mu0 = np.sum(sun * normal, -1)
    mu = np.sum(to_camera * normal, -1)
    sine = np.linalg.norm(np.cross(sun, to_camera), axis=-1)
    return mu0, mu, np.arctan2(sine, np.sum(sun * to_camera, -1))
