"""A scene in the solver's order: landmarks along a space-filling curve, then tie points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust.graph.layout import morton_order
from photoclinometry.adjust.graph.observations import ImageGradients
from photoclinometry.adjust.tie_points import GroundControl, Members, TiePoints, with_tie_points
from photoclinometry.model.scene import Scene, Tracks


@dataclass(frozen=True, kw_only=True)
class Sorted:
    """A scene in the solver's order of landmarks, with tie points."""

    scene: Scene
    gradients: ImageGradients | None
    members: Members
    order: np.ndarray
    """(J,) the given scene's landmarks in the solver's order."""
    picked: np.ndarray
    """(N,) likewise of its observations."""


def in_solver_order(
    scene: Scene,
    gradients: ImageGradients | None,
    tie_points: TiePoints | None = None,
    control: GroundControl | None = None,
) -> Sorted:
    """A scene in the solver's form: brightness and gradients times the gradients' factor, tie points at the end."""
    order = morton_order(scene.landmarks.pixel)
    tracks, picked = scene.tracks.of_landmarks(order)
    if gradients is not None:
        tracks, gradients = _without_smooth_errors(tracks, gradients.of(picked))
    own = replace(scene, landmarks=scene.landmarks[order], tracks=tracks)
    joined, gradients, members = with_tie_points(own, gradients, tie_points, control)
    return Sorted(scene=joined, gradients=gradients, members=members, order=order, picked=picked)


def _without_smooth_errors(tracks: Tracks, gradients: ImageGradients) -> tuple[Tracks, ImageGradients]:
    """Brightness and its gradients times the gradients' `factor`."""
    factor = gradients.factor
    if factor is None:
        return tracks, gradients
    gradients = gradients._replace(gradient=(gradients.gradient * factor[:, None]).astype(np.float32))
    return replace(tracks, brightness=tracks.brightness * factor), gradients
