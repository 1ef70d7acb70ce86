"""The compiled parts of a keypoint's and a brightness's row, each stated once for solver and covariances.

`slot` puts them together for sixteen landmarks at a time, `information` for one observation.

They take one observation at a time, as plain numbers, so that loops over many of them become vector instructions.
`factors.py` states the same in NumPy, and tests compare the two.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from photoclinometry.model.reflectance import PHASE_FLOOR
from photoclinometry.model.tiny import TINY

COMPILED: dict[str, Any] = dict(cache=True, fastmath={"contract", "reassoc", "nsz", "arcp"}, error_model="numpy")
"""Options of the compiled functions of the estimate: sums may be reordered, infinities and NaN are kept."""


@njit(**COMPILED)
def huber(size, limit):
    """Huber's loss of a whitened residual of length `size`, and the factor that scales its residual and Jacobian."""
    inner = min(size, limit)
    return inner * (2.0 * size - inner), math.sqrt((inner + TINY) / (size + TINY))


@njit(**COMPILED)
def view_numbers(k, view_state):
    """Intrinsics (4) and the rotation body_from_cam (9, row by row) of view k."""
    i, r = view_state.intrinsics[k], view_state.rotation[k]
    rotation = r[0, 0], r[0, 1], r[0, 2], r[1, 0], r[1, 1], r[1, 2], r[2, 0], r[2, 1], r[2, 2]
    return (i[0], i[1], i[2], i[3]), rotation


@njit(**COMPILED)
def pixel_by_position(focal, rotation, inverse, x, y):
    """Derivatives of a pixel's x (3) and y (3) by the landmark's position in B, from `project_point`."""
    fx, fy = focal[0] * inverse, focal[1] * inverse
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    by_x = fx * (r00 - x * r02), fx * (r10 - x * r12), fx * (r20 - x * r22)
    return by_x, (fy * (r01 - y * r02), fy * (r11 - y * r12), fy * (r21 - y * r22))


@njit(**COMPILED)
def direction(d0, d1, d2):
    """The unit vector along d, and 1 over the length of d."""
    inverse = 1.0 / math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    return (d0 * inverse, d1 * inverse, d2 * inverse), inverse


@njit(**COMPILED)
def angles(sun, e, n):
    """Cosines of incidence and emission, cosine and sine of the phase angle, of unit vectors."""
    x0, x1, x2 = sun[1] * e[2] - sun[2] * e[1], sun[2] * e[0] - sun[0] * e[2], sun[0] * e[1] - sun[1] * e[0]
    return (
        sun[0] * n[0] + sun[1] * n[1] + sun[2] * n[2],
        e[0] * n[0] + e[1] * n[1] + e[2] * n[2],
        sun[0] * e[0] + sun[1] * e[1] + sun[2] * e[2],
        math.sqrt(x0 * x0 + x1 * x1 + x2 * x2),
    )


@njit(**COMPILED)
def brightness_by_vectors(gain, by_mu0, by_mu, by_phase, sine, sun, e, n, inverse_range):
    """Derivatives of gain * rho by the landmark's position (3), its normal (3) and the Sun (3), all in B; and the
    torque (3) of the derivative by the direction e to the camera, which an orbit of the camera needs besides.

    by_mu0, by_mu, by_phase: of rho; sine: of the phase angle; inverse_range: 1 over the distance to the camera.
    """
    incident, emitted, bend = gain * by_mu0, gain * by_mu, gain * by_phase / max(sine, PHASE_FLOOR)
    g0, g1, g2 = emitted * n[0] - bend * sun[0], emitted * n[1] - bend * sun[1], emitted * n[2] - bend * sun[2]
    along = g0 * e[0] + g1 * e[1] + g2 * e[2]
    return (
        ((along * e[0] - g0) * inverse_range, (along * e[1] - g1) * inverse_range, (along * e[2] - g2) * inverse_range),
        (incident * sun[0] + emitted * e[0], incident * sun[1] + emitted * e[1], incident * sun[2] + emitted * e[2]),
        (incident * n[0] - bend * e[0], incident * n[1] - bend * e[1], incident * n[2] - bend * e[2]),
        (e[1] * g2 - e[2] * g1, e[2] * g0 - e[0] * g2, e[0] * g1 - e[1] * g0),
    )


@njit(**COMPILED)
def along_basis(vector, basis):
    """A vector's two components along a tangent basis (3, 2), given row by row."""
    return (
        vector[0] * basis[0] + vector[1] * basis[2] + vector[2] * basis[4],
        vector[0] * basis[1] + vector[1] * basis[3] + vector[2] * basis[5],
    )


@njit(**COMPILED)
def orbit_of(a, arm):
    """The row by orbit (3) of a row by position: its torque about the pivot, from which `arm` leads to the landmark."""
    return a[1] * arm[2] - a[2] * arm[1], a[2] * arm[0] - a[0] * arm[2], a[0] * arm[1] - a[1] * arm[0]
