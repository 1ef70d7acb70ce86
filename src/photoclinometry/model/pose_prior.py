"""Pose priors, from spacecraft navigation."""

from __future__ import annotations

from dataclasses import dataclass

from photoclinometry.model.geometry import Rigid


@dataclass(frozen=True)
class PosePrior:
    """A view's pose as navigation gives it, with standard deviations."""

    cam_from_body: Rigid
    rotation_sigma_rad: float
    """Standard deviation about each axis."""
    translation_sigma: float
    """Standard deviation of the camera's centre along each axis, in the unit of B (metres, where B is body-fixed)."""
    common_rotation_sigma_rad: float = 0.0
    """In addition, of a common rotation error in C of the attitudes of all views of an arc, about each axis."""
    common_translation_sigma: float = 0.0
    """In addition, of a common shift in B of the centres of all views of an arc, along each axis, in the same unit."""
