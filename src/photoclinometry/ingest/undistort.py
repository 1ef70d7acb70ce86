"""Upright images without distortion: lines reversed where needed, pixels and masks resampled."""

from __future__ import annotations

import numpy as np

from photoclinometry.ingest.detector import NEGLIGIBLE_PX, Detector, displacement, upright
from photoclinometry.model.scene import Image
from photoclinometry.surface.sampling import filled_from_nearest, sample

_REACH = 2
"""Pixels on each side with the main weights of a cubic spline [px]."""


def undistorted(image: Image, detector: Detector) -> Image:
    """`image` upright and without distortion, as the camera of `detector.upright` sees it.

    If the distortion is below NEGLIGIBLE_PX everywhere, pixels are unchanged. Otherwise they are interpolated by cubic
    splines, and pixels next to an invalid pixel or to the image's edge become invalid. Raises InputError.
    """
    _, _, flip = upright(detector)
    brightness, valid = image.brightness, image.valid
    if detector.distortion is not None:
        seen, farthest = displacement(detector)
        if farthest > NEGLIGIBLE_PX:
            brightness, valid = _resampled(brightness, valid, seen)
    if flip:
        brightness, valid = brightness[::-1], valid[::-1]
    return Image(image.name, np.ascontiguousarray(brightness), np.ascontiguousarray(valid))


def _resampled(brightness: np.ndarray, valid: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Brightness and validity at the pixels `seen` (h, w, 2), (0.5, 0.5) being the centre of the first, by splines."""
    import cv2

    x, y = np.moveaxis(seen - 0.5, -1, 0)
    height, width = brightness.shape
    # Pixels outside of the image count as holes: a border of width _REACH is added.
    holes = np.pad(~valid, _REACH, constant_values=True).astype(np.uint8)
    touched = cv2.dilate(holes, np.ones((2 * _REACH, 2 * _REACH), np.uint8), anchor=(_REACH - 1, _REACH - 1))
    col, row = np.floor(x).astype(int), np.floor(y).astype(int)
    inside = (col >= 0) & (row >= 0) & (col < width) & (row < height)
    at = np.clip(row, 0, height - 1) + _REACH, np.clip(col, 0, width - 1) + _REACH
    kept = inside & (touched[at] == 0)
    # A spline depends weakly on far pixels: holes are filled with their nearest neighbours.
    source = filled_from_nearest(brightness, valid).astype(np.float64) if valid.any() else np.zeros(valid.shape)
    values = sample(source, seen)
    return np.where(kept, values, 0.0).astype(np.float32), kept
