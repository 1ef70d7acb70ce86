"""One exposure from an archive: its pixels, its label, and how the two belong together."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from photoclinometry.io.archives.pvl import Block
from photoclinometry.model.scene import Image


@dataclass(frozen=True)
class Window:
    """Which part of its detector an image shows: detector pixel = start + step * image pixel, in x and y."""

    start: tuple[float, float] = (0.0, 0.0)
    step: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Product:
    """An image as its file has it: nothing is turned, scaled to I/F, or undistorted yet."""

    path: Path
    """The file that was named: a label, or an image."""
    data: Path
    """The file that holds the pixels."""
    kind: str
    """"PDS3", "PDS4", "ISIS", "FITS" or "plain"."""
    image: Image
    """Row 0 is the first line of the file. Valid: finite, not special, not saturated."""
    label: Block = field(default_factory=lambda: Block(""))
    """What is written about the image; empty for plain images."""
    lines_up: bool | None = None
    """Whether the first line belongs at the bottom; None where the file does not say."""
    samples_left: bool | None = None
    """Whether the first sample belongs at the right; None where the file does not say."""
    window: Window | None = None
    """None where the file does not say; then the whole detector, binned if it is smaller."""
    tables: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """ISIS's tables by name: columns (n,) or (n, size) by field."""
