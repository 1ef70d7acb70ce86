"""Hole filling: new landmarks where none was matched, which the next matches confirm or drop.

Ground that was not matched under one light may be matched against the relit reference. For this it needs a position, a
normal and an albedo.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.sampling import filled_from_nearest
from photoclinometry.model.scene import Landmarks, Scene
from photoclinometry.surface.depth_fit import landmark_depth

SMALLEST_PX2 = 36
"""Smaller holes stay [reference pixels]: within matched ground they are blemishes of images and edges of shadows.
Filled on images of Vesta by Dawn, 22 such pixels of 160,000 cost 1 dB of PSNR."""

SMOOTHING = 2.0
"""Standard deviation [landmarks] of the Gaussian that smooths the new normals."""

REACH_PX = 6.0
"""Greatest distance of a new landmark from the others [reference pixels]: the standard deviation of a match's window
(`FlowOptions.contrast_window_px`). Farther away a match sees nothing but the extrapolated ground, and confirms it."""


def fill_holes(scene: Scene, reach_px: float = REACH_PX) -> Scene:
    """The scene with a landmark at every cell of the map's grid within reach of one; the new ones have no observations.

    The new landmarks lie on the smooth surface through the others (`landmark_depth`), with the normals (smoothed) and
    albedos of the nearest ones. This suffices to draw the ground under another light, and to match and triangulate it
    like the rest; cells that are not matched then drop out of the map. Normals are not those of the smooth surface,
    which are off by tens of degrees on the rims of craters: under grazing light such a landmark would count as unlit,
    and its brightness would never be used.
    """
    known, region, camera = scene.landmarks, scene.region, scene.views.cameras[scene.reference]
    pose = scene.views.body_from_cam[scene.reference]
    albedo = scene.grid(known.albedo)
    missing = ~np.isfinite(albedo)
    row, col = np.nonzero(_fillable(missing, region.stride, reach_px))
    if not len(row):
        return scene
    depth = landmark_depth(known.position, known.pixel, pose, region, camera)
    ground = pose((camera.ray_in_cam(region.pixel_centers()) * depth[..., None])[region.grid_slices])
    normal = _smoothed(filled_from_nearest(scene.grid(known.normal), ~missing))
    albedo = filled_from_nearest(albedo, ~missing)
    pixel = np.stack([region.row + region.stride * row, region.col + region.stride * col], -1).astype(np.int32)
    landmarks = Landmarks(
        position=np.concatenate([known.position, ground[row, col]]),
        normal=np.concatenate([known.normal, normal[row, col]]),
        albedo=np.concatenate([known.albedo, albedo[row, col]]),
        pixel=np.concatenate([known.pixel, pixel]),
    )
    start = np.concatenate([scene.tracks.start, np.full(len(row), scene.tracks.start[-1])])
    return replace(scene, landmarks=landmarks, tracks=replace(scene.tracks, start=start), uncertainty={})


def _fillable(missing: np.ndarray, stride: int, reach_px: float) -> np.ndarray:
    """(h, w) bool: missing cells within reach of a landmark, in holes that are not too small."""
    from scipy.ndimage import distance_transform_edt, label

    distance = stride * np.asarray(distance_transform_edt(missing))
    hole = np.empty(missing.shape, np.int32)
    label(missing, output=hole)
    area = np.bincount(hole.ravel())[hole] * stride**2
    return missing & (area >= SMALLEST_PX2) & (distance <= reach_px)


def _smoothed(normal: np.ndarray) -> np.ndarray:
    """Unit normals (h, w, 3) through a Gaussian of SMOOTHING cells."""
    from scipy.ndimage import gaussian_filter

    return unit(gaussian_filter(normal, (SMOOTHING, SMOOTHING, 0)))
