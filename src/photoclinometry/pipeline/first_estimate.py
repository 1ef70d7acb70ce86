"""The first estimate of a large map, by some of its landmarks.

It is relit and matched again, so that what it lacks in detail is made up for by shading. A quarter of the landmarks
tell all that landmarks share as well as all of them do.
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
"""Of every so many rows and columns there is a landmark in the first estimate."""

LARGE = 40_000
"""Landmarks from which on a map is first estimated by some. Smaller ones take seconds, and need all that they have."""

_WHOLE = 1.0 - 1e-6
"""Share of the cells around a place that must have a landmark, up to rounding."""


def first_estimate(start: Scene, estimate: Callable[[Scene], Adjustment]) -> Adjustment:
    """The scene estimated from `start`; of a large map some landmarks are, and the others between them."""
    if len(start.landmarks) < LARGE:
        return estimate(start)
    part = start.of_every(FIRST_STRIDE)
    found = estimate(part)
    return replace(found, scene=interpolated_estimate(found.scene, part, start))


def interpolated_estimate(found: Scene, before: Scene, scene: Scene) -> Scene:
    """The scene at its start, all landmarks as the estimate has some: found, at whose start they were `before`.

    Depths in the reference view, normals and albedos are those between the landmarks that were estimated, by cubic
    splines. Beside holes and at the map's edge, where there are none on all sides, a landmark keeps its depth but for
    what the nearest one's has changed by. Normals and albedos are then sharpened by the landmarks' own brightness.
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
