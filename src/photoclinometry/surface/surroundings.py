"""The ground around a map, roughly, from sparse points: its shadows fall onto the map.

Images show more ground than the map holds. Under a low Sun the ground beside the map, such as the rim of the mapped
crater, often shades it. Structure from motion has points there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid, unit
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Scene, Surroundings
from photoclinometry.model.sparse import SparseModel
from photoclinometry.surface.depth_fit import MIN_POINTS, SurfaceModel, fit_depth
from photoclinometry.surface.relief import reference_depth

FINEST, NODES = 4, 160
"""Nodes of the surface are at least FINEST pixels of the reference image apart, and not many more than NODES along its
longer side, which limits the time."""

NOISE_GSD = 0.5
"""Standard deviation of the points' depths [ground sample distances]. The surface is lowered by as much, so that noise
casts no shadows."""

GROUND = SurfaceModel(noise_gsd=NOISE_GSD, curvature_per_px=0.1)
"""Ten times as rough as the surface used for matching: shadows are cast by rims, which that surface would flatten."""

REACH_PX = 32.0
"""The surface is used up to this distance from a point [reference pixels]."""

FACING = 0.5
"""Least cosine between the direction from which a point was seen and that from which the reference would see it. A
point that no view saw from within 60 degrees may be hidden from the reference."""


def surroundings_of(
    sparse: SparseModel, reference: int, region: Region, position: np.ndarray, pixel: np.ndarray, camera: Camera
) -> Surroundings | None:
    """The ground around the map as depths in the reference image; None for fewer than MIN_POINTS points.

    position, pixel: (J, 3) and (J, 2) row and column of the map's landmarks, which the surface continues.
    camera: of the reference. Depths are NaN within the map and up to a node around it, and far from any point.
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
    frame = Region.of_image(camera.height, camera.width, stride=stride)
    surface = fit_depth(samples, depth, frame, camera, stride, GROUND)[frame.grid_slices]
    at = frame.pixel_centers()[frame.grid_slices]
    known = (_distance(at, samples) <= REACH_PX) & ~_within(region, at, margin_px=stride)
    lower = NOISE_GSD * np.median(depth) / np.mean(camera.focal_px)
    return Surroundings(depth=np.where(known, surface + lower, np.nan), stride=stride)


def carried_along(before: Scene, after: Scene) -> Surroundings | None:
    """The ground around a map after an estimate: it keeps its position relative to the map.

    before, after: scenes of the same landmarks in the same order, in the same frame. An estimate moves the reference
    view along its line of sight by more than the height of the relief, since a narrow field of view hardly determines
    its distance. The depths of the landmarks change with it; these changes, as a plane over the image, are added.
    """
    around = before.surroundings
    if around is None:
        return None
    at = before.landmarks.pixel[:, ::-1] + 0.5
    middle = at.mean(axis=0)
    changed = reference_depth(after) - reference_depth(before)
    plane = np.linalg.lstsq(np.column_stack([np.ones(len(at)), at - middle]), changed, rcond=None)[0]
    rows, cols = around.depth.shape
    x, y = np.meshgrid(around.stride * np.arange(cols) + 0.5, around.stride * np.arange(rows) + 0.5)
    return replace(around, depth=around.depth + plane[0] + plane[1] * (x - middle[0]) + plane[2] * (y - middle[1]))


def _within(region: Region, xy: np.ndarray, margin_px: float = 0.0) -> np.ndarray:
    """(...,) bool: pixel positions (..., 2) lie in a region or in the margin around it."""
    low = np.array([region.col, region.row]) - margin_px
    return np.all((xy > low) & (xy < low + 2 * margin_px + (region.width, region.height)), axis=-1)


def _facing(sparse: SparseModel, pose: Rigid) -> np.ndarray:
    """(P,) bool: points that some view saw from within 60 degrees (FACING) of a camera at `pose`."""
    point = sparse.point_of_observation
    seen_from = unit(sparse.body_from_cam.translation[sparse.point_view] - sparse.points[point])
    cosine = np.sum(seen_from * unit(pose.translation - sparse.points)[point], -1)
    largest = np.full(len(sparse.points), -1.0)
    np.maximum.at(largest, point, cosine)
    return largest > FACING


def _distance(at: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Distances (h, w) from places (h, w, 2) to the nearest of samples (n, 2)."""
    from scipy.spatial import KDTree

    return KDTree(samples).query(at)[0]
