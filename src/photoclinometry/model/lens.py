"""Lens distortion: from the pixel where a pinhole would show a point to the pixel that shows it.

Brown's model of radial distortion and decentring (Brown 1971, Photogrammetric Engineering 37, 855), as COLMAP and
OpenCV write it. For (x, y) = (pixel - principal point) / focal length and r^2 = x^2 + y^2,

    x'' = x (1 + k1 r^2 + k2 r^4) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y'' = y (1 + k1 r^2 + k2 r^4) + p1 (r^2 + 2 y^2) + 2 p2 x y

Coefficients of narrow fields are huge or tiny numbers. So they are also given as the displacement [px] that each makes
at a corner of the image (`corner_px`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.region import Region

MODELS = {
    "SIMPLE_RADIAL": ("SIMPLE_PINHOLE", ("k1",)),
    "RADIAL": ("SIMPLE_PINHOLE", ("k1", "k2")),
    "OPENCV": ("PINHOLE", ("k1", "k2", "p1", "p2")),
}
"""COLMAP's camera models with distortion: the pinhole whose parameters come first, and the coefficients after them."""

NEGLIGIBLE_PX = 0.01
"""Distortion below this is ignored: resampling would cost more accuracy [px]."""

_SAMPLES = 65
"""Points across the image at which `folds` looks: the terms bend on the scale of the image."""


@dataclass(frozen=True)
class Lens:
    """The distortion of a camera."""

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @classmethod
    def of_corner_px(cls, coefficients: np.ndarray, camera: Camera) -> Lens:
        """The lens whose four terms displace a corner of the image by given numbers of pixels, as of
        `displacement_terms`."""
        per_unit = np.array(coefficients, float) / _unit_at_corner(camera)
        return cls(*per_unit.tolist())

    def corner_px(self, camera: Camera) -> np.ndarray:
        """(4,) the displacement that k1, k2, p1 and p2 each make at a corner of the image [px], if the principal point
        is in its middle. Of p1 and p2 it is the part that does not depend on the direction."""
        return np.array([self.k1, self.k2, self.p1, self.p2]) * _unit_at_corner(camera)

    def displacement(self, ideal: np.ndarray, camera: Camera) -> np.ndarray:
        """(..., 2) observed minus ideal (pinhole) pixels (..., 2)."""
        return displacement_terms(ideal, camera) @ self.corner_px(camera)


NO_DISTORTION = Lens()


def displacement_terms(ideal: np.ndarray, camera: Camera) -> np.ndarray:
    """(..., 2, 4) displacements of ideal pixels (..., 2) by k1, k2, p1 and p2, each of a size that gives one pixel at a
    corner [px]."""
    radius, focal = _corner(camera), np.array(camera.focal_px)
    x, y = np.moveaxis((np.asarray(ideal, float) - camera.principal_px) / focal / radius, -1, 0)
    square = x * x + y * y
    of_x = np.stack([x * square, x * square**2, 2.0 * x * y, square + 2.0 * x * x], -1)
    of_y = np.stack([y * square, y * square**2, square + 2.0 * y * y, 2.0 * x * y], -1)
    return np.stack([of_x, of_y], -2) * (focal / focal.mean())[:, None]


def observed_pixels(camera: Camera, lens: Lens) -> tuple[np.ndarray, float]:
    """(height, width, 2) the observed pixel of every pixel of the undistorted image, and the largest displacement."""
    ideal = Region.of_image(camera.height, camera.width).pixel_centers()
    moved = lens.displacement(ideal, camera)
    return ideal + moved, float(np.linalg.norm(moved, axis=-1).max())


def folds(camera: Camera, lens: Lens) -> bool:
    """Whether two ideal pixels of the image are displaced to one observed pixel."""
    x, y = np.meshgrid(np.linspace(0, camera.width, _SAMPLES), np.linspace(0, camera.height, _SAMPLES))
    ideal = np.stack([x, y], -1)
    observed = ideal + lens.displacement(ideal, camera)
    right, down = np.diff(observed, axis=1)[:-1], np.diff(observed, axis=0)[:, :-1]
    return bool((right[..., 0] * down[..., 1] <= right[..., 1] * down[..., 0]).any())


def _corner(camera: Camera) -> float:
    """Tangent of the angle between the optical axis and a corner, if the principal point is in the image's middle."""
    return float(np.hypot(camera.width / camera.focal_px[0], camera.height / camera.focal_px[1])) / 2.0


def _unit_at_corner(camera: Camera) -> np.ndarray:
    """(4,) displacement [px] at the corner by a coefficient of one."""
    radius, focal = _corner(camera), float(np.mean(camera.focal_px))
    return focal * np.array([radius**3, radius**5, radius**2, radius**2])
