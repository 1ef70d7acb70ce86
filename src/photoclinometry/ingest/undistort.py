"""Upright images without distortion: lines reversed where needed, pixels and masks resampled."""

from __future__ import annotations

import numpy as np

from photoclinometry.ingest.detector import Detector, displacement, upright
from photoclinometry.model.image import Image
from photoclinometry.model.lens import NEGLIGIBLE_PX
from photoclinometry.model.sampling import resampled


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
            brightness, valid = resampled(brightness, valid, seen)
    if flip:
        brightness, valid = brightness[::-1], valid[::-1]
    return Image(image.name, np.ascontiguousarray(brightness), np.ascontiguousarray(valid))
