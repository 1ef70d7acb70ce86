"""Prior knowledge of a pose, from spacecraft navigation."""

from __future__ import annotations

from dataclasses import dataclass

from photoclinometry.model.geometry import Rigid


@dataclass(frozen=True)
class PosePrior:
    """What is known of a view's pose beforehand."""

    cam_from_body: Rigid
    rotation_sigma_rad: float
    """Standard deviation about each axis."""
    translation_sigma: float
    """Standard deviation of the camera's centre along each axis, in the unit of B (metres, where B is body-fixed)."""
