"""Distortion of the focal plane: from the ideal (pinhole) point to the point observed.

Points (..., 2) are on the focal plane [mm], relative to the principal point, x along a detector's samples and y along
its lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from photoclinometry.model.errors import InputError

_STEPS = 50
"""Iterations of `InverseRadial.distort`; wide-angle cameras need 16."""
_TOLERANCE_MM = 1e-9
"""Last step of that iteration: 1e-7 px of a 10-micron pixel."""
_DIVERGED = 10.0
"""The iteration fails once a point is this many times farther out than the ideal points."""


class Distortion(Protocol):
    """A distortion model."""

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        """Observed points (..., 2) [mm] of ideal points (..., 2) [mm]."""
        ...


@dataclass(frozen=True)
class Radial:
    """observed - ideal = (ideal - center) sum_i k_i r^i, r = |ideal - center| [mm].

    Dawn FC's instrument kernel ("Optical Distortion") has k_2 alone; OCAMS's has k_0 ... k_4 about a centre other
    than the principal point (ISIS, OsirisRexDistortionMap).
    """

    coefficients: tuple[float, ...]
    """k_0, k_1, ... [mm^-i]."""
    center_mm: tuple[float, float] = (0.0, 0.0)

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        offset = ideal - np.array(self.center_mm)
        return ideal + offset * self._growth(np.linalg.norm(offset, axis=-1, keepdims=True))

    def _growth(self, radius: np.ndarray) -> np.ndarray:
        return np.polynomial.polynomial.polyval(radius, self.coefficients)


@dataclass(frozen=True)
class InverseRadial:
    """A radial model of the correction: ideal - observed = -(observed - center) sum_i k_i r^i, r = |observed - center|.

    ISIS's RadialDistortionMap (AMICA: k_2 = 2.8e-5 mm^-2 of Ishiguro et al. 2010, Icarus 207, 714). Inverted by
    fixed-point iteration, which converges where the displacement's derivative is below 1.
    """

    coefficients: tuple[float, ...]
    """k_0, k_1, ... [mm^-i]."""
    center_mm: tuple[float, float] = (0.0, 0.0)

    def undistort(self, observed: np.ndarray) -> np.ndarray:
        """Ideal points (..., 2) of observed points (..., 2) [mm]."""
        offset = observed - np.array(self.center_mm)
        radius = np.linalg.norm(offset, axis=-1, keepdims=True)
        return observed - offset * np.polynomial.polynomial.polyval(radius, self.coefficients)

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        """Raises InputError if the iteration does not converge."""
        return _inverted(self.undistort, ideal, self.coefficients)


def _inverted(undistort: Callable[[np.ndarray], np.ndarray], ideal: np.ndarray, named: object) -> np.ndarray:
    """Observed points of ideal ones by fixed-point iteration. Raises InputError if it does not converge."""
    observed = np.array(ideal, float)
    farthest = _DIVERGED * (1.0 + np.abs(ideal).max(initial=0.0))
    for _ in range(_STEPS):
        step = ideal - undistort(observed)
        observed = observed + step
        if np.abs(step).max(initial=0.0) < _TOLERANCE_MM:
            return observed
        if np.abs(observed).max() > farthest:
            break
    raise InputError(f"the distortion {named} cannot be inverted on this detector; correct the camera")


@dataclass(frozen=True)
class Decentred:
    """Radial and decentring distortion of the Apollo Metric cameras, as a correction, with r = |observed| [mm].

    ideal = observed (1 + k1 r^2 + k2 r^4 + k3 r^6) + (j1 r^2 + j2 r^4) (-sin angle, cos angle)

    ISIS, ApolloMetricDistortionMap. Inverted by fixed-point iteration.
    """

    k: tuple[float, float, float]
    """[mm^-2], [mm^-4], [mm^-6]."""
    j: tuple[float, float]
    """[mm^-1], [mm^-3]."""
    angle_rad: float

    def undistort(self, observed: np.ndarray) -> np.ndarray:
        """Ideal points (..., 2) of observed points (..., 2) [mm]."""
        r2 = np.sum(observed**2, axis=-1, keepdims=True)
        k1, k2, k3 = self.k
        across = r2 * (self.j[0] + self.j[1] * r2)
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return observed * radial + across * np.array([-np.sin(self.angle_rad), np.cos(self.angle_rad)])

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        """Raises InputError if the iteration does not converge."""
        return _inverted(self.undistort, ideal, (self.k, self.j))


@dataclass(frozen=True)
class Taylor:
    """A polynomial of third degree: observed = coefficients @ (1, x, y, x^2, xy, y^2, x^3, x^2 y, x y^2, y^3).

    MESSENGER's MDIS (ISIS, TaylorCameraDistortionMap).
    """

    x: tuple[float, ...]
    """(10,) [mm^(1 - degree)], of the observed x."""
    y: tuple[float, ...]
    """(10,)."""

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(np.asarray(ideal, float), -1, 0)
        terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3], -1)
        return terms @ np.array([self.x, self.y]).T


@dataclass(frozen=True)
class OnAxes:
    """A model that is stated along the axes x and y of the focal plane, for samples and lines along others."""

    inner: Distortion
    axes: tuple[tuple[float, float], tuple[float, float]]
    """Directions (x, y) of samples and lines."""

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        axes = np.array(self.axes)
        return self.inner.distort(ideal @ axes) @ axes.T


@dataclass(frozen=True)
class Mirrored:
    """Another model, for samples or lines in reverse order."""

    inner: Distortion
    signs: tuple[float, float]
    """-1 for a reversed axis, else 1."""

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        signs = np.array(self.signs)
        return self.inner.distort(ideal * signs) * signs


@dataclass(frozen=True)
class BrownConrady:
    """OpenCV's rational radial and tangential model of (x, y) = ideal / focal; docs.opencv.org, calib3d.

    x'' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), y'' alike.
    """

    focal_mm: float
    k: tuple[float, ...]
    """k1 ... k6 (6,), radial."""
    p: tuple[float, float]
    """p1, p2, tangential."""
    stretch: tuple[float, float] = (1.0, 1.0)
    """fx, fy of the model divided by the nominal focal length in pixels."""

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(ideal / self.focal_mm, -1, 0)
        r2 = x * x + y * y
        k1, k2, k3, k4, k5, k6 = self.k
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        p1, p2 = self.p
        observed_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        observed_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([observed_x, observed_y], -1) * self.focal_mm * np.array(self.stretch)
