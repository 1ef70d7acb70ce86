"""Sigmas of a direct refinement that allow for the disagreement of its last two estimates.

The first of the two uses brightness with its smooth errors, the last without them. An error that the whole map shares
shows in no residual. It shows in the distance by which its removal has moved poses, Suns and ground. The error that is
left after the removal is taken to be as large as this move.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from photoclinometry.adjust.covariance.uncertainty import OF_LANDMARKS
from photoclinometry.evaluate.metrics import normalised_square
from photoclinometry.evaluate.sigma_calibration import scene_errors
from photoclinometry.model.scene import OWN, Scene
from photoclinometry.model.sigma import sigma_along
from photoclinometry.surface.relief import local_frame

log = logging.getLogger(__name__)


def with_inflated_uncertainties(scene: Scene, before: Scene, sound: np.ndarray) -> Scene:
    """The scene with its uncertainties of each kind enlarged by the factor by which it moved beyond its noise.

    before: an earlier estimate of the same views and landmarks, by similar measurements. Each variance is multiplied by
    1 + m, m being the mean square of the moves over the stated variance, after the best similarity of the landmarks.
    Positions count by their heights, since their sigmas sideways are those of the reference view's rays. sound: (J,)
    bool, landmarks that count. A scene that states no uncertainties stays as it is.
    """
    moved = normalized_changes(scene, before, sound)
    log.info("moved beyond noise (mean squares): %s", ", ".join(f"{name} {m:.2f}" for name, m in moved.items()))
    stated = dict(scene.uncertainty)
    for name, square in moved.items():
        factor = 1.0 + square
        stated[name] = stated[name] * (np.sqrt(factor) if stated[name].ndim == 1 else factor)
    return replace(scene, uncertainty=stated)


def normalized_changes(scene: Scene, before: Scene, sound: np.ndarray) -> dict[str, float]:
    """Mean squares of the differences between two estimates over the variances that the first one states, by name."""
    if not scene.uncertainty:
        return {}
    common = float(np.median((before.landmarks.albedo / scene.landmarks.albedo)[sound]))
    position = np.where(sound[:, None], before.landmarks.position, np.nan)
    other = replace(before.landmarks, position=position)
    move = scene_errors(replace(scene, frame=OWN), before.views, other, common)
    found = {}
    for name, stated in scene.uncertainty.items():
        if name not in move:
            continue
        of = move[name]
        if name == "position":
            up = local_frame(scene).rotation[:, 2]
            of, stated = of @ up, sigma_along(stated, up)
        square = normalised_square(of, stated)
        square = square[np.isfinite(square) & (sound if name in OF_LANDMARKS else True)]
        if len(square):
            found[name] = float(square.mean())
    return found
