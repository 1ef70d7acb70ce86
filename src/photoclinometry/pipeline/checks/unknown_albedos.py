"""Albedos that the images hardly determine, such as those of ground that is lit in one view only."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from photoclinometry.evaluate.unreliable import albedo_is_known
from photoclinometry.model.sampling import filled_from_nearest
from photoclinometry.model.scene import Scene

log = logging.getLogger(__name__)


def with_neighbours_albedos(scene: Scene) -> Scene:
    """The scene with each unknown albedo replaced by that of the nearest landmark whose albedo is known. Stated
    uncertainties stay.

    One landmark of 160,000 that a single view lights can have six times the albedo of its surroundings, and renderings
    show it under every light. A scene that states nothing of its albedos stays as it is.
    """
    if "albedo_relative" not in scene.uncertainty:
        return scene
    albedo = scene.landmarks.albedo
    known = albedo_is_known(scene)
    if known.all() or not known.any():
        return scene
    log.info("%d landmarks of unknown albedo have that of their neighbours", np.count_nonzero(~known))
    there = np.nan_to_num(scene.grid(known.astype(float))) > 0.0
    near = filled_from_nearest(scene.grid(albedo), there)[scene.cells]
    return replace(scene, landmarks=replace(scene.landmarks, albedo=np.where(known, albedo, near)))
