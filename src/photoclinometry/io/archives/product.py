"""One exposure from an archive: pixels, label, and the orientation that the label gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from photoclinometry.io.archives.pvl import Block
from photoclinometry.model.image import Image


@dataclass(frozen=True)
class Window:
    """The part of a detector that an image covers: detector pixel = start + step * image pixel, in x and y."""

    start: tuple[float, float] = (0.0, 0.0)
    step: tuple[float, float] = (1.0, 1.0)
    parent: tuple[int, int] | None = None
    """(width, height) of the image that this one was cut from, if start and step count its pixels."""


@dataclass(frozen=True, kw_only=True)
class Product:
    """An image as stored: not yet turned upright, converted to I/F, or undistorted."""

    path: Path
    """The file that was named: a label, or an image."""
    data: Path
    """The file that holds the pixels."""
    kind: str
    """"PDS3", "PDS4", "ISIS", "FITS" or "plain"."""
    image: Image
    """Row 0 is the first line of the file. Valid: finite, not a special value, not saturated."""
    label: Block = field(default_factory=lambda: Block(""))
    """The label of the image; empty for plain images."""
    lines_up: bool | None = None
    """Whether the first line belongs at the bottom; None if the label does not give it."""
    samples_left: bool | None = None
    """Whether the first sample belongs at the right; None if the label does not give it."""
    window: Window | None = None
    """None if the label does not give it; the image then covers the whole detector, binned if it is smaller."""
    tables: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """ISIS's tables by name: columns (n,) or (n, size) by field."""
