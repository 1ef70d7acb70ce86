"""Effective potential and gravity, slope and elevation on the ground of a spinning body.

The frame is body-fixed, its origin on the axis of rotation, which is z. The potential is the energy per mass in the
convention of geophysics and of the AltWG's products: -U - w^2 (x^2 + y^2) / 2, negative, lower further down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.geometry import angle_between
from photoclinometry.surface.closed_mesh import vertex_areas
from photoclinometry.surface.polyhedron_gravity import Polyhedron

_SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True, kw_only=True)
class GroundGravity:
    """At points of the surface, gravity and centrifugal acceleration together."""

    potential: np.ndarray
    """(n,) energy per mass [J/kg], negative."""
    acceleration: np.ndarray
    """(n, 3) [m/s^2], along the plumb line."""
    reference: float
    """Mean potential of the surface by area [J/kg]: that of elevation zero."""

    @property
    def magnitude(self) -> np.ndarray:
        """(n,) [m/s^2]."""
        return np.linalg.norm(self.acceleration, axis=-1)

    @property
    def elevation(self) -> np.ndarray:
        """(n,) height above the equipotential of `reference` [m]: (potential - reference) / local gravity.

        Scheeres et al. (2016), Icarus 276, 116, doi:10.1016/j.icarus.2016.04.013.
        """
        return (self.potential - self.reference) / self.magnitude

    def slope(self, normals: np.ndarray) -> np.ndarray:
        """(n,) angle between outward unit normals (n, 3) and up, the opposite of the acceleration [rad]."""
        return angle_between(normals, -self.acceleration)


def spin_rate(period_h: float | None) -> float:
    """[rad/s] of a sidereal period [h]; 0 for None, a body that does not spin."""
    return 0.0 if period_h is None else 2.0 * math.pi / (period_h * _SECONDS_PER_HOUR)


def ground_gravity(body: Polyhedron, spin: float) -> GroundGravity:
    """At the vertices of a body that spins at `spin` [rad/s] about z."""
    attraction_potential, attraction, _ = body.field(body.vertices)
    out = body.vertices * [1.0, 1.0, 0.0]
    potential = -attraction_potential - 0.5 * spin**2 * np.sum(out * out, -1)
    area = vertex_areas(body.vertices, body.faces)
    return GroundGravity(
        potential=potential,
        acceleration=attraction + spin**2 * out,
        reference=float(np.sum(area * potential) / area.sum()),
    )


def carried(
    gravity: GroundGravity, body: Polyhedron, points: np.ndarray, face: np.ndarray, weight: np.ndarray
) -> GroundGravity:
    """The gravity at a body's vertices carried to points (n, 3) near its surface, such as those of a finer mesh.

    face: (n,) nearest to each point; weight: (n, 3) of its corners at the nearest point. The acceleration is linear on
    the face. The potential there is sum w_i (V_i - g_i . (foot - p_i) / 2), exact for quadratic potentials, and is
    carried from there to the point by the acceleration.
    """
    corner = body.faces[face]
    position, acceleration = body.vertices[corner], gravity.acceleration[corner]
    foot = np.einsum("nk,nki->ni", weight, position)
    local = np.einsum("nk,nki->ni", weight, acceleration)
    at_corner = gravity.potential[corner] - 0.5 * np.sum(acceleration * (foot[:, None] - position), -1)
    potential = np.sum(weight * at_corner, -1) - np.sum(local * (points - foot), -1)
    return GroundGravity(potential=potential, acceleration=local, reference=gravity.reference)
