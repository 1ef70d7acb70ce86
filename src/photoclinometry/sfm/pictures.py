"""What the keypoint detector sees of an image: its brightness, and the relief that its shading tells of."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import Image

SIGMA_PX = 12.0
"""Of the Gaussian windows in which the relief's picture is normalised."""
LONGEST_PX = 10.0
"""Wavelength beyond which relief is damped."""
NOISE_PX = 0.7
"""Standard deviation of the blur against noise, which the division by slopes makes strong."""
DAMPING = 0.03
"""Of waves across the Sun's direction: the squared cosine of the angle to it at which half is left (80 degrees)."""
MIN_SUN_IN_PLANE = 0.15
"""Sine of the phase angle below which shading is no slope towards the Sun."""


def brightness_picture(image: Image) -> np.ndarray:
    """(height, width) uint8, linear between percentiles of valid pixels.

    Raises InputError where the image shows nothing.
    """
    values = image.brightness[image.valid]
    low, high = np.percentile(values, [0.5, 99.8]) if values.size else (0.0, 0.0)
    if not high > low:
        raise InputError(f"{image.name}: constant or without valid pixels; leave this view out of the site")
    unit_range = np.clip((np.where(image.valid, image.brightness, low) - low) / (high - low), 0.0, 1.0)
    return np.rint(255.0 * unit_range).astype(np.uint8)


def relief_picture(image: Image, sun_in_cam: np.ndarray) -> np.ndarray | None:
    """(height, width) uint8: the ground's relief, the same whichever way it is lit; None for a Sun behind the camera.

    Brightness about its local mean is, to first order, the slope towards the Sun (Pentland 1990, Int. J. Comput. Vision
    4, 153): of relief Z(k), waves of I(k) ~ i (k . s) Z(k), s the Sun's direction in the image plane. So

        |k| Z(k)  ~  -i I(k) c / (c^2 + DAMPING),    c = k . s / (|k| |s|)

    is a picture of the relief, its waves of all lengths about alike, but for those across the Sun's direction, which it
    does not show. Lit from opposite sides, the shading of two images is opposite, and their relief the same.
    sun_in_cam: (3,) unit vector towards the Sun in C.
    """
    from scipy.ndimage import gaussian_filter

    in_plane = float(np.hypot(*sun_in_cam[:2]))
    if in_plane < MIN_SUN_IN_PLANE:
        return None
    typical = float(np.median(image.brightness[image.valid]))
    brightness = np.where(image.valid, image.brightness, typical).astype(float)
    # Ground in shadow must not be made as bright as the rest: the mean counts as a seventh of the typical at least.
    shading = brightness / np.maximum(gaussian_filter(brightness, SIGMA_PX), 0.15 * typical) - 1.0
    margin = int(3 * SIGMA_PX)
    shading = np.pad(shading, margin, mode="symmetric")
    y, x = np.fft.fftfreq(shading.shape[0])[:, None], np.fft.rfftfreq(shading.shape[1])[None]
    length = np.maximum(np.hypot(x, y), 1e-9)
    cosine = (x * sun_in_cam[0] + y * sun_in_cam[1]) / (length * in_plane)
    filter_ = -1j * cosine / (cosine**2 + DAMPING) / (1.0 + (LONGEST_PX * length) ** -2)
    filter_ *= np.exp(-2.0 * (np.pi * NOISE_PX * length) ** 2)
    relief = np.fft.irfft2(np.fft.rfft2(shading) * filter_, shading.shape)[margin:-margin, margin:-margin]
    contrast = np.sqrt(gaussian_filter(relief**2, SIGMA_PX) + (0.1 * relief.std()) ** 2)
    return np.rint(np.clip(127.5 + 40.0 * relief / np.maximum(contrast, 1e-12), 0.0, 255.0)).astype(np.uint8)
