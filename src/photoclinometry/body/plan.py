"""The plan of a body's map: overlapping tiles that cover the visible ground, each a region of one image, and its
views."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from photoclinometry.body.coarse_shape import ClosedMesh
from photoclinometry.body.options import TilePlanOptions
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Views
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, say_found
from photoclinometry.pipeline.sparse_stages import PosedImages
from photoclinometry.registration.view_choice import most_diverse
from photoclinometry.registration.viewing import differences
from photoclinometry.surface.closed_mesh import area_vectors
from photoclinometry.surface.mesh_rays import MeshRays, SeenByView, sight_of_views

STEPS = 8
"""Number of steps per tile's width at which tiles may begin: finer steps hardly cover more."""
COARSER = 1.5
"""Largest ratio of the resolution at which ground is mapped to the one that enough views have."""
LEAST_COSINE = 0.05
"""Least cosine of emission in the resolution of ground that is seen obliquely."""
FINER, COARSEST = 0.4, 2.2
"""Bounds of the resolution of a tile's views over that of its reference: beyond them images show other detail."""
SEEN_SHARE = 0.35
"""Least share of a tile that its views see."""
TILE_S, OBSERVATION_S = 8.0, 1.5e-4
"""CPU seconds of a tile, and in addition of each of its observations, on a core of 2024."""
PROCESS_GB, OBSERVATION_GB = 0.5, 5e-7
"""Memory of a process [GB], and in addition of each observation."""
FARTHEST_DEG, FARTHEST_SUN_DEG = 60.0, 75.0
"""Largest angles of a tile's views from its reference, between lines of sight and between Suns. Views that are farther
away are matched wrongly more often than not, and are used only where there are no others."""
LEAST_GAIN = 0.04
"""Least share of its own area that a further tile must add."""


@dataclass(frozen=True, kw_only=True)
class Tile:
    """A region of one image, and the views that it is mapped from."""

    reference: int
    """Of all views."""
    region: Region
    views: np.ndarray
    """(n,) int, ascending, of all views; the reference is among them."""
    gsd: float
    """Of the reference there [units of B]."""
    area: float
    """Area of the ground that it is to map [square units of B]."""
    new_area: float
    """Part of that area that no tile before it maps."""


@dataclass(frozen=True, kw_only=True)
class TilePlan:
    """All tiles, and the share of the body that they map."""

    tiles: tuple[Tile, ...]
    area: dict[str, float]
    """Shares of the body's surface: "seen" by `min_views` lit, of these "planned", "dark" (seen so often, but not lit),
    and "unseen"."""
    views_of_face: np.ndarray
    """(F,) int: number of views in which each face of the coarse shape is well seen and lit."""
    tile_of_face: np.ndarray
    """(F,) int: the first tile that maps it; -1 for none."""


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Estimated cost of a plan."""

    landmarks: int
    cpu_s: float
    memory_gb: float
    """Of each worker, at most."""


def cost_of(plan: TilePlan, stride: int = 1) -> Cost:
    """Estimated cost of a plan, from that of maps of 4,000 to 160,000 landmarks in 10 to 29 views.

    stride: spacing of landmarks, down and across [px].
    """
    landmarks = [math.prod(replace(tile.region, stride=stride).grid_shape) for tile in plan.tiles]
    observations = [count * len(tile.views) for count, tile in zip(landmarks, plan.tiles, strict=True)]
    return Cost(
        landmarks=sum(landmarks),
        cpu_s=sum(TILE_S + OBSERVATION_S * each for each in observations),
        memory_gb=PROCESS_GB + OBSERVATION_GB * max(observations, default=0),
    )


@dataclass(frozen=True, kw_only=True)
class PlanTiles(Stage[TilePlan]):
    """The tiles, from the coarse shape and the poses."""

    name = "plan"
    result = TilePlan
    posed: PosedImages
    shape: Keyed[ClosedMesh]
    options: TilePlanOptions

    def make(self, tools: Tools) -> TilePlan:
        registered = np.flatnonzero(self.posed.sparse.value.registered)
        plan = planned(self.shape.value, self.posed.views[registered], registered, self.options)
        if not plan.tiles:
            raise ReconstructionError(
                f"no ground is seen lit in {self.options.min_views} views below {self.options.max_emission_deg:g} "
                "degrees of emission; lower --plan.min-views, or give more images"
            )
        pixels = sum(tile.region.width * tile.region.height for tile in plan.tiles)
        say_found(f"{len(plan.tiles)} tiles, {pixels:,} px, {100 * plan.area['planned']:.1f} % of the surface")
        return plan


@dataclass(frozen=True)
class _Sights:
    """Visibility of the faces of the coarse shape in the views."""

    pixel: np.ndarray
    """(K, F, 2)."""
    usable: np.ndarray
    """(K, F) bool: seen and lit within the limits."""
    gsd: np.ndarray
    """(K, F)."""
    resolution: np.ndarray
    """(K, F) ground sample distance along the line of sight's trace: oblique ground is foreshortened."""
    seen: np.ndarray
    """(F,) int: number of views that see it, lit or not."""
    area: np.ndarray
    """(F,)."""


def planned(shape: ClosedMesh, views: Views, number: np.ndarray, options: TilePlanOptions) -> TilePlan:
    """Tiles one after another, each where it covers most of what no other covers yet.

    views: (K,) registered ones; number: (K,) their indices among all.
    """
    sights = _sights(shape, views, options)
    often = sights.usable.sum(0)
    wanted = often >= options.min_views
    finest = _resolution_of(sights, options.min_views)
    fine = sights.usable & (sights.resolution <= COARSER * finest)
    tiles, owner = [], np.full(len(wanted), -1)
    left = wanted.copy()
    while left.any():
        found = _best_region(sights, fine, left, views, options)
        if found is None:
            break
        k, region, mapped = found
        chosen = _views_of(sights, views, k, mapped, options)
        new = mapped & left
        left &= ~mapped
        if len(chosen) < options.min_views:
            continue
        owner[new] = len(tiles)
        tiles.append(
            Tile(
                reference=int(number[k]),
                region=region,
                views=number[chosen],
                gsd=float(np.median(sights.gsd[k, mapped])),
                area=float(sights.area[mapped].sum()),
                new_area=float(sights.area[new].sum()),
            )
        )
    share = sights.area / sights.area.sum()
    dark = ~wanted & (sights.seen >= options.min_views)
    area = {
        "seen": float(share[wanted].sum()),
        "planned": float(share[owner >= 0].sum()),
        "dark": float(share[dark].sum()),
        "unseen": float(share[~wanted & ~dark].sum()),
    }
    return TilePlan(tiles=tuple(tiles), area=area, views_of_face=often, tile_of_face=owner)


def _sights(shape: ClosedMesh, views: Views, options: TilePlanOptions) -> _Sights:
    corner = shape.vertices[shape.faces]
    area = area_vectors(shape.vertices, shape.faces)
    rays = MeshRays(shape.vertices, shape.faces, shape.spacing)
    faces = np.arange(len(shape.faces))
    found = list(sight_of_views(rays, views, faces, corner.mean(1), rays.facet_normals))
    return _Sights(
        pixel=np.array([view.pixel for view in found]),
        usable=np.array([_usable(view, options) for view in found]),
        gsd=np.array([view.gsd for view in found]),
        resolution=np.array([view.gsd / np.maximum(np.cos(view.emission), LEAST_COSINE) for view in found]),
        seen=np.sum([view.seen for view in found], axis=0),
        area=np.linalg.norm(area, axis=-1),
    )


def _usable(view: SeenByView, options: TilePlanOptions) -> np.ndarray:
    low = view.emission <= np.radians(options.max_emission_deg)
    return view.seen & view.lit & low & (view.incidence <= np.radians(options.max_incidence_deg))


def _resolution_of(sights: _Sights, enough: int) -> np.ndarray:
    """(F,) the finest resolution that `enough` views have; the coarsest where there are fewer views."""
    sorted_ones = np.sort(np.where(sights.usable, sights.resolution, np.inf), axis=0)
    counted = np.clip(sights.usable.sum(0), 1, min(enough, len(sorted_ones))) - 1
    return np.take_along_axis(sorted_ones, counted[None], 0)[0]


def _best_region(
    sights: _Sights, fine: np.ndarray, left: np.ndarray, views: Views, options: TilePlanOptions
) -> tuple[int, Region, np.ndarray] | None:
    """View, region, and the faces (F,) bool that it maps inside its margins: most of the area that is left."""
    best, most = None, 0.0
    for k, camera in enumerate(views.cameras):
        size = min(options.tile_px, camera.width, camera.height)
        step = max(1, size // STEPS)
        margin = int(options.overlap * size)
        whole = Region.of_image(camera.height, camera.width)
        own = np.flatnonzero(fine[k] & left & _inside(sights.pixel[k], whole, margin))
        if not len(own):
            continue
        col, row = (sights.pixel[k, own] / step).astype(int).T
        shape = (camera.height // step + 1, camera.width // step + 1)
        area = np.bincount(row * shape[1] + col, sights.area[own], shape[0] * shape[1]).reshape(shape)
        window = max(1, (size - 2 * margin) // step)
        window = min(window, *shape)
        sums = np.lib.stride_tricks.sliding_window_view(area, (window, window)).sum((2, 3))
        first = np.unravel_index(np.argmax(sums), sums.shape)
        if sums[first] > most:
            most = float(sums[first])
            top = int(np.clip(first[0] * step - margin, 0, camera.height - size))
            side = int(np.clip(first[1] * step - margin, 0, camera.width - size))
            best = k, Region(row=top, col=side, height=size, width=size), margin
    if best is None:
        return None
    k, region, margin = best
    mapped = fine[k] & _inside(sights.pixel[k], region, margin)
    gained = sights.area[mapped & left].sum()
    full = (region.width * np.median(sights.gsd[k, mapped])) ** 2 if mapped.any() else np.inf
    return (k, region, mapped) if gained >= LEAST_GAIN * full else None


def _inside(pixel: np.ndarray, region: Region, margin: int) -> np.ndarray:
    """(F,) bool: pixels (F, 2) in the region less its margins."""
    low = np.array([region.col, region.row]) + margin
    high = np.array([region.col + region.width, region.row + region.height]) - margin
    return np.all((pixel >= low) & (pixel <= high), axis=-1)


def _views_of(
    sights: _Sights, views: Views, reference: int, mapped: np.ndarray, options: TilePlanOptions
) -> np.ndarray:
    """(n,) ascending: the reference and those that see enough of a tile, most different in light and line of sight."""
    area = sights.area[mapped]
    share = (sights.usable[:, mapped] * area).sum(1) / area.sum()
    gsd = np.array([np.median(row) for row in sights.gsd[:, mapped]])
    ratio = gsd / gsd[reference]
    towards, suns = unit(views.body_from_cam.translation), views.sun
    from_camera, from_sun = angle_between(towards, towards[reference]), angle_between(suns, suns[reference])
    fits = (share >= SEEN_SHARE) & (ratio >= FINER) & (ratio <= COARSEST)
    fits[reference] = True
    near = fits & (from_camera <= np.radians(FARTHEST_DEG)) & (from_sun <= np.radians(FARTHEST_SUN_DEG))
    kept = max(near.sum(), min(fits.sum(), options.min_views))
    # The nearest ones are matched safely, and hold the others.
    order = np.lexsort((np.hypot(from_camera, from_sun), ~near, ~fits))[:kept]
    first, rest = np.split(order, [1 + options.max_views // 2])
    apart = differences(suns[order], towards[order])
    chosen = most_diverse(apart, np.arange(len(first)), options.max_views) if len(rest) else np.arange(len(order))
    return np.sort(order[chosen])
