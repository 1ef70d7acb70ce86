"""The score of each part of an image as a place for the map: seen in detail by many views, lit, and not too oblique."""

from __future__ import annotations

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import unit
from photoclinometry.model.image import Image
from photoclinometry.model.sparse import SparseModel
from photoclinometry.surface.neighbours import PLANE_NEIGHBOURS, normals_from_neighbours

CELL = 16
"""Side of the cells in which a view is scored [px]: small compared with a region, and about the spacing of sparse
points."""

FULL_COSINE = 0.5
"""Cosine of incidence above which a higher Sun is no gain: oblique light, of 60 degrees, shows relief."""

NEAREST = 8
"""Number of sparse points over which medians give a cell's angles and detail."""

REACH_CELLS = 6
"""Standard deviation of the Gaussian by which a cell's score decreases with the distance of these points [cells]."""


def cell_scores(
    sparse: SparseModel,
    view: int,
    image: Image,
    cameras: list[Camera],
    sun_in_body: np.ndarray,
    shadow_fraction: float,
) -> np.ndarray:
    """(rows, cols) score in [0, 1] of each whole cell of CELL x CELL pixels of a view.

        detail * lit * mu * min(mu0 / FULL_COSINE, 1)

    detail: share of the cell's detail that the registered views see (`_detail_seen`); lit: the share of its pixels that
    are valid and out of shadow; mu, mu0: cosines of emission and incidence. Detail and angles are medians over the
    sparse points nearest to the cell. Where these are far away the score falls off, since other views may not see the
    place. sun_in_body: (K, 3).
    """
    from scipy.spatial import KDTree

    shape = image.brightness.shape[0] // CELL, image.brightness.shape[1] // CELL
    index, xy = sparse.seen_by(view)
    if len(index) < PLANE_NEIGHBOURS:
        return np.zeros(shape)
    centers = sparse.body_from_cam.translation
    points = sparse.points[index]
    normal = normals_from_neighbours(points, centers[sparse.registered].mean(0))
    mu = np.sum(normal * unit(centers[view] - points), -1)
    mu0 = np.sum(normal * sun_in_body[view], -1)
    score = _detail_seen(sparse, view, points, cameras) * mu.clip(0) * (mu0 / FULL_COSINE).clip(0, 1)

    row, col = np.indices(shape)
    cells = np.stack([col + 0.5, row + 0.5], -1).reshape(-1, 2) * CELL
    distance, near = KDTree(xy).query(cells, k=NEAREST)
    trust = np.exp(-0.5 * (np.median(distance, -1) / (REACH_CELLS * CELL)) ** 2)
    local = (trust * np.median(score[near], -1)).reshape(shape)
    return local * _lit_share(image, shape, shadow_fraction)


def _detail_seen(sparse: SparseModel, view: int, points: np.ndarray, cameras: list[Camera]) -> np.ndarray:
    """(n,) share of the detail of a map at a view's resolution that the registered views see, at points (n, 3).

    The share of views with a point in their frame, coarser ones counted by the ratio of pixel areas; times the ratio of
    the finest view's GSD to this view's.
    """
    views = np.flatnonzero(sparse.registered)
    depth, inside = np.empty((2, len(views), len(points)))
    for n, k in enumerate(views):
        local = sparse.body_from_cam[k].inverse()(points)
        depth[n] = local[:, 2]
        xy, size = cameras[k].pixel_from_cam(local), np.array([cameras[k].width, cameras[k].height])
        inside[n] = (depth[n] > 0) & np.all((xy > 0) & (xy < size), axis=-1)
    gsd = np.median(depth, axis=1) / np.array([np.mean(cameras[k].focal_px) for k in views])
    gsd_here = gsd[views == view]
    seen = np.minimum((gsd_here / gsd)[:, None] ** 2, 1.0) * inside
    return seen.mean(0) * np.min(gsd[gsd > 0]) / gsd_here


def _lit_share(image: Image, shape: tuple[int, int], shadow_fraction: float) -> np.ndarray:
    """(rows, cols) share of each cell's pixels that are valid and not in shadow."""
    lit = image.valid & (image.brightness > shadow_fraction * np.median(image.brightness[image.valid]))
    whole = lit[: shape[0] * CELL, : shape[1] * CELL]
    return whole.reshape(shape[0], CELL, shape[1], CELL).mean((1, 3))
