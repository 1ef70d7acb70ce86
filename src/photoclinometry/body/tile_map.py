"""What a body takes from the map of a tile."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from photoclinometry.model.geometry import unit
from photoclinometry.model.projection import projected_keypoints
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Scene

TIE_STEP_PX = 8
"""Spacing of a tile's tie points for the cameras that tiles share, down and across [px]."""


@dataclass(frozen=True, kw_only=True)
class TileTiePoints:
    """Some landmarks of a tile with their keypoints (compressed rows), by which all tiles share their cameras."""

    landmark: np.ndarray
    """(m,) int: which of the tile's."""
    start: np.ndarray
    """(m + 1,) int64."""
    view: np.ndarray
    """(N,) int32, of all views of the body."""
    keypoint: np.ndarray
    """(N, 2) projections of the landmarks by the tile's own poses [px]."""

    @classmethod
    def none(cls) -> TileTiePoints:
        """No points."""
        return cls(
            landmark=np.empty(0, int),
            start=np.zeros(1, np.int64),
            view=np.empty(0, np.int32),
            keypoint=np.empty((0, 2)),
        )


@dataclass(frozen=True, kw_only=True)
class TileLandmarks:
    """The n landmarks of a tile, in a frame B of the tile's own or in the body's."""

    position: np.ndarray
    """(n, 3)."""
    normal: np.ndarray
    """(n, 3)."""
    albedo: np.ndarray
    """(n,)."""
    height_sigma: np.ndarray
    """(n,) along the normal [units of B]; like the other two infinite where the images do not determine it, and NaN
    where the map states none."""
    normal_sigma: np.ndarray
    """(n,) of the angle [rad]."""
    albedo_sigma: np.ndarray
    """(n,) as a share of the albedo."""
    views: np.ndarray
    """(n,) int: number of images."""
    weight: np.ndarray
    """(n,) weight of a landmark relative to those of other tiles, apart from its sigma: from 0 at the tile's edge to 1
    in its middle, times the squared cosine of emission. Maps are worse at their edges, and where the reference sees the
    ground obliquely: errors of slopes grow from 5 degrees at 40 degrees of emission to 15 at 75, twice as fast as
    stated."""
    pixel: np.ndarray
    """(n, 2) row and column in the reference image."""

    @classmethod
    def none(cls) -> TileLandmarks:
        """No landmarks."""
        vectors, numbers = np.empty((0, 3)), np.empty(0)
        return cls(
            position=vectors,
            normal=vectors,
            albedo=numbers,
            height_sigma=numbers,
            normal_sigma=numbers,
            albedo_sigma=numbers,
            views=np.empty(0, int),
            weight=numbers,
            pixel=np.empty((0, 2), np.int32),
        )

    def __len__(self) -> int:
        return len(self.views)

    def __getitem__(self, rows: Any) -> TileLandmarks:
        """Some of them, by a slice, indices or a mask."""
        return TileLandmarks(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})


@dataclass(frozen=True, kw_only=True)
class TileMap:
    """What the body takes from a tile."""

    landmarks: TileLandmarks
    ties: TileTiePoints
    gsd: float
    """[units of B]."""
    reflectance: Reflectance | None = None
    """As determined from the tile's images."""
    distrust: tuple[str, ...] = ()
    """Reason why the tile is not to be trusted; empty where it is."""
    failure: str = ""
    """Reason why there is no map; there are no landmarks then."""

    def left_out(self, why: str) -> TileMap:
        """Without its landmarks."""
        return replace(self, landmarks=self.landmarks[:0], failure=self.failure or why)


def tile_map(scene: Scene, number: np.ndarray, distrust: tuple[str, ...]) -> TileMap:
    """What the body takes from a tile's scene. number: (K,) what the scene's views are among all of the body."""
    landmarks, stated = scene.landmarks, scene.uncertainty
    row, col = landmarks.pixel.T
    edge = np.minimum(
        np.minimum(row - scene.region.row, scene.region.row + scene.region.height - 1 - row),
        np.minimum(col - scene.region.col, scene.region.col + scene.region.width - 1 - col),
    )
    towards = unit(scene.views.body_from_cam.translation[scene.reference] - landmarks.position)
    facing = np.maximum(np.sum(towards * landmarks.normal, -1), 0.0)
    unknown = np.full(len(landmarks), np.nan)
    along = np.einsum("ni,nij,nj->n", landmarks.normal, stated["position"], landmarks.normal) if stated else unknown
    normal = np.trace(stated["normal"], axis1=1, axis2=2) if "normal" in stated else unknown
    albedo = stated.get("albedo_relative", unknown)
    mapped = TileLandmarks(
        position=landmarks.position,
        normal=landmarks.normal,
        albedo=landmarks.albedo,
        height_sigma=_root(along),
        normal_sigma=_root(normal),
        albedo_sigma=albedo / landmarks.albedo,
        views=np.diff(scene.tracks.start),
        weight=np.clip(2.0 * (edge + 1) / min(scene.region.width, scene.region.height), 0.0, 1.0) * facing**2,
        pixel=landmarks.pixel,
    )
    return TileMap(
        landmarks=mapped,
        ties=_ties(scene, number),
        gsd=scene.gsd,
        reflectance=scene.reflectance,
        distrust=distrust,
    )


def _ties(scene: Scene, number: np.ndarray) -> TileTiePoints:
    step = max(1, TIE_STEP_PX // scene.region.stride)
    row, col = scene.cells
    chosen = np.flatnonzero((row % step == step // 2) & (col % step == step // 2))
    tracks, picked = scene.tracks.of_landmarks(chosen)
    keypoint = projected_keypoints(scene)[picked]
    return TileTiePoints(
        landmark=chosen, start=tracks.start, view=number[tracks.view].astype(np.int32), keypoint=keypoint
    )


def _root(variance: np.ndarray) -> np.ndarray:
    """Square roots; NaN of what is not known, or negative by rounding."""
    return np.sqrt(np.where(variance >= 0, variance, np.nan))
