"""Images: brightness that is linear in radiance, and where it is valid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Image:
    """One exposure's brightness, linear in radiance."""

    name: str
    """Name of the view: the image's path in `site.toml`."""
    brightness: np.ndarray
    """(height, width) float32: I/F, or linear DN. Defined only where `valid`."""
    valid: np.ndarray
    """(height, width) bool: finite, not saturated, not flagged."""
    dark_level: float = 0.0
    """Dark level that has been subtracted from an uncalibrated image: its level in shadows and sky."""

    def __repr__(self) -> str:
        height, width = self.valid.shape
        return f"<Image {self.name!r}: {width} x {height} pixels, {100.0 * self.valid.mean():.4g} % valid>"
