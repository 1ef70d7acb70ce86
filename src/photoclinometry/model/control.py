"""Ground control points: places of known position that were measured in images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class ControlPixel(NamedTuple):
    """The measured position of a control point in one image."""

    view: str
    """The view's name, as `site.toml` writes it."""
    x_px: float
    y_px: float
    sigma_px: float
    """Standard deviation along each axis."""


@dataclass(frozen=True, kw_only=True)
class ControlPoint:
    """A place of known position in the body-fixed frame, with the pixels where it was measured."""

    name: str
    position: np.ndarray
    """(3,) in B, body-fixed [m]."""
    sigma: np.ndarray
    """(3,) standard deviations along the axes of B [m]."""
    pixels: tuple[ControlPixel, ...]
