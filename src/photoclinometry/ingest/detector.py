"""The detector of a camera, and the upright pinhole camera that it amounts to: axes, mirroring, crops, binning.

Pixels are in the order of the file, with (0.5, 0.5) in the middle of the first line's first sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from photoclinometry.ingest.distortion import Distortion, Mirrored
from photoclinometry.io.archives.product import Window
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.region import Region

_SKEW_TOLERANCE = 1e-3
"""Cosine between the axes of a detector up to which they count as perpendicular: 0.5 px in 500 px."""
BORESIGHT_Z = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""`Detector.frame` of an instrument whose frame is that of the focal plane."""


@dataclass(frozen=True, kw_only=True)
class Detector:
    """The optics of a camera, and the place of its pixels on the focal plane."""

    width: int
    height: int
    focal_mm: float
    pitch_mm: tuple[float, float]
    """Distance of neighbouring samples, and of neighbouring lines [mm]."""
    center: tuple[float, float]
    """Pixel coordinates of the boresight (the principal point)."""
    axes: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 1.0))
    """Directions (x, y) on the focal plane in which samples and lines increase; perpendicular unit vectors."""
    frame: tuple[tuple[float, float, float], ...] = BORESIGHT_Z
    """Rows: the x and y axes of the focal plane, and the boresight, in the instrument's frame."""
    distortion: Distortion | None = None

    @property
    def mirrored(self) -> bool:
        """Whether the image is mirrored if samples run right and lines run down."""
        return bool(np.linalg.det(self.axes) < 0)


def detector_of_matrix(matrix: np.ndarray, **figures: Any) -> Detector:
    """A detector with (sample, line) = matrix (2, 2) @ (x, y) [px/mm]. Raises InputError if the axes are skewed."""
    matrix = np.asarray(matrix, float)
    length = np.linalg.norm(matrix, axis=1)
    if not (np.isfinite(matrix).all() and (length > 0).all()):
        raise InputError(f"pixels per mm {matrix.tolist()} are zero or not finite; correct the camera")
    axes = matrix / length[:, None]
    if abs(axes[0] @ axes[1]) > _SKEW_TOLERANCE:
        raise InputError(f"the detector's axes {axes.tolist()} are not at right angles; correct the camera")
    return Detector(axes=(_pair(axes[0]), _pair(axes[1])), pitch_mm=_pair(1.0 / length), **figures)


def windowed(detector: Detector, window: Window, width: int, height: int) -> Detector:
    """The detector for an image of width x height that shows a window of it."""
    (x0, y0), (dx, dy) = window.start, window.step
    return replace(
        detector,
        width=width,
        height=height,
        center=((detector.center[0] - x0) / dx, (detector.center[1] - y0) / dy),
        pitch_mm=(detector.pitch_mm[0] * dx, detector.pitch_mm[1] * dy),
    )


def fitted(detector: Detector, width: int, height: int, raw_lines: int | None = None) -> Detector:
    """The detector for an image of width x height: the whole, binned by a whole number, or with taller pixels.

    raw_lines: lines of images with taller pixels. Raises InputError for other sizes, whose place on the detector is
    unknown.
    """
    if (width, height) == (detector.width, detector.height):
        return detector
    if (width, height) == (detector.width, raw_lines):
        return windowed(detector, Window((0.0, 0.0), (1.0, detector.height / height)), width, height)
    binning = detector.width // width
    if binning < 1 or (width * binning, height * binning) != (detector.width, detector.height):
        raise InputError(
            f"the image is {width} x {height} pixels, but its camera has {detector.width} x {detector.height}, and the "
            "label does not give the part shown: give the whole image, or the intrinsics with --pinhole"
        )
    return windowed(detector, Window((0.0, 0.0), (float(binning), float(binning))), width, height)


def turned_about(detector: Detector, *, lines: bool, samples: bool) -> Detector:
    """The same detector for an image with its lines or samples in reverse order."""
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
    """The pinhole camera, (3, 3) cam_from_instrument, and whether the lines of the file must be reversed for it.

    Frame C has x along the samples, y along the (reversed) lines, z along the boresight.
    """
    flip = detector.mirrored
    straight = turned_about(detector, lines=True, samples=False) if flip else detector
    turn = np.eye(3)
    turn[:2, :2] = straight.axes
    # The nearest rotation, since published axes are perpendicular only up to rounding.
    u, _, vt = np.linalg.svd(turn @ np.array(detector.frame))
    focal = (detector.focal_mm / detector.pitch_mm[0], detector.focal_mm / detector.pitch_mm[1])
    camera = Camera("PINHOLE", detector.width, detector.height, (*focal, *straight.center))
    return camera, u @ vt, flip


def seen_pixels(detector: Detector, ideal: np.ndarray) -> np.ndarray:
    """Observed pixels (..., 2) of ideal (pinhole) pixels (..., 2), both of the file. Raises InputError."""
    if detector.distortion is None:
        return np.asarray(ideal, float)
    center, pitch = np.array(detector.center), np.array(detector.pitch_mm)
    return center + detector.distortion.distort((ideal - center) * pitch) / pitch


def displacement(detector: Detector) -> tuple[np.ndarray, float]:
    """(height, width, 2) observed pixel of every pixel of the undistorted image, and the largest displacement [px]."""
    ideal = Region.of_image(detector.height, detector.width).pixel_centers()
    seen = seen_pixels(detector, ideal)
    return seen, float(np.linalg.norm(seen - ideal, axis=-1).max())


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])
