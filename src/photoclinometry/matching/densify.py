"""Dense matches and poses -> landmarks with tracks: one landmark per reference pixel that enough views see."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from photoclinometry.matching.epipolar import fundamental_matrix, sampson_error
from photoclinometry.matching.interface import Matches
from photoclinometry.matching.triangulation import Limits, PinholeCameras, triangulate_all
from photoclinometry.model.camera import Camera
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.region import Region

log = logging.getLogger(__name__)

BLOCK = 2**21
"""Observations that are triangulated at a time, in whole rows of the map's grid: limits the memory to 100 MB."""

FEW_VIEWS = 3
"""In two views a wrong match along the epipolar line cannot be noticed."""

MANY_VIEWS = 6
"""Required views of a landmark where there are enough: one wrong match among them is outvoted."""


@dataclass(frozen=True, kw_only=True)
class DensifyOptions(Ranged):
    """Landmarks from dense matches."""

    min_views: Annotated[int | None, Range(least=2, most=1_000_000)] = None
    """A landmark is observed in at least this many views, the reference included; left out, in half of the views that
    take part, 3 at least and 6 at most."""
    max_sampson_px2: Annotated[float, Range(above=0)] = 1.0
    """Greatest squared Sampson distance of a match to the epipolar geometry of the sparse poses [px^2]."""
    max_reprojection_px: Annotated[float, Range(above=0)] = 3.0
    """Observations farther from the triangulated point are dropped [px]."""
    min_triangulation_deg: Annotated[float, Range(least=0, below=90)] = 1.0
    """The reference's ray and one other at least must meet at this angle."""
    min_certainty: Annotated[float, Range(least=0, most=1)] = 0.05
    """Matches of less certainty are not used."""
    reference_sigma_px: Annotated[float, Range(above=0)] = 0.1
    """Standard deviation of the reference's own keypoint, the pixel centre that defines the landmark [px]."""

    def views_needed(self, views: int) -> int:
        """Fewest of `views` views in which a landmark is observed."""
        return min(max(math.ceil(views / 2), FEW_VIEWS), MANY_VIEWS) if self.min_views is None else self.min_views


@dataclass(frozen=True, kw_only=True)
class DenseTracks:
    """J landmarks, row by row of the region, and their N observations (compressed rows)."""

    position: np.ndarray
    """(J, 3) in B."""
    pixel: np.ndarray
    """(J, 2) int32 (row, col) of the reference image."""
    start: np.ndarray
    """(J + 1,) int64."""
    view: np.ndarray
    """(N,) int32, ascending within a landmark; the reference is among them."""
    keypoint: np.ndarray
    """(N, 2) float64 [px]."""
    keypoint_sigma: np.ndarray
    """(N,) float64 [px]."""


@dataclass(frozen=True)
class _MatchedViews:
    """The V views that take part, the reference among them, and their matches over the whole region."""

    index: np.ndarray
    """(V,) int32 of all K views, ascending."""
    reference: int
    """Of all K views."""
    matches: dict[int, Matches]
    """By index of all K views, without the reference."""
    cameras: tuple[Camera, ...] | list[Camera]
    """Of all K views."""
    body_from_cam: Rigid
    """(K,)."""

    def pinholes(self) -> PinholeCameras:
        pose = self.body_from_cam[self.index]
        intrinsics = [self.cameras[k].intrinsics for k in self.index]
        return PinholeCameras(np.ascontiguousarray(pose.rotation), pose.translation, np.array(intrinsics, float))

    def fundamental(self, view: int) -> np.ndarray:
        """(3, 3) from the reference to one of all K views."""
        a, b = self.reference, view
        return fundamental_matrix(self.cameras[a], self.body_from_cam[a], self.cameras[b], self.body_from_cam[b])


def densify(
    region: Region,
    reference: int,
    matches: dict[int, Matches],
    cameras: tuple[Camera, ...] | list[Camera],
    body_from_cam: Rigid,
    options: DensifyOptions | None = None,
) -> DenseTracks:
    """Triangulate every pixel of the map's grid that enough views agree on (`DensifyOptions.views_needed`).

    matches: by view index, over `region`; the reference itself is not in it. cameras, body_from_cam: all K views.
    A match must be valid, certain enough and near its epipolar line. The point is the linear least-squares
    solution of all its projections (`triangulate`), computed again without observations of gross error.
    Raises ReconstructionError where no pixel qualifies.
    """
    options = options or DensifyOptions()
    index = np.array(sorted([*matches, reference]), np.int32)
    views = _MatchedViews(index, reference, matches, cameras, body_from_cam)
    rows, cols = region.grid_shape
    parts, first = [], 0
    for part in region.row_blocks(max(1, BLOCK // (cols * len(index)))):
        last = first + part.grid_shape[0]
        parts.append(_densify_rows(part, slice(first, last), views, options))
        first = last
    # One field at a time is merged, and its parts are freed before the next, to save memory.
    merged = {name: np.concatenate([part.pop(name) for part in parts]) for name in tuple(parts[0])}
    landmarks, observations = len(merged["count"]), len(merged["view"])
    if not landmarks:
        raise ReconstructionError(_unmatched(len(index), options))
    log.info("%d landmarks from %d pixels, %.1f views each", landmarks, rows * cols, observations / landmarks)
    return DenseTracks(start=row_starts(merged.pop("count")), **merged)


def _unmatched(views: int, options: DensifyOptions) -> str:
    needed = options.views_needed(views)
    few = f"ask for fewer views of a landmark (--densify.min-views {FEW_VIEWS}, or --preset few-views), or "
    return (
        f"no pixel of the region was matched in {needed} views or more (there are {views}); "
        f"{few if needed > FEW_VIEWS else ''}choose a region that more views see "
        "([region] in site.toml), or add views of like light"
    )


def _densify_rows(part: Region, rows: slice, views: _MatchedViews, options: DensifyOptions) -> dict[str, np.ndarray]:
    """`DenseTracks` of a part of the region, with each landmark's `count` of observations instead of `start`.

    rows: the part's rows of the whole map's grid, over which the matches are.
    """
    xy, sigma, used = _observations(part, rows, views, options)
    reference = int(np.flatnonzero(views.index == views.reference)[0])
    needed = options.views_needed(len(views.index))
    limits = Limits(needed, options.max_reprojection_px, math.radians(options.min_triangulation_deg))
    position, kept = np.zeros((len(xy), 3)), np.zeros(len(xy), bool)
    triangulate_all(xy, sigma, used, views.pinholes(), reference, limits, position, kept)
    landmark, column = np.nonzero(used & kept[:, None])
    row, col = np.divmod(np.flatnonzero(kept), part.grid_shape[1])
    row, col = part.row + part.stride * row, part.col + part.stride * col
    return {
        "position": position[kept],
        "pixel": np.stack([row, col], -1).astype(np.int32),
        "count": used[kept].sum(1),
        "view": views.index[column],
        "keypoint": xy[landmark, column],
        "keypoint_sigma": sigma[landmark, column],
    }


def _observations(
    part: Region, rows: slice, views: _MatchedViews, options: DensifyOptions
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (P, V, 2), sigmas (P, V) [px] and use (P, V) bool of a part of the region in all V views."""
    center = part.pixel_centers()[part.grid_slices]
    shape = (center.shape[0] * center.shape[1], len(views.index))
    xy, sigma, used = np.zeros((*shape, 2)), np.ones(shape), np.zeros(shape, bool)
    for column, view in enumerate(views.index.tolist()):
        if view == views.reference:
            xy[:, column] = center.reshape(-1, 2)
            sigma[:, column], used[:, column] = options.reference_sigma_px, True
            continue
        match = views.matches[view]
        position = match.position[rows]
        near = sampson_error(views.fundamental(view), center, position) < options.max_sampson_px2
        use = match.valid[rows] & near & (match.certainty[rows] >= options.min_certainty)
        xy[:, column] = position.reshape(-1, 2)
        sigma[:, column] = match.sigma_px[rows].ravel()
        used[:, column] = use.ravel()
    return xy, sigma, used
