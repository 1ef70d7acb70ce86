"""From radiance to digital numbers: point-spread function, smear, pixels, electrons, digitiser.

    electrons = Poisson(exposure I/F) + read noise        exposure [electrons per I/F] differs by image
    DN        = round(electrons (2^bits - 1 - offset) / full well + offset), saturated at 2^bits - 1

A calibrated image is (DN - offset) / gain with gain [DN per I/F] known exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from photoclinometry.model.errors import InputError
from photoclinometry.model.ranges import Range, Ranged

PSF_REACH = 4.0
"""Standard deviations at which the point-spread function is cut off; 3e-4 of the light lies beyond."""
_MAX_SMEAR_PX = 64
"""Longest smear [px]: the kernel's size grows with it."""
_EXPOSED_PERCENTILE = 99.0
"""The brightness that sets the exposure; the brightest hundredth may saturate."""
_LEAST_BRIGHT = 1e-6
"""I/F that a dark image is exposed for, so that its exposure stays finite."""
_HOT_CHARGE, _RAY_CHARGE = (0.1, 1.2), (0.05, 0.8)
"""Range of the charge of a hot pixel, and of a pixel hit by a cosmic ray [full wells]."""
_RAY_LENGTH_PX = 4.0
"""Mean length of a cosmic ray's track beyond its first pixel [px]."""
_SATURATED_UINT16 = 65535
"""Mark of a saturated pixel in a 16-bit image; other pixels are below."""


@dataclass(frozen=True, kw_only=True)
class Detector(Ranged):
    """A framing camera behind a narrow-angle lens."""

    psf_sigma_px: Annotated[float, Range(least=0, most=64)] = 0.5
    """Gaussian point-spread function before the pixels integrate, standard deviation [px]."""
    smear_px: Annotated[float, Range(least=0, most=_MAX_SMEAR_PX)] = 0.0
    """Motion of the scene across the detector during an exposure [px], in a direction drawn per image.
    Poses and Suns in the truth are those of mid-exposure."""
    noise: bool = True
    """Simulate shot noise, read noise and rounding to whole DN; off: exact radiance."""
    full_well_e: Annotated[float, Range(above=0)] = 150_000.0
    """Electrons at which a pixel saturates."""
    read_noise_e: Annotated[float, Range(least=0)] = 20.0
    """Standard deviation of the read noise [electrons]."""
    bits: Annotated[int, Range(least=8, most=16)] = 14
    """Bits of the digitiser, 8 to 16."""
    exposure_level: Annotated[float, Range(above=0, most=1)] = 0.6
    """Share of the full well that the 99th percentile of an image's brightness reaches, on average."""
    exposure_spread: Annotated[float, Range(least=0, below=1)] = 0.15
    """Relative variation of the exposure between images: a factor per image, uniform within 1 -+ this."""
    offset_dn: Annotated[tuple[float, float], Range(least=0, most=2**15)] = (100.0, 300.0)
    """Range of the offset (DN without light), which differs between images [DN]."""
    hot_pixels: Annotated[float, Range(least=0, below=1)] = 0.0
    """Share of the pixels with a random extra charge, the same in every image."""
    cosmic_rays: Annotated[float, Range(least=0)] = 0.0
    """Mean number of cosmic ray hits per image."""

    def __post_init__(self):
        super().__post_init__()
        low, high = self.offset_dn
        if not low <= high <= 0.5 * 2**self.bits:
            raise InputError(
                f"offset_dn {low:g} to {high:g} must be a range within the lower half of {self.bits} bits, "
                f"0 to {2 ** (self.bits - 1)}"
            )

    @property
    def margin_px(self) -> int:
        """Distance beyond the frame from which light reaches it [px]."""
        return int(np.ceil(PSF_REACH * self.psf_sigma_px + 0.5 * self.smear_px))


@dataclass(frozen=True)
class Exposure:
    """One image as digitised."""

    dn: np.ndarray
    """(h, w) float64, whole numbers if there is noise."""
    saturated: np.ndarray
    """(h, w) bool."""
    gain: float
    """DN per I/F."""
    offset: float
    """DN without light."""

    @property
    def iof(self) -> np.ndarray:
        """(h, w) float32 radiance factor; NaN where saturated."""
        return np.where(self.saturated, np.nan, (self.dn - self.offset) / self.gain).astype(np.float32)

    @property
    def uint16(self) -> np.ndarray:
        """(h, w) raw numbers; 65535 where saturated."""
        return np.where(self.saturated, _SATURATED_UINT16, np.clip(np.round(self.dn), 0, _SATURATED_UINT16 - 1)).astype(
            np.uint16
        )


def smear_kernel(smear: tuple[float, float]) -> np.ndarray:
    """(n, n) weights of uniform motion by `smear` (x, y) samples about the centre, n odd; their sum is 1.

    Points along the line are distributed bilinearly to their four neighbours. This adds a blur of at most 1/4
    sample^2, so images are smeared before their samples are averaged to pixels.
    """
    length = float(np.hypot(*smear))
    half = int(np.ceil(0.5 * length)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    count = 8 * half  # points along the line: at least four per sample
    at = ((np.arange(count) + 0.5) / count - 0.5)[:, None] * np.array(smear) + half
    low = np.floor(at).astype(int)
    f = at - low
    for i in range(2):
        for j in range(2):
            weight = np.abs(1 - i - f[:, 1]) * np.abs(1 - j - f[:, 0]) / count
            np.add.at(kernel, (low[:, 1] + i, low[:, 0] + j), weight)
    return kernel


def pixel_average(
    fine: np.ndarray, supersampling: int, margin_px: int, sigma_px: float, smear_px: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Pixels (h, w, ...) from samples ((h + 2 margin) s, (w + 2 margin) s, ...).

    The samples are blurred by the point-spread function and by motion of `smear_px` (x, y), and averaged over each
    pixel; the margin is dropped.
    """
    from scipy.ndimage import gaussian_filter

    s = supersampling
    if any(smear_px):
        import cv2

        kernel = smear_kernel((smear_px[0] * s, smear_px[1] * s))
        fine = cv2.filter2D(fine, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    if sigma_px > 0:
        fine = gaussian_filter(fine, sigma_px * s, mode="nearest", axes=(0, 1))
    rows, cols = fine.shape[0] // s, fine.shape[1] // s
    pixels = fine.reshape(rows, s, cols, s, *fine.shape[2:]).mean((1, 3))
    return pixels[margin_px : rows - margin_px, margin_px : cols - margin_px]


def expose(
    radiance: np.ndarray,
    detector: Detector,
    rng: np.random.Generator,
    hot: np.ndarray | None = None,
    shows_sky: bool = False,
) -> Exposure:
    """Digitises an image of radiance factors (h, w) >= 0.

    hot: (h, w) extra charge of hot pixels [electrons], see `hot_pixel_charge`; shows_sky: what is not black sets
    the exposure, however small.
    """
    factor = 1.0 + detector.exposure_spread * rng.uniform(-1.0, 1.0)
    offset = float(np.round(rng.uniform(*detector.offset_dn)))
    measured = radiance[radiance > 0] if shows_sky and (radiance > 0).any() else radiance
    bright = max(float(np.percentile(measured, _EXPOSED_PERCENTILE)), _LEAST_BRIGHT)
    exposure = factor * detector.exposure_level * detector.full_well_e / bright
    electrons_per_dn = detector.full_well_e / (2**detector.bits - 1 - offset)
    electrons = exposure * np.asarray(radiance, float)
    if detector.noise:
        electrons = rng.poisson(electrons) + detector.read_noise_e * rng.standard_normal(electrons.shape)
    if hot is not None:
        electrons = electrons + hot
    electrons = electrons + _cosmic_rays(radiance.shape, detector, rng)
    dn = electrons / electrons_per_dn + offset
    if detector.noise:
        dn = np.round(dn)
    saturated = dn >= 2**detector.bits - 1
    dn = np.clip(dn, 0.0, 2.0**detector.bits - 1)
    return Exposure(dn, saturated, exposure / electrons_per_dn, offset)


def hot_pixel_charge(shape: tuple[int, int], detector: Detector, rng: np.random.Generator) -> np.ndarray | None:
    """(h, w) charge of the camera's hot pixels [electrons], or None if it has none."""
    if detector.hot_pixels == 0:
        return None
    hot = rng.random(shape) < detector.hot_pixels
    return hot * rng.uniform(*_HOT_CHARGE, shape) * detector.full_well_e


def _cosmic_rays(shape: tuple[int, ...], detector: Detector, rng: np.random.Generator) -> np.ndarray:
    """(h, w) charge [electrons] of short straight tracks."""
    charge = np.zeros(shape)
    for _ in range(rng.poisson(detector.cosmic_rays) if detector.cosmic_rays else 0):
        start, angle = rng.uniform(0, 1, 2) * shape, rng.uniform(0, np.pi)
        steps = np.arange(0.0, rng.exponential(_RAY_LENGTH_PX) + 1.0, 0.5)[:, None]
        at = np.round(start + steps * [np.sin(angle), np.cos(angle)]).astype(int)
        at = at[(at >= 0).all(1) & (at < shape).all(1)]
        charge[at[:, 0], at[:, 1]] = rng.uniform(*_RAY_CHARGE) * detector.full_well_e
    return charge
