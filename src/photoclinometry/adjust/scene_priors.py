"""Knowledge of a scene apart from its images."""

from __future__ import annotations

from dataclasses import dataclass

from photoclinometry.adjust.graph.priors import KnownPoses, PosePriors
from photoclinometry.adjust.tie_points import GroundControl
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.reflectance import Reflectance


@dataclass(frozen=True, kw_only=True)
class ScenePriors:
    """Knowledge of a scene apart from its images.

    Without pose priors and control points only the gauge is fixed, by the reference view's pose and one landmark.
    Uncertainties are then those after the best similarity of the map.
    """

    pose_priors: PosePriors | None = None
    """Poses of spacecraft navigation, in the scene's frame."""
    known_poses: KnownPoses | None = None
    """Poses of a larger model, in the scene's frame, which they do not define."""
    control: GroundControl | None = None
    """Ground control points, in the scene's frame."""
    altimetry: AltimeterTracks | None = None
    """Laser altimetry, in the frame of a scene that pose priors or control points have put roughly in place."""
    reflectance: Reflectance | None = None
    """The prior reflectance, from which the scene's was estimated; None where it is the scene's own. It counts only
    where reflectance parameters are estimated, and must be of the scene's model."""
