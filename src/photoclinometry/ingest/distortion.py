"""How optics displace points of the focal plane.

All models take points (..., 2) on the focal plane [mm], relative to the principal point, x along a detector's samples
and y along its lines, and are asked for one thing: where an ideal (pinhole) point is seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from photoclinometry.model.errors import InputError

_STEPS = 50
_TOLERANCE_MM = 1e-9


class Distortion(Protocol):
    """Anything that tells where ideal points are seen."""

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        """Points (..., 2) [mm] where the ideal points (..., 2) [mm] are seen."""
        ...


@dataclass(frozen=True)
class Radial:
    """seen - ideal = (ideal - center) sum_i k_i r^i, r = |ideal - center| [mm].

    Dawn FC's instrument kernel ("Optical Distortion") has k_2 alone; OCAMS's has
    k_0 ... k_4 about a centre of its own (ISIS, OsirisRexDistortionMap).
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
class Undoing:
    """A model that is written the other way: ideal - seen = -(seen - center) sum_i k_i r^i, r = |seen - center|.

    ISIS's RadialDistortionMap (AMICA: k_2 = 2.8e-5 mm^-2 of Ishiguro et al. 2010, Icarus 207, 714). Inverted by
    fixed-point iteration, which contracts as long as the displacement changes by less than its distance.
    """

    coefficients: tuple[float, ...]
    center_mm: tuple[float, float] = (0.0, 0.0)

    def undistort(self, seen: np.ndarray) -> np.ndarray:
        """Ideal points (..., 2) of points seen (..., 2) [mm]."""
        offset = seen - np.array(self.center_mm)
        radius = np.linalg.norm(offset, axis=-1, keepdims=True)
        return seen - offset * np.polynomial.polynomial.polyval(radius, self.coefficients)

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        """Raises InputError where the coefficients are too wild to be inverted."""
        seen = np.array(ideal, float)
        farthest = 10.0 * (1.0 + np.abs(ideal).max(initial=0.0))
        for _ in range(_STEPS):
            step = ideal - self.undistort(seen)
            seen = seen + step
            if np.abs(step).max(initial=0.0) < _TOLERANCE_MM:
                return seen
            if np.abs(seen).max() > farthest:
                break
        raise InputError(f"the distortion {self.coefficients} cannot be inverted on this detector; correct the camera")


@dataclass(frozen=True)
class Mirrored:
    """The same optics for samples or lines that run the other way."""

    inner: Distortion
    signs: tuple[float, float]
    """-1 for the axis that is turned about, else 1."""

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
    """(6,)."""
    p: tuple[float, float]
    stretch: tuple[float, float] = (1.0, 1.0)
    """fx, fy of the model over its nominal focal length in pixels."""

    def distort(self, ideal: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(ideal / self.focal_mm, -1, 0)
        r2 = x * x + y * y
        k1, k2, k3, k4, k5, k6 = self.k
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        p1, p2 = self.p
        seen_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        seen_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([seen_x, seen_y], -1) * self.focal_mm * np.array(self.stretch)
