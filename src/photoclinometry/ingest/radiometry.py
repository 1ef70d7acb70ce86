"""From the numbers in a file to radiance factor I/F, if the calibration is known."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.image import Image

AU_KM = 149_597_870.7
"""Astronomical unit [km] (IAU 2012, resolution B2)."""


def radiance_factor(radiance: np.ndarray, solar_flux: float, sun_distance_km: float) -> np.ndarray:
    """I/F = pi I d^2 / F of radiance I [W m^-2 um^-1 sr^-1].

    solar_flux: F, the Sun's irradiance in the filter at 1 AU [W m^-2 um^-1]; d: the body's distance from the Sun in AU.
    """
    return np.pi * radiance * (sun_distance_km / AU_KM) ** 2 / solar_flux


def calibrated(
    image: Image, unit: str | None, solar_flux: float | None, sun_distance_km: float | None
) -> tuple[Image, str]:
    """The image in I/F and "iof", if it is I/F or convertible radiance; otherwise the image unchanged and "dn".

    unit: as `Facts.unit`. Radiance is converted with `solar_flux` (see `radiance_factor`). Raises InputError for
    radiance with a solar flux but without a distance.
    """
    if unit == "iof":
        return image, "iof"
    if unit != "radiance" or solar_flux is None:
        return image, "dn"
    if sun_distance_km is None:
        raise InputError(
            "its radiance cannot be converted to I/F without the distance from the Sun: pass --kernels, or leave "
            "--solar-flux out to keep radiance as uncalibrated brightness"
        )
    converted = radiance_factor(image.brightness.astype(np.float64), solar_flux, sun_distance_km)
    return Image(image.name, converted.astype(np.float32), image.valid), "iof"


def without_saturation(image: Image, lowest: float | None) -> Image:
    """The image with pixels of brightness `lowest` and above invalid."""
    if lowest is None:
        return image
    valid = image.valid & (image.brightness < lowest)
    return Image(image.name, np.where(valid, image.brightness, np.float32(0)), valid)
