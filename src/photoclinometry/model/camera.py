"""Pinhole cameras.

Frame C is the camera's: x right, y down, z forward. Pixels follow COLMAP: (0.5, 0.5) is the centre of the top-left
pixel, so array index [row, col] is (col + 0.5, row + 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.projection import pixel_from_cam

CAMERA_PARAMETERS = {"PINHOLE": 4, "SIMPLE_PINHOLE": 3}


@dataclass(frozen=True)
class Camera:
    """Intrinsics of a pinhole camera, in COLMAP's model names and parameter order."""

    model: str
    """"PINHOLE" (fx, fy, cx, cy) or "SIMPLE_PINHOLE" (f, cx, cy), in pixels."""
    width: int
    """Of the image [px]."""
    height: int
    """[px]."""
    params: tuple[float, ...]
    """[px]; (0.5, 0.5) is the centre of the top-left pixel."""

    def __post_init__(self):
        expected = CAMERA_PARAMETERS.get(self.model)
        if expected is None:
            known = ", ".join(CAMERA_PARAMETERS)
            raise InputError(
                f"camera model {self.model!r} is not supported (known: {known}); undistort the images first"
            )
        if len(self.params) != expected:
            raise InputError(f"camera model {self.model} has {expected} parameters, got {len(self.params)}")
        for name, side in (("width", self.width), ("height", self.height)):
            if side < 1:
                raise InputError(f"the image's {name} is {side}; give 1 pixel or more")
        if min(self.focal_px) <= 0:
            raise InputError(f"the focal length is {min(self.focal_px):g}; give pixels above 0")

    @property
    def focal_px(self) -> tuple[float, float]:
        """Focal lengths fx, fy [px]."""
        return (self.params[0], self.params[0] if self.model == "SIMPLE_PINHOLE" else self.params[1])

    @property
    def principal_px(self) -> tuple[float, float]:
        """Principal point cx, cy [px]."""
        return (self.params[-2], self.params[-1])

    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy [px]."""
        return (*self.focal_px, *self.principal_px)

    def pixel_from_cam(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) of frame C with z > 0 (paper Eq. 10)."""
        return pixel_from_cam(points, self.intrinsics)

    def ray_in_cam(self, pixels: np.ndarray) -> np.ndarray:
        """Rays (..., 3) in frame C through pixels (..., 2), scaled to z = 1."""
        xy = (np.asarray(pixels) - self.principal_px) / self.focal_px
        return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
