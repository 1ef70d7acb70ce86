"""One closed surface from the landmarks of all tiles.

A screened Poisson surface goes through the landmarks with their normals, and through the coarse shape where no tile
has any. Its vertices then move along their normals to the mean of the landmarks around them, weighted by their
standard deviations, and take their normals, albedos and standard deviations from these.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from photoclinometry.body.cameras import SharedCameras, in_shared_frame
from photoclinometry.body.coarse_shape import ClosedMesh
from photoclinometry.body.overlap import FACING, albedo_factors, overlap_of, shared_images, sigma_factors
from photoclinometry.body.poisson import closed_surface
from photoclinometry.body.tile_map import TileMap
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import unit
from photoclinometry.model.warning import warn
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.sparse_stages import PosedImages
from photoclinometry.surface.closed_mesh import face_normals, vertex_normals

log = logging.getLogger(__name__)

NEAR_GSD = 1.5
"""Landmarks up to this far from a vertex determine it [GSD]."""
WIDTH_GSD, ALBEDO_WIDTH_GSD = 0.4, 0.6
"""Standard deviations of the Gaussians that weigh them by distance [GSD], for places and normals and for albedos. The
maps resolve 0.6 GSD, and wider Gaussians smooth them further; narrower ones leave noise of single landmarks, which is
larger in albedos (decision 0049 has the figures)."""
NEIGHBOURS = 24
"""Most landmarks that determine a vertex: two to three tiles have about as many in reach."""
FILL_GSD = 4.0
"""The coarse shape stands in where no landmark is nearer than this [GSD]."""
LEAST_WEIGHT = 1e-3
"""Least weight of a landmark, relative to one in its tile's middle that is seen from above: it counts where there is no
better one."""
UNTRUSTED = 1e-3
"""Weight of a tile that is not to be trusted, relative to others: it counts where there is no other."""
MAX_ALBEDO_SIGMA = 0.3
"""Albedos with a larger relative sigma, as of ground that is hardly lit, do not count: they may be any number."""
USUAL_SIGMA_GSD = 0.1
"""Standard deviation [GSD] of heights where a tile states none."""
BLOCK = 10_000
"""Vertices at a time: limits the memory to some tens of megabytes."""


@dataclass(frozen=True, kw_only=True)
class MergedSurface:
    """A closed mesh with quantities at its vertices; figures are NaN and `views` is 0 where nothing was mapped."""

    vertices: np.ndarray
    """(V, 3) in B."""
    faces: np.ndarray
    """(F, 3), counter-clockwise as seen from outside."""
    normals: np.ndarray
    """(V, 3) outward unit vectors: by photometry, and those of the faces where nothing was mapped."""
    albedo: np.ndarray
    """(V,)."""
    height_sigma: np.ndarray
    """(V,) along the normal [units of B]."""
    normal_sigma: np.ndarray
    """(V,) of the angle [rad]."""
    albedo_sigma: np.ndarray
    """(V,) as a share of the albedo."""
    views: np.ndarray
    """(V,) int."""
    tile: np.ndarray
    """(V,) int: the tile of most weight, -1 for none."""
    step: np.ndarray
    """(V,) standard deviation between tiles, of heights where several have landmarks [units of B]; NaN elsewhere."""
    gsd: float
    """Median ground sample distance of the tiles [units of B]."""
    albedo_factor: np.ndarray
    """(T,) divisors of the tiles' albedos, so that they agree where tiles overlap."""
    sigma_factor: np.ndarray
    """(3,) factors on the tiles' sigmas of height, normal and albedo, from the disagreement of overlapping tiles."""


@dataclass(frozen=True, kw_only=True)
class MergeTiles(Stage[MergedSurface]):
    """The closed surface."""

    name = "merge"
    result = MergedSurface
    tiles: tuple[Keyed[TileMap], ...]
    cameras: Keyed[SharedCameras]
    posed: PosedImages
    shape: Keyed[ClosedMesh]

    def make(self, tools: Tools) -> MergedSurface:
        views = replace(self.posed.views, body_from_cam=self.cameras.value.body_from_cam)
        tiles = [in_shared_frame(tile.value, views) for tile in self.tiles]
        for number, (before, after) in enumerate(zip(self.tiles, tiles, strict=True)):
            if after.failure and not before.value.failure:
                warn(log, "tile-unplaced", "tile %d is left out: %s", number, after.failure)
        if not any(len(tile.landmarks) for tile in tiles):
            raise ReconstructionError("no tile has enough tie points to be placed among the others")
        cloud = Cloud.of(tiles)
        points, normals = _with_coarse_shape(cloud, self.shape.value)
        vertices, faces = closed_surface(points, normals, cloud.gsd, tools.scratch)
        found = merged(cloud, vertices, faces)
        known = found.views > 0
        say_found(f"{len(faces):,} facets, {100 * known.mean():.1f} % of vertices mapped")
        return found


@dataclass(frozen=True)
class Cloud:
    """All landmarks of all tiles; one row each."""

    position: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    """Divided by their tile's factor; NaN where not known."""
    height_sigma: np.ndarray
    """Known of all, with weights by the place in the tile."""
    weight: np.ndarray
    """Weight of a landmark in a mean, before that by its distance."""
    sigmas: np.ndarray
    """(n, 3) standard deviations of height, normal and albedo: as stated, times `sigma_factor`."""
    views: np.ndarray
    tile: np.ndarray
    gsd: float
    factor: np.ndarray
    """(T,) of the tiles' albedos."""
    sigma_factor: np.ndarray
    """(3,) of the stated standard deviations."""
    correlation: np.ndarray
    """(T, T) of the tiles' errors."""

    @classmethod
    def of(cls, tiles: Sequence[TileMap]) -> Cloud:
        """The landmarks of tiles."""
        position = _joined(tiles, "position")
        number = np.repeat(np.arange(len(tiles)), [len(tile.landmarks) for tile in tiles])
        gsd = float(np.median([tile.gsd for tile in tiles if len(tile.landmarks)]))
        stated = np.stack([_joined(tiles, f"{name}_sigma") for name in ("height", "normal", "albedo")], -1)
        height_sigma = np.where(np.isnan(stated[:, 0]), USUAL_SIGMA_GSD * gsd, stated[:, 0])
        albedo, normal = np.concatenate([_known_albedo(tile) for tile in tiles]), _joined(tiles, "normal")
        overlap = overlap_of(position, normal, number, gsd)
        factor = albedo_factors(overlap, albedo, number, len(tiles))
        correlation = shared_images([np.unique(tile.ties.view) for tile in tiles])
        of_pairs = correlation[number[overlap.first], number[overlap.second]]
        sigma_factor = sigma_factors(overlap, position, normal, albedo / factor[number], stated, of_pairs)
        weight = np.maximum(_joined(tiles, "weight"), LEAST_WEIGHT)
        trusted = np.where([bool(tile.distrust) for tile in tiles], UNTRUSTED, 1.0)[number]
        return cls(
            position=position,
            normal=normal,
            albedo=albedo / factor[number],
            height_sigma=height_sigma,
            weight=trusted * weight * (gsd / height_sigma) ** 2,
            sigmas=stated * sigma_factor,
            views=_joined(tiles, "views"),
            tile=number,
            gsd=gsd,
            factor=factor,
            sigma_factor=sigma_factor,
            correlation=correlation,
        )


def merged(cloud: Cloud, vertices: np.ndarray, faces: np.ndarray) -> MergedSurface:
    """The closed mesh moved onto the landmarks, with their quantities."""
    from scipy.spatial import KDTree

    outward = vertex_normals(vertices, faces)
    tree, count = KDTree(cloud.position), len(vertices)
    vertices, normals = vertices.copy(), outward.copy()
    figures = np.full((count, 5), np.nan)
    views, tile = np.zeros(count, int), np.full(count, -1)
    for rows in _blocks(count):
        mean = _means(cloud, tree, vertices[rows], outward[rows])
        known = mean.known
        at = np.arange(count)[rows][known]
        vertices[at] += mean.height[known, None] * outward[at]
        normals[at] = unit(mean.normal[known])
        figures[at] = mean.figures[known]
        views[at], tile[at] = mean.views[known], mean.tile[known]
    return MergedSurface(
        vertices=vertices,
        faces=faces,
        normals=normals,
        albedo=figures[:, 0],
        height_sigma=figures[:, 1],
        normal_sigma=figures[:, 2],
        albedo_sigma=figures[:, 3],
        views=views,
        tile=tile,
        step=figures[:, 4],
        gsd=cloud.gsd,
        albedo_factor=cloud.factor,
        sigma_factor=cloud.sigma_factor,
    )


@dataclass(frozen=True)
class _Means:
    """Of the landmarks around m vertices."""

    known: np.ndarray
    height: np.ndarray
    """(m,) from the vertex to the landmarks' surface, along its normal."""
    normal: np.ndarray
    figures: np.ndarray
    """(m, 5) albedo, the three sigmas, and the standard deviation of heights between tiles."""
    views: np.ndarray
    tile: np.ndarray


def _means(cloud: Cloud, tree: Any, at: np.ndarray, outward: np.ndarray) -> _Means:
    """Weighted means of the landmarks around vertices at (m, 3) with normals outward (m, 3); tree: of the landmarks.

    Landmarks count that are nearer than NEAR_GSD and face as the vertex does. Without any, `known` is False.
    """
    reach = NEAR_GSD * cloud.gsd
    distance, near = tree.query(at, NEIGHBOURS, distance_upper_bound=reach)
    there = np.isfinite(distance)
    near = np.where(there, near, 0)
    facing = np.einsum("mkd,md->mk", cloud.normal[near], outward)
    there &= facing > FACING
    off = cloud.position[near] - at[:, None]
    # Sideways distance alone counts: a vertex may begin somewhat off the surface.
    up = np.einsum("mkd,md->mk", off, outward)
    sideways = np.sqrt(np.maximum(np.sum(off**2, -1) - up**2, 0.0))
    share, of_albedo = (
        _shares(there * cloud.weight[near] * np.exp(-0.5 * (sideways / (width * cloud.gsd)) ** 2))
        for width in (WIDTH_GSD, ALBEDO_WIDTH_GSD)
    )
    known = np.any(share > 0, axis=1)
    # Between a landmark and the vertex the surface follows the mean of the normals at both (the trapezoidal rule).
    normal = np.einsum("mk,mkd->md", share, cloud.normal[near])
    between = cloud.normal[near] + unit(np.where(known[:, None], normal, outward))[:, None]
    rise = np.einsum("mkd,md->mk", between, outward)
    height = np.einsum("mkd,mkd->mk", off, between) / np.where(there, rise, 1.0)
    mean = np.sum(share * height, 1)
    scatter, tile = _by_tile(cloud, near, share, height, mean)
    albedo, sigmas = _mean_albedo(cloud.albedo[near], of_albedo), _sigmas(cloud, near, (share, share, of_albedo))
    return _Means(
        known=known,
        height=mean,
        normal=normal,
        figures=np.column_stack([albedo, sigmas, scatter]),
        views=np.max(np.where(there, cloud.views[near], 0), axis=1),
        tile=tile,
    )


def _shares(weight: np.ndarray) -> np.ndarray:
    """(m, k) weights over their sums; 0 where all are."""
    total = weight.sum(1, keepdims=True)
    return weight / np.where(total > 0, total, 1.0)


def _mean_albedo(albedo: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(m,) means of albedos (m, k) that are known, NaN without any."""
    counted = np.where(np.isfinite(albedo), share, 0.0)
    total = counted.sum(1)
    return np.sum(counted * np.nan_to_num(albedo), 1) / np.where(total > 0, total, np.nan)


def _known_albedo(tile: TileMap) -> np.ndarray:
    """(n,) albedos of a tile, NaN where its images do not determine them."""
    albedo, sigma = tile.landmarks.albedo, tile.landmarks.albedo_sigma
    if not np.isfinite(sigma).any():  # it states none
        return albedo
    return np.where((sigma >= 0) & (sigma <= MAX_ALBEDO_SIGMA), albedo, np.nan)


def _sigmas(cloud: Cloud, near: np.ndarray, shares: tuple[np.ndarray, ...]) -> np.ndarray:
    """(m, 3) standard deviations of means of landmarks (m, k); shares: (m, k) in heights, normals and albedos.

    Errors of neighbours in one tile are assumed to be common, those of two tiles to be correlated by their common
    images. Landmarks of unknown or infinite sigma are left out.
    """
    correlation = cloud.correlation[cloud.tile[near][:, :, None], cloud.tile[near][:, None, :]]
    found = []
    for column, share in enumerate(shares):
        stated = cloud.sigmas[near, column]
        counted = np.where(np.isfinite(stated), share, 0.0)
        part = counted * np.where(counted > 0, stated, 0.0)
        total = counted.sum(1)
        variance = np.einsum("mk,mkl,ml->m", part, correlation, part)
        found.append(np.sqrt(variance) / np.where(total > 0, total, np.nan))
    return np.stack(found, -1)


def _by_tile(
    cloud: Cloud, near: np.ndarray, share: np.ndarray, height: np.ndarray, mean: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The scatter (m,) of tiles' heights, and the tile (m,) of most weight."""
    tile = cloud.tile[near]
    same = (tile[:, :, None] == tile[:, None, :]) & (share[:, :, None] > 0) & (share[:, None, :] > 0)
    of_tile = np.einsum("mkl,ml->mk", same, share)
    first = ~np.tril(same, -1).any(2) & (share > 0)  # one row stands for each tile
    of_heights = np.einsum("mkl,ml->mk", same, share * height) / np.where(of_tile > 0, of_tile, 1.0)
    variance = np.sum(first * of_tile * (of_heights - mean[:, None]) ** 2, 1)
    several = first.sum(1) > 1
    most = np.argmax(np.where(first, of_tile, -1.0), axis=1)
    return np.where(several, np.sqrt(variance), np.nan), np.take_along_axis(tile, most[:, None], 1)[:, 0]


def _with_coarse_shape(cloud: Cloud, shape: ClosedMesh) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and normals (n, 3): the landmarks, and middles of the coarse shape's faces far from any."""
    from scipy.spatial import KDTree

    middle = shape.vertices[shape.faces].mean(1)
    normal = face_normals(shape.vertices, shape.faces)
    far = (KDTree(cloud.position).query(middle)[0] > FILL_GSD * cloud.gsd) & normal.any(-1)
    return np.concatenate([cloud.position, middle[far]]), np.concatenate([cloud.normal, normal[far]])


def _joined(tiles: Sequence[TileMap], name: str) -> np.ndarray:
    return np.concatenate([getattr(tile.landmarks, name) for tile in tiles])


def _blocks(count: int) -> Iterator[slice]:
    return (slice(first, min(first + BLOCK, count)) for first in range(0, count, BLOCK))
