"""The 8-bit pictures that keypoints are detected in: an image's brightness, and the relief that its shading reveals."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image
from photoclinometry.model.tiny import TINY

STRETCH_PERCENT = (0.5, 99.8)
"""Percentiles of brightness that become black and white: a few hot or dark pixels do not set the range."""

SIGMA_PX = 12.0
"""Standard deviation of the Gaussian windows in which the relief's picture is normalised: wider than keypoints."""
LONGEST_PX = 10.0
"""Wavelength beyond which relief is damped: longer waves would hide the detail in which keypoints are found."""
NOISE_PX = 0.7
"""Standard deviation of the blur against noise, which the division by the slopes' transfer function amplifies."""
DAMPING = 0.03
"""Damping of waves across the Sun's direction: squared cosine of the angle to it at which half is left (80 degrees)."""
MIN_SUN_IN_PLANE = 0.15
"""Sine of the phase angle below which shading hardly depends on the slope towards the Sun."""
DARKEST_MEAN = 0.15
"""Least local mean by which brightness is divided, as a share of the image's median: ground in shadow must not become
as bright as the rest."""
FLATTEST = 0.1
"""Least local contrast by which the relief is divided, as a share of the picture's: flat ground stays flat."""
GREY, GREYS_PER_SIGMA = 127.5, 40.0
"""Mean of the relief's picture, and grey values for one standard deviation: three fit into 8 bits."""


def shows_something(image: Image) -> bool:
    """Whether an image has valid pixels that differ."""
    if not image.valid.any():
        return False
    low, high = _black_and_white(image)
    return bool(high > low)


def brightness_picture(image: Image) -> np.ndarray:
    """(height, width) uint8, linear between percentiles of valid pixels; invalid pixels are black.

    Raises InputError where the image is constant or has no valid pixels.
    """
    values = image.brightness[image.valid]
    if not values.size:
        raise InputError(
            f"{image.name}: has no valid pixel (all NaN, saturated or sky); leave this view out of the site"
        )
    low, high = _black_and_white(image)
    if not high > low:
        share = 100.0 * np.mean(values == low)
        raise InputError(
            f"{image.name}: is constant: {share:.3g} % of its valid pixels are {low:g}; leave this view out of the site"
        )
    unit_range = np.clip((np.where(image.valid, image.brightness, low) - low) / (high - low), 0.0, 1.0)
    return np.rint(255.0 * unit_range).astype(np.uint8)


def _black_and_white(image: Image) -> np.ndarray:
    """(2,) brightness that becomes black and white."""
    return np.percentile(image.brightness[image.valid], STRETCH_PERCENT)


def relief_picture(image: Image, sun_in_cam: np.ndarray) -> np.ndarray | None:
    """(height, width) uint8: the ground's relief, the same under any Sun direction; None for a Sun behind the camera.

    Brightness about its local mean is, to first order, the slope towards the Sun (Pentland 1990, Int. J. Comput. Vision
    4, 153). Relief Z(k) has waves of brightness I(k) ~ i (k . s) Z(k), s the Sun's direction in the image plane. Hence

        |k| Z(k)  ~  -i I(k) c / (c^2 + DAMPING),    c = k . s / (|k| |s|)

    is a picture of the relief with waves of all lengths at about the same strength. Waves across the Sun's direction
    are missing, since they have no shading. Images lit from opposite sides have opposite shading and the same relief.
    sun_in_cam: (3,) unit vector towards the Sun in C.
    """
    from scipy.ndimage import gaussian_filter

    in_plane = float(np.hypot(*sun_in_cam[:2]))
    if in_plane < MIN_SUN_IN_PLANE:
        return None
    typical = float(np.median(image.brightness[image.valid]))
    brightness = np.where(image.valid, image.brightness, typical).astype(float)
    shading = brightness / np.maximum(gaussian_filter(brightness, SIGMA_PX), DARKEST_MEAN * typical) - 1.0
    margin = int(3 * SIGMA_PX)
    shading = np.pad(shading, margin, mode="symmetric")
    y, x = np.fft.fftfreq(shading.shape[0])[:, None], np.fft.rfftfreq(shading.shape[1])[None]
    length = np.maximum(np.hypot(x, y), TINY)
    cosine = (x * sun_in_cam[0] + y * sun_in_cam[1]) / (length * in_plane)
    filter_ = -1j * cosine / (cosine**2 + DAMPING) / (1.0 + (LONGEST_PX * length) ** -2)
    filter_ *= np.exp(-2.0 * (np.pi * NOISE_PX * length) ** 2)
    relief = np.fft.irfft2(np.fft.rfft2(shading) * filter_, shading.shape)[margin:-margin, margin:-margin]
    contrast = np.sqrt(gaussian_filter(relief**2, SIGMA_PX) + (FLATTEST * relief.std()) ** 2)
    grey = GREY + GREYS_PER_SIGMA * relief / np.maximum(contrast, TINY)
    return np.rint(np.clip(grey, 0.0, 255.0)).astype(np.uint8)
