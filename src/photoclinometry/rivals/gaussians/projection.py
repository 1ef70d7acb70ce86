"""Gaussians as ellipses of a picture: the local affine approximation of the pinhole (EWA), and its derivatives.

Zwicker et al. (2001), EWA volume splatting; Kerbl et al. (2023), Eqs. 5 and 6:

    S' = J W R S S' R' W' J' + 0.3 I,        J = d pixel / d point,  W = cam_from_body,  S = diag(exp(log_scale))

and the weight of a Gaussian at a pixel is opacity exp(-d' A d / 2), A = S'^-1, d the offset from its centre.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from photoclinometry.rivals.gaussians.cloud import Cloud

DILATION_PX2 = 0.3
"""Variance that is added to every ellipse [px^2]: none is narrower than a pixel (Kerbl et al. 2023)."""
REACH = 3.0
"""Size of the ellipses, in standard deviations of their longer axis."""


class Pinhole(NamedTuple):
    """A camera as the compiled loops take it; pixels count from the corner of the picture that is drawn."""

    rotation: np.ndarray
    """(3, 3) cam_from_body."""
    translation: np.ndarray
    """(3,) cam_from_body."""
    intrinsics: np.ndarray
    """(4,) fx, fy, cx, cy [px]."""


class Ellipses(NamedTuple):
    """N Gaussians in a picture."""

    center: np.ndarray
    """(N, 2) [px]."""
    conic: np.ndarray
    """(N, 3) A_xx, A_xy, A_yy [1/px^2]."""
    radius: np.ndarray
    """(N,) [px]; 0 behind the camera."""
    depth: np.ndarray
    """(N,) in the unit of B."""


def project(cloud: Cloud, camera: Pinhole) -> Ellipses:
    """The ellipses of a cloud in a picture."""
    count = len(cloud)
    out = Ellipses(np.zeros((count, 2)), np.zeros((count, 3)), np.zeros(count), np.zeros(count))
    _project(cloud.position, cloud.log_scale, cloud.quaternion, camera, out)
    return out


def project_back(
    cloud: Cloud, camera: Pinhole, by_center: np.ndarray, by_conic: np.ndarray, by_normal: np.ndarray
) -> dict[str, np.ndarray]:
    """Derivatives of a loss by position, log_scale and quaternion, from those by what follows from them.

    by_center: (N, 2); by_conic: (N, 3); by_normal: (N, 3) by the third axis of each Gaussian.
    """
    found = {name: np.zeros_like(getattr(cloud, name)) for name in ("position", "log_scale", "quaternion")}
    _project_back(
        cloud.position, cloud.log_scale, cloud.quaternion, camera, by_center, by_conic, by_normal,
        found["position"], found["log_scale"], found["quaternion"],
    )  # fmt: skip
    return found


@njit(cache=True)
def _rotation(q):
    """(3, 3) of a quaternion w, x, y, z of unit length; as `cloud.rotations`."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    r = np.empty((3, 3))
    r[0, 0], r[0, 1], r[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r[1, 0], r[1, 1], r[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r[2, 0], r[2, 1], r[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return r


@njit(cache=True)
def _footprint(point, scale, rotation, camera, affine, spread):
    """Writes affine (2, 3) = J W and spread (2, 3) = J W R S of a Gaussian at a point (3,) of the camera's frame."""
    fx, fy = camera.intrinsics[0], camera.intrinsics[1]
    x, y, z = point[0], point[1], point[2]
    for k in range(3):
        affine[0, k] = fx / z * (camera.rotation[0, k] - x / z * camera.rotation[2, k])
        affine[1, k] = fy / z * (camera.rotation[1, k] - y / z * camera.rotation[2, k])
    for i in range(2):
        for k in range(3):
            total = 0.0
            for m in range(3):
                total += affine[i, m] * rotation[m, k]
            spread[i, k] = total * scale[k]


@njit(cache=True, error_model="numpy")
def _project(position, log_scale, quaternion, camera, out):
    """`project` into `out`. position, log_scale: (N, 3); quaternion: (N, 4) of any length. Behind the camera only depth
    and radius, which is 0, are written.
    """
    center, conic, radius, depth = out.center, out.conic, out.radius, out.depth
    for n in range(position.shape[0]):
        point = np.empty(3)
        for i in range(3):
            point[i] = camera.translation[i]
            for k in range(3):
                point[i] += camera.rotation[i, k] * position[n, k]
        depth[n] = point[2]
        if point[2] <= 0.0:
            radius[n] = 0.0
            continue
        q = quaternion[n] / np.sqrt(np.sum(quaternion[n] ** 2))
        affine, spread = np.empty((2, 3)), np.empty((2, 3))
        _footprint(point, np.exp(log_scale[n]), _rotation(q), camera, affine, spread)
        xx = DILATION_PX2 + spread[0, 0] ** 2 + spread[0, 1] ** 2 + spread[0, 2] ** 2
        yy = DILATION_PX2 + spread[1, 0] ** 2 + spread[1, 1] ** 2 + spread[1, 2] ** 2
        xy = spread[0, 0] * spread[1, 0] + spread[0, 1] * spread[1, 1] + spread[0, 2] * spread[1, 2]
        determinant = xx * yy - xy * xy
        conic[n, 0], conic[n, 1], conic[n, 2] = yy / determinant, -xy / determinant, xx / determinant
        center[n, 0] = camera.intrinsics[0] * point[0] / point[2] + camera.intrinsics[2]
        center[n, 1] = camera.intrinsics[1] * point[1] / point[2] + camera.intrinsics[3]
        half = 0.5 * (xx + yy)
        longest = half + np.sqrt(max(half * half - determinant, 0.0))
        radius[n] = REACH * np.sqrt(longest)


@njit(cache=True, error_model="numpy")
def _project_back(
    position, log_scale, quaternion, camera, by_center, by_conic, by_normal, by_position, by_log_scale, by_quaternion
):
    """`project_back` into by_position (N, 3), by_log_scale (N, 3) and by_quaternion (N, 4); those of Gaussians behind
    the camera stay.

    The steps of `_project` are repeated, then followed backwards: from the conic to the covariance, to its root J W R
    S, to scale, rotation and J, and from J and the centre to the position.
    """
    fx, fy = camera.intrinsics[0], camera.intrinsics[1]
    for n in range(position.shape[0]):
        point = np.empty(3)
        for i in range(3):
            point[i] = camera.translation[i]
            for k in range(3):
                point[i] += camera.rotation[i, k] * position[n, k]
        if point[2] <= 0.0:
            continue
        length = np.sqrt(np.sum(quaternion[n] ** 2))
        q = quaternion[n] / length
        scale, rotation = np.exp(log_scale[n]), _rotation(q)
        affine, spread = np.empty((2, 3)), np.empty((2, 3))
        _footprint(point, scale, rotation, camera, affine, spread)
        xx = DILATION_PX2 + spread[0, 0] ** 2 + spread[0, 1] ** 2 + spread[0, 2] ** 2
        yy = DILATION_PX2 + spread[1, 0] ** 2 + spread[1, 1] ** 2 + spread[1, 2] ** 2
        xy = spread[0, 0] * spread[1, 0] + spread[0, 1] * spread[1, 1] + spread[0, 2] * spread[1, 2]
        determinant = xx * yy - xy * xy
        a, b, c = yy / determinant, -xy / determinant, xx / determinant
        # By the covariance: -A G A, with G the symmetric matrix of the derivatives by A.
        g00, g01, g11 = by_conic[n, 0], 0.5 * by_conic[n, 1], by_conic[n, 2]
        p00, p01, p10, p11 = g00 * a + g01 * b, g00 * b + g01 * c, g01 * a + g11 * b, g01 * b + g11 * c
        s00, s01, s11 = -(a * p00 + b * p10), -(a * p01 + b * p11), -(b * p01 + c * p11)
        by_spread = np.empty((2, 3))
        for k in range(3):
            by_spread[0, k] = 2.0 * (s00 * spread[0, k] + s01 * spread[1, k])
            by_spread[1, k] = 2.0 * (s01 * spread[0, k] + s11 * spread[1, k])
        by_rotation, by_affine = np.zeros((3, 3)), np.zeros((2, 3))
        for k in range(3):
            along = 0.0
            for m in range(3):
                step = affine[0, m] * by_spread[0, k] + affine[1, m] * by_spread[1, k]
                by_rotation[m, k] = step * scale[k]
                along += step * rotation[m, k]
                for i in range(2):
                    by_affine[i, m] += by_spread[i, k] * rotation[m, k] * scale[k]
            by_log_scale[n, k] = along * scale[k]
        for m in range(3):
            by_rotation[m, 2] += by_normal[n, m]
        _quaternion_back(q, length, by_rotation, by_quaternion[n])
        x, y, z = point[0], point[1], point[2]
        j00 = j02 = j11 = j12 = 0.0
        for k in range(3):
            j00 += by_affine[0, k] * camera.rotation[0, k]
            j02 += by_affine[0, k] * camera.rotation[2, k]
            j11 += by_affine[1, k] * camera.rotation[1, k]
            j12 += by_affine[1, k] * camera.rotation[2, k]
        u, v = by_center[n, 0], by_center[n, 1]
        by_x = (u * fx - j02 * fx / z) / z
        by_y = (v * fy - j12 * fy / z) / z
        by_z = -(u * fx * x + v * fy * y + j00 * fx + j11 * fy) / z**2 + 2.0 * (j02 * fx * x + j12 * fy * y) / z**3
        for k in range(3):
            by_position[n, k] = (
                by_x * camera.rotation[0, k] + by_y * camera.rotation[1, k] + by_z * camera.rotation[2, k]
            )


@njit(cache=True)
def _quaternion_back(q, length, g, out):
    """Writes the derivatives (4,) by a quaternion of this length from those g (3, 3) by the rotation of q, its unit."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    d = np.empty(4)
    d[0] = 2 * (-z * g[0, 1] + y * g[0, 2] + z * g[1, 0] - x * g[1, 2] - y * g[2, 0] + x * g[2, 1])
    d[1] = 2 * (
        y * g[0, 1] + z * g[0, 2] + y * g[1, 0] - 2 * x * g[1, 1] - w * g[1, 2] + z * g[2, 0] + w * g[2, 1]
        - 2 * x * g[2, 2]
    )  # fmt: skip
    d[2] = 2 * (
        -2 * y * g[0, 0] + x * g[0, 1] + w * g[0, 2] + x * g[1, 0] + z * g[1, 2] - w * g[2, 0] + z * g[2, 1]
        - 2 * y * g[2, 2]
    )  # fmt: skip
    d[3] = 2 * (
        -2 * z * g[0, 0] - w * g[0, 1] + x * g[0, 2] + w * g[1, 0] - 2 * z * g[1, 1] + y * g[1, 2] + x * g[2, 0]
        + y * g[2, 1]
    )  # fmt: skip
    along = d[0] * w + d[1] * x + d[2] * y + d[3] * z
    for k in range(4):
        out[k] = (d[k] - along * q[k]) / length
