"""The first estimate of a large map, by some of its landmarks.

The map is then relit and matched again, so that shading adds the missing detail. A quarter of the landmarks determine
the parameters that all landmarks share as well as all of them do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from photoclinometry.adjust import Adjustment
from photoclinometry.model.geometry import unit
from photoclinometry.model.sampling import filled_from_nearest, sample
from photoclinometry.model.scene import Scene
from photoclinometry.photometry.shading import normals_from_shading
from photoclinometry.surface.relief import reference_depth

FIRST_STRIDE = 2
"""Spacing of the landmarks in the first estimate [rows and columns of the map]."""

LARGE = 40_000
"""Landmarks from which on a map is first estimated by some. Smaller ones take seconds, and need all that they have."""

_WHOLE = 1.0 - 1e-6
"""Share of the cells around a place that must have a landmark, up to rounding."""


def first_estimate(start: Scene, estimate: Callable[[Scene], Adjustment]) -> Adjustment:
    """The scene estimated from `start`. In a large map some landmarks are estimated and the others interpolated."""
    if len(start.landmarks) < LARGE:
        return estimate(start)
    part = start.of_every(FIRST_STRIDE)
    found = estimate(part)
    return replace(found, scene=interpolated_estimate(found.scene, part, start))


def interpolated_estimate(found: Scene, before: Scene, scene: Scene) -> Scene:
    """The scene with all landmarks interpolated from the estimate of some of them.

    found: the estimate of those landmarks; before: the same landmarks at its start; scene: all landmarks at their
    start. Cubic splines interpolate depths in the reference view, normals and albedos. Beside holes and at the map's
    edge, where estimated landmarks are missing on some side, the depth of a landmark changes by as much as that of the
    nearest estimated one. Normals and albedos are then sharpened by the landmarks' own brightness.
    """
    step = found.region.stride // scene.region.stride
    row, col = scene.cells
    cell = np.stack([col, row], -1) / step + 0.5
    there = np.isfinite(found.grid(found.landmarks.albedo))

    def between(values: np.ndarray, order: int = 3) -> np.ndarray:
        return sample(filled_from_nearest(found.grid(values), there), cell, order=order)

    depth, old = reference_depth(found), reference_depth(before)
    rows, cols = there.shape
    inside = (cell <= np.array([cols, rows]) - 0.5).all(-1)
    inside &= sample(there.astype(float), cell, order=1) >= _WHOLE
    deep = np.where(inside, between(depth), reference_depth(scene) * between(depth / old, 0))
    pose = found.views.body_from_cam[found.reference]
    ray = found.views.cameras[found.reference].ray_in_cam(scene.landmarks.pixel[:, ::-1] + 0.5)
    landmarks = replace(
        scene.landmarks,
        position=pose(ray * deep[:, None]),
        normal=unit(between(found.landmarks.normal)),
        albedo=between(found.landmarks.albedo, 1),
    )
    whole = replace(
        scene,
        views=found.views,
        landmarks=landmarks,
        surroundings=found.surroundings,
        reflectance=found.reflectance,
        frame=found.frame,
        uncertainty={},
    )
    return whole if whole.reflectance is None else normals_from_shading(whole)
