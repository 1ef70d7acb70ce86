"""The factors of the graph, one whitened residual per measurement, in plain NumPy.

    projection   f_L       (predicted pixel - keypoint) / sigma                      Eqs. 9-10
    photometric  f_Ph      (lambda a rho(mu0, mu, phase) + xi - brightness) / sigma  Eqs. 29-32
    direct likewise, with the image's brightness where the landmark projects
    Sun          f_SS      B^T R^T s / sigma: the measured Sun's tangent plane       Eqs. 33-34
    smoothness   f_Smooth  (asin(d . n) - bend) / sigma: neighbours lie in the tangent plane, but for the bend  Eq. 35

Each returns the residual and its Jacobian by the local coordinates of the variables that it touches. Local coordinates:

    pose      6   a shift, then an orbit about a pivot in the middle of the map: R <- exp(omega) R,
                  c <- pivot + exp(omega) (c - pivot + tau), all in B
    Sun       2   step on the sphere (Eq. 5)     normal 2   likewise
    position  3   albedo 1   scale 1   bias 1    added

The paper's Eq. 2 turns and shifts in C. For a distant camera with a narrow field these have nearly the same effect on
the image. Its motion around the scene, which images determine badly, is a long arc of both together: steps along its
tangent change the distance, and a solver that takes them stalls. In orbit coordinates that motion is omega alone, on
the arc. The minimum is the same.

This is the readable statement of the estimate and the reference that the compiled kernels are tested against.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.geometry import skew, tangent_basis
from photoclinometry.model.projection import project
from photoclinometry.model.reflectance import PHASE_FLOOR, continued_function

STEEPEST = 1.0 - 1e-9
"""|d . n| of smoothness is kept below this: the arcsine is infinitely steep at 1, along the normal."""


def projection(
    rotation: np.ndarray,
    center: np.ndarray,
    intrinsics: np.ndarray,
    position: np.ndarray,
    keypoint: np.ndarray,
    sigma: float,
    pivot: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residual (2,) and Jacobians by position (2, 3) and pose (2, 6).

    rotation: body_from_cam (3, 3); center, position, pivot: (3,) in B; intrinsics: fx, fy, cx, cy; sigma [px].
    """
    pixel, by_position = project(rotation, center, intrinsics, position)
    by_position = by_position / sigma
    # seen from the camera, an orbit by omega moves the landmark by -omega x (position - pivot)
    by_pose = np.hstack([by_position @ skew(position - pivot), -by_position])
    return (pixel - keypoint) / sigma, by_position, by_pose


def photometric(
    parameter_vector: np.ndarray,
    center: np.ndarray,
    sun: np.ndarray,
    scale: float,
    bias: float,
    position: np.ndarray,
    normal: np.ndarray,
    albedo: float,
    brightness: float,
    sigma: float,
    pivot: np.ndarray,
) -> tuple[float, np.ndarray]:
    """Residual (a number) and Jacobian (16,) by position 3, normal 2, albedo 1, pose 6, Sun 2, scale 1, bias 1."""
    offset = center - position
    distance = np.linalg.norm(offset)
    to_camera = offset / distance
    sine = np.linalg.norm(np.cross(sun, to_camera))
    phase = np.arctan2(sine, sun @ to_camera)
    rho, by_mu0, by_mu, by_phase = continued_function(parameter_vector, sun @ normal, to_camera @ normal, phase)
    gain = scale * albedo
    by_phase_over_sine = by_phase / max(sine, PHASE_FLOOR)
    by_to_camera = gain * (by_mu * normal - by_phase_over_sine * sun)
    by_position = -(by_to_camera - (by_to_camera @ to_camera) * to_camera) / distance
    by_normal = gain * (by_mu0 * sun + by_mu * to_camera)
    by_sun = gain * (by_mu0 * normal - by_phase_over_sine * to_camera)
    jacobian = np.concatenate(
        [
            by_position,
            by_normal @ tangent_basis(normal),
            [scale * rho],
            by_position @ skew(center - pivot),
            -by_position,
            by_sun @ tangent_basis(sun),
            [albedo * rho, 1.0],
        ]
    )
    return (gain * rho + bias - brightness) / sigma, jacobian / sigma


def direct(
    parameter_vector: np.ndarray,
    rotation: np.ndarray,
    center: np.ndarray,
    intrinsics: np.ndarray,
    sun: np.ndarray,
    scale: float,
    bias: float,
    position: np.ndarray,
    normal: np.ndarray,
    albedo: float,
    image: tuple[float, np.ndarray, np.ndarray],
    sigma: float,
    pivot: np.ndarray,
) -> tuple[float, np.ndarray]:
    """As `photometric`, where the landmark projects into a view: its place in the image does not come from a keypoint.

    image: brightness there, at (2,) which pixel, gradient (2,) [1/px]: brightness + gradient . (projected pixel - at).
    """
    brightness, at, gradient = image
    shift, by_position, by_pose = projection(rotation, center, intrinsics, position, at, 1.0, pivot)
    residual, jacobian = photometric(
        parameter_vector,
        center,
        sun,
        scale,
        bias,
        position,
        normal,
        albedo,
        brightness + float(gradient @ shift),
        sigma,
        pivot,
    )
    jacobian[:3] -= gradient @ by_position / sigma
    jacobian[6:12] -= gradient @ by_pose / sigma
    return residual, jacobian


def sun_direction(
    rotation: np.ndarray, sun: np.ndarray, sun_measured: np.ndarray, sigma: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (..., 2) and Jacobians (..., 2, 5) by the camera's rotation omega (3) and the Sun (2).

    rotation: (..., 3, 3) body_from_cam; sun: (..., 3) in B; sun_measured: (..., 3) in C; sigma: (...) [rad].
    """
    across = np.swapaxes(rotation @ tangent_basis(sun_measured), -1, -2)
    residual = (across @ sun[..., None])[..., 0]
    jacobian = np.concatenate([across @ skew(sun), across @ tangent_basis(sun)], -1)
    sigma = np.asarray(sigma)
    return residual / sigma[..., None], jacobian / sigma[..., None, None]


def smoothness(
    position: np.ndarray, normal: np.ndarray, neighbour: np.ndarray, sigma: float, bend: float = 0.0
) -> tuple[float, np.ndarray]:
    """Residual (a number) and Jacobian (8,) by position 3, normal 2, neighbour's position 3; sigma [rad].

    bend: angle of the neighbour above the tangent plane, as known beforehand [rad].
    """
    offset = neighbour - position
    distance = np.linalg.norm(offset)
    direction = offset / distance
    cosine = np.clip(direction @ normal, -STEEPEST, STEEPEST)
    steepness = 1.0 / np.sqrt(1.0 - cosine**2)
    by_neighbour = steepness * (normal - cosine * direction) / distance
    by_normal = steepness * direction @ tangent_basis(normal)
    return float((np.arcsin(cosine) - bend) / sigma), np.concatenate([-by_neighbour, by_normal, by_neighbour]) / sigma


def huber(squared: np.ndarray, limit: float) -> np.ndarray:
    """Huber's loss of squared whitened residuals: s up to limit^2, then 2 limit sqrt(s) - limit^2."""
    return squared - np.maximum(np.sqrt(squared) - limit, 0.0) ** 2
