"""The width of a camera's point-spread function, determined from images of rough ground.

Natural ground is rough at all scales: the power of its brightness falls as a power of the wave number (Pentland 1984,
doi:10.1109/TPAMI.1984.4767591). Pixels and point-spread function attenuate short waves more than long ones, and noise
adds the same power to all. The power spectrum of images is therefore fitted with A k^-b B(k)^2 exp(-s^2 k^2) + N. B is
a pixel's transfer function; s is the standard deviation of a Gaussian that stands for the point-spread function and for
the finest waves that the ground itself may lack.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence

import numpy as np

from photoclinometry.model.image import Image
from photoclinometry.model.scene import Scene
from photoclinometry.model.tiny import TINY

log = logging.getLogger(__name__)

USUAL_PX = 0.5
"""Standard deviation of the point-spread function of lenses that fit their pixels [px]. It is used where images do not
determine another one, or show no more blur than this one and smooth ground together."""

SMOOTH_GROUND_PX = 0.4
"""Blur that stands for the missing finest waves of ground that is settled dust, or a model of limited resolution [px].
Images of simulated ground without a point-spread function have 0.41 px."""

WIDEST_PX = 1.0
"""Cameras in focus are sharper than this. Relief without short waves looks like more blur, and restoration with that
blur adds waves to the map that do not exist."""

WINDOW_PX = 48
"""Side of the windows whose spectra are taken: a dozen of the shortest waves above the noise, and small compared with
an image, so that dozens of windows are free of shadows and sky."""

MOST, FEWEST = 1000, 10
"""Most windows that are used, evenly chosen, and fewest that determine a width. The median of ten spectra in rings of
dozens of coefficients is good to a few per cent."""

DARK, SHADOW = 0.3, 0.2
"""Least ratios for a window to count: of its median to that of the brightest tenth, and of its darkest pixel to its own
median. Edges of sky and cast shadows are sharper than ground."""

LONGEST_WAVE_PX = 18.0
"""Longer waves are too few in a window, and are distorted by the subtracted plane."""

RINGS = 23
"""Rings of wave numbers, down to waves of two pixels, in which power is averaged."""

MISFIT = 0.15
"""Root mean square difference of the spectrum's logarithm from the fit, beyond which the law does not hold. Simulated
ground of three kinds and images of Vesta have 0.01 to 0.05."""


UNCERTAIN_PX = 0.2
"""Standard deviation of the width, by the fit, beyond which the width counts as unknown. It is 0.02 to 0.15 px where
the ground shows the width, and without limit where noise hides it."""

FLATTEST = 0.7
"""Least exponent of the power law of ground, whose spectra have 1.3 to 3. Noise alone has 0."""


def psf_sigma_px(images: Sequence[Image]) -> float:
    """Standard deviation [px] of the point-spread function that images of one camera have in common.

    At most WIDEST_PX. USUAL_PX where the images do not determine it. Less than USUAL_PX only where the measured blur,
    that of the ground included, is less.
    """
    spectra = [_spectrum(window) for window in _windows(images)]
    if len(spectra) < FEWEST:
        log.info("point-spread function: %d windows of plain ground, too few to tell its width", len(spectra))
        return USUAL_PX
    exponent, variance, uncertainty, misfit = _fit(np.median(spectra, axis=0))
    if misfit > MISFIT:
        log.info("point-spread function: the ground's spectrum follows no power law (misfit %.2f)", misfit)
        return USUAL_PX
    found = np.sqrt(max(variance, 0.0))
    if exponent < FLATTEST or uncertainty > 2.0 * UNCERTAIN_PX * max(found, USUAL_PX):
        log.info("point-spread function: noise hides its width")
        return USUAL_PX
    without_ground = np.sqrt(max(found**2 - SMOOTH_GROUND_PX**2, 0.0))
    sigma_px = float(np.clip(without_ground, min(found, USUAL_PX), WIDEST_PX))
    log.info(
        "point-spread function: %.2f px; the spectrum of %d windows shows %.2f (misfit %.2f)",
        sigma_px,
        len(spectra),
        found,
        misfit,
    )
    return sigma_px


def reference_psf_sigma_px(scene: Scene, images: Sequence[Image]) -> float:
    """Standard deviation [px] for the reference view's camera, from the images that it took. images: one for each
    view."""
    cameras = scene.views.cameras
    return psf_sigma_px(
        [image for image, camera in zip(images, cameras, strict=True) if camera == cameras[scene.reference]]
    )


def _windows(images: Sequence[Image]) -> Iterator[np.ndarray]:
    """Windows (WINDOW_PX, WINDOW_PX) of lit ground without deep shadows, at most MOST of them."""
    step = WINDOW_PX // 2
    parts = [
        (image, np.s_[row : row + WINDOW_PX, col : col + WINDOW_PX])
        for image in images
        for row in range(0, image.valid.shape[0] - WINDOW_PX + 1, step)
        for col in range(0, image.valid.shape[1] - WINDOW_PX + 1, step)
    ]
    every = max(1, -(-len(parts) // MOST))
    windows = [image.brightness[part] for image, part in parts[::every] if image.valid[part].all()]
    if not windows:
        return
    median = np.array([np.median(window) for window in windows])
    least = max(DARK * float(np.quantile(median, 0.9)), TINY)
    for window, middle in zip(windows, median, strict=True):
        if middle >= least and window.min() >= SHADOW * middle:
            yield window / middle


def _wave_numbers() -> tuple[np.ndarray, np.ndarray]:
    """Of the Fourier coefficients of a window: wave numbers (n, n) [rad/px], and the ring of each, from 1, of RINGS."""
    along = 2.0 * np.pi * np.fft.fftfreq(WINDOW_PX)
    number = np.hypot(along[:, None], along)
    return number, np.digitize(number, np.linspace(2.0 * np.pi / LONGEST_WAVE_PX, np.pi, RINGS + 1))


_NUMBER, _RING = _wave_numbers()
_TAPER = np.outer(*2 * [np.hanning(WINDOW_PX + 2)[1:-1]])


def _of_rings(values: np.ndarray) -> np.ndarray:
    """(RINGS,) means of values (n, n) of coefficients."""
    total, count = (np.bincount(_RING.ravel(), each, RINGS + 2)[1:-1] for each in (values.ravel(), None))
    return total / count


def _spectrum(window: np.ndarray) -> np.ndarray:
    """(RINGS,) power of a window without its plane, divided by the power of the longer half of its waves."""
    across = np.linspace(-1.0, 1.0, WINDOW_PX)
    level = window - window.mean()
    level -= across * (level @ across).mean() / (across @ across)
    level -= across[:, None] * (across @ level).mean() / (across @ across)
    power = _of_rings(np.abs(np.fft.fft2(level * _TAPER)) ** 2)
    return power / max(float(power[: RINGS // 2].mean()), TINY)


def _fit(power: np.ndarray) -> tuple[float, float, float, float]:
    """The exponent and the Gaussian's variance [px^2] that fit a spectrum (RINGS,) best, the variance's standard
    deviation, and the misfit."""
    from scipy.optimize import least_squares

    number, log_power = _of_rings(_NUMBER), np.log(np.maximum(power, TINY))
    pixel = _of_rings(np.outer(*2 * [np.sinc(np.fft.fftfreq(WINDOW_PX)) ** 2]))

    def misfits(parameters: np.ndarray) -> np.ndarray:
        amplitude, exponent, variance, noise = parameters
        ground = amplitude - exponent * np.log(number) - variance * number**2 + np.log(pixel)
        return np.logaddexp(ground, noise) - log_power

    starts = [
        (log_power[0] + b * np.log(number[0]), b, s, log_power[-1] - 1.0) for b in (1.0, 2.0, 3.0) for s in (0.2, 0.8)
    ]
    best = min((least_squares(misfits, start) for start in starts), key=lambda fit: fit.cost)
    misfit = float(np.sqrt(np.mean(best.fun**2)))
    others = np.delete(best.jac, 2, axis=1)
    own = best.jac[:, 2] - others @ np.linalg.lstsq(others, best.jac[:, 2], rcond=None)[0]
    uncertainty = misfit * np.sqrt(RINGS) / max(float(np.linalg.norm(own)), TINY)
    return float(best.x[1]), float(best.x[2]), uncertainty, misfit
