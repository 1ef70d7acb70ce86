"""From a detector as it is mounted to an upright pinhole: axes, mirror images, crops, binning, distortion.

Pixels are the package's, (0.5, 0.5) in the middle of the first line's first sample, here in the order of the file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.ingest.distortion import Distortion, Mirrored
from photoclinometry.io.archives.product import Window
from photoclinometry.model.errors import InputError
from photoclinometry.model.scene import Camera

_SKEW_TOLERANCE = 1e-3
BORESIGHT_Z = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NEGLIGIBLE_PX = 0.01
"""Displacements below are not worth resampling an image for."""


@dataclass(frozen=True, kw_only=True)
class Detector:
    """A camera's optics, and how its pixels lie on the focal plane."""

    width: int
    height: int
    focal_mm: float
    pitch_mm: tuple[float, float]
    """Distance of neighbouring samples, and of neighbouring lines."""
    center: tuple[float, float]
    """Pixel of the boresight (the principal point)."""
    axes: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 1.0))
    """Directions (x, y) on the focal plane in which samples and lines grow; unit vectors at right angles."""
    frame: tuple[tuple[float, float, float], ...] = BORESIGHT_Z
    """Rows: the focal plane's x and y, and the boresight, in the instrument's frame."""
    distortion: Distortion | None = None

    @property
    def mirrored(self) -> bool:
        """Whether samples to the right and lines down show the scene as in a mirror."""
        return bool(np.linalg.det(self.axes) < 0)


def detector_of_matrix(matrix: np.ndarray, **figures) -> Detector:
    """A detector from (2, 2) pixels per mm: (sample, line) grow by matrix @ (x, y). Raises InputError if skewed."""
    matrix = np.asarray(matrix, float)
    length = np.linalg.norm(matrix, axis=1)
    if not (np.isfinite(matrix).all() and (length > 0).all()):
        raise InputError(f"pixels per mm {matrix.tolist()} are no numbers or zero; correct the camera")
    axes = matrix / length[:, None]
    if abs(axes[0] @ axes[1]) > _SKEW_TOLERANCE:
        raise InputError(f"the detector's axes {axes.tolist()} are not at right angles; correct the camera")
    return Detector(axes=(_pair(axes[0]), _pair(axes[1])), pitch_mm=_pair(1.0 / length), **figures)


def windowed(detector: Detector, window: Window, width: int, height: int) -> Detector:
    """The detector of an image of width x height that shows a window of it."""
    (x0, y0), (dx, dy) = window.start, window.step
    return replace(
        detector,
        width=width,
        height=height,
        center=((detector.center[0] - x0) / dx, (detector.center[1] - y0) / dy),
        pitch_mm=(detector.pitch_mm[0] * dx, detector.pitch_mm[1] * dy),
    )


def turned_about(detector: Detector, *, lines: bool, samples: bool) -> Detector:
    """The same detector for an image whose lines or samples run the other way."""
    sample, line = (np.array(axis) for axis in detector.axes)
    x, y = detector.center
    signs = (-1.0 if samples else 1.0, -1.0 if lines else 1.0)
    return replace(
        detector,
        distortion=detector.distortion and Mirrored(detector.distortion, signs),
        axes=(_pair(-sample if samples else sample), _pair(-line if lines else line)),
        center=(detector.width - x if samples else x, detector.height - y if lines else y),
    )


def upright(detector: Detector) -> tuple[Camera, np.ndarray, bool]:
    """The pinhole camera, (3, 3) cam_from_instrument, and whether its image's lines run against the file's.

    Frame C has x along the samples, y along the lines as they then run, z along the boresight.
    """
    flip = detector.mirrored
    straight = turned_about(detector, lines=True, samples=False) if flip else detector
    turn = np.eye(3)
    turn[:2, :2] = straight.axes
    # Axes that are skew by a hair make no rotation: the nearest one is taken.
    u, _, vt = np.linalg.svd(turn @ np.array(detector.frame))
    focal = (detector.focal_mm / detector.pitch_mm[0], detector.focal_mm / detector.pitch_mm[1])
    camera = Camera("PINHOLE", detector.width, detector.height, (*focal, *straight.center))
    return camera, u @ vt, flip


def seen_pixels(detector: Detector, ideal: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of the file where the ideal (pinhole) pixels (..., 2) of the file are seen. Raises InputError."""
    if detector.distortion is None:
        return np.asarray(ideal, float)
    center, pitch = np.array(detector.center), np.array(detector.pitch_mm)
    return center + detector.distortion.distort((ideal - center) * pitch) / pitch


def displacement(detector: Detector) -> tuple[np.ndarray, float]:
    """(height, width, 2) pixels of the file to look at for each pixel of an undistorted image, and the farthest way."""
    x, y = np.meshgrid(np.arange(detector.width) + 0.5, np.arange(detector.height) + 0.5)
    ideal = np.stack([x, y], -1)
    seen = seen_pixels(detector, ideal)
    return seen, float(np.linalg.norm(seen - ideal, axis=-1).max())


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])
