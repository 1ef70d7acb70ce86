"""The cameras that all tiles share: one bundle adjustment of their tie points, and the tiles in its frame.

A tile's own estimate determines the relative poses of its views to some hundredths of a pixel, and its frame not at
all. The tie points of all tiles together determine all poses. A tile is then moved: its landmarks follow the smooth
difference between its tie points triangulated by the shared poses and by its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.adjust.bundle import bundle_adjusted, reprojection_px
from photoclinometry.body.sparse import KEYPOINT_SIGMA_PX, frame_priors
from photoclinometry.body.tile_map import TileMap
from photoclinometry.matching.triangulation import triangulate_tracks
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.geometry import Rigid, Similarity, align_similarity, unit
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import Tracks, Views
from photoclinometry.model.sparse import SparseModel
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.sparse_stages import PosedImages, views_from

TIE_SIGMA_PX = 0.3
"""Standard deviation of a tile's tie points in one view [px]. They share their error: together they weigh as one."""
FIRST_GATE_PX, GATE_PX = 20.0, 1.5
"""Tie points count if their keypoints agree within this [px], before and after the first adjustment."""
FEWEST_TIES = 12
"""Fewest tie points that determine the displacement of a tile: twice the number of its quadratic coefficients."""

OUTLIER = 3.0
"""Tie points that are off by more than this multiple of the median do not count for the displacement of a tile."""


@dataclass(frozen=True, kw_only=True)
class SharedCameras:
    """Poses of all views, and the residuals of tie points."""

    body_from_cam: Rigid
    """(K,) by the tie points of all tiles, the sparse points and the pose priors."""
    tile_px: np.ndarray
    """(T,) mean distance of each tile's keypoints from its tie points by these poses [px]; NaN where there are none."""


@dataclass(frozen=True, kw_only=True)
class ShareCameras(Stage[SharedCameras]):
    """One bundle adjustment of the tie points of all tiles and of the sparse points."""

    name = "cameras"
    result = SharedCameras
    tiles: tuple[Keyed[TileMap], ...]
    posed: PosedImages
    priors: Mapping[str, PosePrior]
    """By name of view."""

    def make(self, tools: Tools) -> SharedCameras:
        views, sparse = self.posed.views, self.posed.sparse.value
        tiles = [tile.value for tile in self.tiles]
        priors = frame_priors(self.priors, views, sparse)
        for gate in (FIRST_GATE_PX, GATE_PX, GATE_PX):
            model, tile = _with_ties(sparse, tiles, views, gate)
            found = bundle_adjusted(model, views, priors, _sigma_px(tile)[model.point_of_observation])
            views = views_from(self.posed.inputs.value.site, found)
        off = reprojection_px(found, views)
        of_tile = tile[found.point_of_observation]
        per_tile = np.array([off[of_tile == n].mean() if (of_tile == n).any() else np.nan for n in range(len(tiles))])
        say_found(f"{(tile >= 0).sum():,} tie points, {np.nanmean(per_tile):.2f} px")
        return SharedCameras(body_from_cam=found.body_from_cam, tile_px=per_tile)


def _sigma_px(tile: np.ndarray) -> np.ndarray:
    """(P,) standard deviations of keypoints [px]. tile: (P,) of each point, -1 for sparse ones."""
    number = np.bincount(tile + 1)[tile + 1]
    return np.where(tile < 0, KEYPOINT_SIGMA_PX, TIE_SIGMA_PX * np.sqrt(number))


def _with_ties(
    sparse: SparseModel, tiles: Sequence[TileMap], views: Views, gate_px: float
) -> tuple[SparseModel, np.ndarray]:
    """Sparse points and tie points as one model in the poses of `views`, and the tile (P,) of each, -1 for sparse ones.

    Points whose keypoints are off by more than `gate_px` in the root mean square are left out.
    """
    count = [np.diff(sparse.point_start), *(np.diff(tile.ties.start) for tile in tiles)]
    tile = np.repeat(np.arange(-1, len(tiles)), [len(c) for c in count])
    joined = replace(
        sparse,
        body_from_cam=views.body_from_cam,
        point_start=row_starts(np.concatenate(count)),
        point_view=np.concatenate([sparse.point_view, *(each.ties.view for each in tiles)]).astype(np.int32),
        point_xy=np.concatenate([sparse.point_xy, *(each.ties.keypoint for each in tiles)]),
    )
    points = _triangulated(joined.point_start, joined.point_view, joined.point_xy, views)
    there = np.all(np.isfinite(points), axis=-1)
    joined = replace(joined, points=np.where(there[:, None], points, 0.0))
    square = np.bincount(joined.point_of_observation, reprojection_px(joined, views) ** 2, len(points))
    kept = there & (square <= gate_px**2 * np.diff(joined.point_start))
    rows = kept[joined.point_of_observation]
    return replace(
        joined,
        points=points[kept],
        point_start=row_starts(np.diff(joined.point_start)[kept]),
        point_view=joined.point_view[rows],
        point_xy=joined.point_xy[rows],
    ), tile[kept]


def _triangulated(start: np.ndarray, view: np.ndarray, keypoint: np.ndarray, views: Views) -> np.ndarray:
    """(P, 3) points of compressed rows of keypoints; NaN where their rays do not fix one."""
    return triangulate_tracks(Tracks.of_keypoints(start, view, keypoint, 1.0), views)


def in_shared_frame(tile: TileMap, views: Views) -> TileMap:
    """The tile in the body's frame, moved as its tie points. views: (K,) all, with the shared poses.

    A similarity, and then a displacement that is a quadratic function of the place in the reference image. A tile with
    fewer than FEWEST_TIES tie points is left out.
    """
    ties, landmarks = tile.ties, tile.landmarks
    target = _triangulated(ties.start, ties.view, ties.keypoint, views)
    there = np.all(np.isfinite(target), axis=-1)
    if there.sum() < FEWEST_TIES:
        return tile.left_out(f"{there.sum()} tie points do not place it among the other tiles")
    source, target = landmarks.position[ties.landmark[there]], target[there]
    similarity = _robust_similarity(source, target)
    middle, size = landmarks.pixel.mean(0), float(np.ptp(landmarks.pixel, axis=0).max())
    at_ties, at_all = ((landmarks.pixel[rows] - middle) / size for rows in (ties.landmark[there], slice(None)))
    coefficients = _robust_fit(_quadratic(at_ties), target - similarity(source))
    position = similarity(landmarks.position)
    normal = landmarks.normal @ similarity.rotation.T
    moved = position + _quadratic(at_all) @ coefficients
    placed = replace(
        landmarks,
        position=moved,
        normal=_tilted(normal, at_all, position, coefficients),
        height_sigma=similarity.scale * landmarks.height_sigma,
    )
    return replace(tile, landmarks=placed, gsd=similarity.scale * tile.gsd)


def _robust_similarity(source: np.ndarray, target: np.ndarray) -> Similarity:
    """Least squares, once more without outliers."""
    found = align_similarity(source, target)
    near = _near(found(source) - target)
    return align_similarity(source[near], target[near])


def _quadratic(at: np.ndarray) -> np.ndarray:
    """(n, 6) of places (n, 2): 1, u, v, u^2, u v, v^2."""
    u, v = at.T
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], -1)


def _robust_fit(design: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(6, 3) coefficients of least squares, once more without outliers."""
    found = np.linalg.lstsq(design, value, rcond=None)[0]
    near = _near(design @ found - value)
    return np.linalg.lstsq(design[near], value[near], rcond=None)[0]


def _near(off: np.ndarray) -> np.ndarray:
    """(n,) bool: residuals (n, 3) that are no outliers."""
    distance = np.linalg.norm(off, axis=-1)
    return distance <= OUTLIER * np.median(distance)


def _tilted(normal: np.ndarray, at: np.ndarray, position: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Normals (n, 3) of a surface that is displaced by `_quadratic(at) @ coefficients`.

    The surface's tangents are those of the plane through all positions: the displacement is smooth and small.
    """
    tangent = np.linalg.lstsq(_quadratic(at)[:, :3], position, rcond=None)[0][1:]  # (2, 3) by u and v
    u, v = at.T
    zero, one = np.zeros_like(u), np.ones_like(u)
    by_u = np.stack([zero, one, zero, 2.0 * u, v, zero], -1) @ coefficients
    by_v = np.stack([zero, zero, one, zero, u, 2.0 * v], -1) @ coefficients
    rise = np.stack([np.sum(by_u * normal, -1), np.sum(by_v * normal, -1)], -1)
    return unit(normal - rise @ np.linalg.inv(tangent @ tangent.T) @ tangent)
