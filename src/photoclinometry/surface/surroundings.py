"""The ground around a map, roughly, from sparse points: its shadows fall onto the map.

A map is a part of what the images show, and under a low Sun it is often the ground beside it (the rim of the crater
that is mapped) that shades it. Structure from motion has points there.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.scene import Camera, Region, Surroundings
from photoclinometry.model.sparse import SparseModel
from photoclinometry.surface.depth_fit import fit_depth

FINEST, NODES = 4, 160
"""The surface has a node at every fourth pixel of the reference image, and up to so many along its longer side."""

NOISE_GSD, CURVATURE_PER_PX = 0.5, 0.1
"""How well points are known, by which the ground is taken to lie lower than they say, so that nothing is shaded by
noise; and how rough it is (`prewarp.fit_depth`): ten times as rough as for matching, since it is rims that cast
shadows."""

REACH_PX = 32.0
"""How far from any point the surface counts [reference pixels]."""

MIN_POINTS = 12
"""Fewer points beside the map tell nothing."""

FACING = 0.5
"""Cosine between the directions from which a point was seen and from which the reference would see it: what no view saw
from within 60 degrees may lie behind what the reference sees."""


def surroundings_of(
    sparse: SparseModel, reference: int, region: Region, position: np.ndarray, pixel: np.ndarray, camera: Camera
) -> Surroundings | None:
    """What lies around the map in the reference image, from a node beside it on; None where hardly anything is known.

    position, pixel: (J, 3) and (J, 2) row and column, of the map's landmarks, which the surface continues.
    camera: of the reference.
    """
    pose = sparse.body_from_cam[reference]
    points = sparse.points[_facing(sparse, pose)]
    local = pose.inverse()(points)
    local = local[local[:, 2] > 0]
    xy = camera.pixel_from_cam(local)
    inside = np.all((xy >= 0) & (xy <= (camera.width, camera.height)), axis=-1)
    beside = inside & ~_within(region, xy)
    if beside.sum() < MIN_POINTS:
        return None
    stride = max(FINEST, -(-max(camera.width, camera.height) // NODES))
    (row, col), step = region.cells(pixel), max(1, stride // region.stride)
    kept = (row % step == 0) & (col % step == 0)
    samples = np.concatenate([xy[beside], pixel[kept, ::-1] + 0.5])
    depth = np.concatenate([local[beside, 2], pose.inverse()(position[kept])[:, 2]])
    frame = Region(row=0, col=0, height=camera.height, width=camera.width, stride=stride)
    surface = fit_depth(samples, depth, frame, camera, stride, NOISE_GSD, CURVATURE_PER_PX)[frame.grid_slices]
    at = frame.pixel_centers()[frame.grid_slices]
    known = (_distance(at, samples) <= REACH_PX) & ~_within(region, at, margin_px=stride)
    lower = NOISE_GSD * np.median(depth) / np.mean(camera.focal_px)
    return Surroundings(depth=np.where(known, surface + lower, np.nan), stride=stride)


def _within(region: Region, xy: np.ndarray, margin_px: float = 0.0) -> np.ndarray:
    """(...,) bool: pixel positions (..., 2) in a region with a margin around it."""
    low = np.array([region.col, region.row]) - margin_px
    return np.all((xy > low) & (xy < low + 2 * margin_px + (region.width, region.height)), axis=-1)


def _facing(sparse: SparseModel, pose: Rigid) -> np.ndarray:
    """(P,) bool: points that some view saw from about where a camera at `pose` is."""
    of = sparse.point_of_observation
    seen_from = unit(sparse.body_from_cam.translation[sparse.point_view] - sparse.points[of])
    cosine = np.sum(seen_from * unit(pose.translation - sparse.points)[of], -1)
    nearest = np.full(len(sparse.points), -1.0)
    np.maximum.at(nearest, of, cosine)
    return nearest > FACING


def _distance(at: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Distances (h, w) from places (h, w, 2) to the nearest of samples (n, 2)."""
    from scipy.spatial import KDTree

    return KDTree(samples).query(at)[0]
