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
    """Besides, of a rotation in C by which the attitudes of all views of an arc are off alike, about each axis."""
    common_translation_sigma: float = 0.0
    """Besides, of a shift in B by which the centres of all views of an arc are off alike, along each axis, in the same
    unit."""
