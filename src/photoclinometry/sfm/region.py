"""Which view is the reference, and which of its pixels become landmarks."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.geometry import unit
from photoclinometry.model.scene import Camera, Image, Region
from photoclinometry.model.sparse import SparseModel
from photoclinometry.photometry.initialize import normals_from_neighbours

log = logging.getLogger(__name__)

CELL = 16
"""Side [px] of the cells that a view is scored in."""


@dataclass(frozen=True, kw_only=True)
class RegionOptions:
    """Where the dense map is made, unless `site.toml` says."""

    size_px: tuple[int, int] = (400, 400)
    """Width and height of the region of the reference image [px]; less where the image is smaller."""
    stride: int = 1
    """A landmark at every so many pixels, down and across. Views are matched at every pixel all the same."""
    shadow_fraction: float = 0.15
    """A pixel darker than this times the median of its image's valid pixels counts as shadow."""

    def __post_init__(self):
        if self.stride < 1 or self.stride != int(self.stride):
            raise InputError(f"region.stride {self.stride}: give a positive whole number of pixels")


class Request(Protocol):
    """What the site asks for (`io.site.RegionRequest`); None where left to us."""

    @property
    def reference(self) -> str | None: ...
    @property
    def center_px(self) -> tuple[float, float] | None: ...
    @property
    def size_px(self) -> tuple[int, int] | None: ...
    @property
    def stride(self) -> int | None: ...


def choose_region(
    sparse: SparseModel,
    images: list[Image],
    cameras: list[Camera],
    sun_in_body: np.ndarray,
    request: Request | None = None,
    options: RegionOptions | None = None,
) -> tuple[int, Region]:
    """The reference view's index and the region of its image to map.

    What the request leaves open is chosen by score: each cell of a view is worth (`cell_scores`)

        detail * lit * mu * min(mu0 / 0.5, 1)

    how much of its detail the registered views see (`_detail_seen`), the share of its pixels that are valid and out of
    shadow, the cosine of emission, and the cosine of incidence (from 60 degrees on no longer a gain: oblique light
    shows relief). A region is worth the mean of its cells, less up to a fifth towards the
    image's corners; the best region of the best view is taken.
    sun_in_body: (K, 3). Raises InputError for a request that cannot be met.
    """
    options = options or RegionOptions()
    reference, region = _choose_rectangle(sparse, images, cameras, sun_in_body, request, options)
    stride = int(options.stride if request is None or request.stride is None else request.stride)
    if stride >= min(region.width, region.height):
        raise InputError(
            f"region.stride {stride} leaves a single row of landmarks of a region of {region.width} x {region.height} "
            "px; lessen it"
        )
    return reference, replace(region, stride=stride)


def _choose_rectangle(
    sparse: SparseModel,
    images: list[Image],
    cameras: list[Camera],
    sun_in_body: np.ndarray,
    request: Request | None,
    options: RegionOptions,
) -> tuple[int, Region]:
    names = [image.name for image in images]
    candidates = _candidates(sparse, names, request)
    best: tuple[float, int, Region] | None = None
    for view in candidates:
        width, height = _size(cameras[view], request, options)
        if request is not None and request.center_px is not None:
            region = region_around(request.center_px, (width, height), cameras[view], names[view])
            if len(candidates) == 1:
                return view, region
            at = region
        else:
            at = None
        scores = cell_scores(sparse, view, images[view], cameras, sun_in_body, options.shadow_fraction)
        score, region = _best_region(scores, (width, height), cameras[view], at)
        log.debug("%s: score %.3f, region %s", names[view], score, region)
        if best is None or score > best[0]:
            best = (score, view, region)
    if best is None or best[0] <= 0.0:
        raise ReconstructionError(
            "no region is lit and seen by several views; give [region] in site.toml, or images whose lit parts overlap"
        )
    log.info("reference %s, region %s (score %.2f)", names[best[1]], best[2], best[0])
    return best[1], best[2]


def region_around(center_px: tuple[float, float], size_px: tuple[int, int], camera: Camera, name: str) -> Region:
    """The region of a size (width, height) about a pixel position. Raises InputError where it leaves the image."""
    width, height = size_px
    col, row = round(center_px[0] - width / 2), round(center_px[1] - height / 2)
    region = Region(row=row, col=col, height=height, width=width)
    if row < 0 or col < 0 or row + height > camera.height or col + width > camera.width:
        raise InputError(
            f"region of {width} x {height} px about ({center_px[0]:g}, {center_px[1]:g}) reaches columns "
            f"{col}..{col + width} and rows {row}..{row + height}, outside of {name} "
            f"({camera.width} x {camera.height} px); move center_px or lessen size_px"
        )
    return region


def cell_scores(
    sparse: SparseModel,
    view: int,
    image: Image,
    cameras: list[Camera],
    sun_in_body: np.ndarray,
    shadow_fraction: float,
) -> np.ndarray:
    """(rows, cols) worth in [0, 1] of each whole cell of CELL x CELL pixels of a view, see `choose_region`.

    Detail and angles come from the 8 sparse points nearest to the cell; where those are far, the cell's
    worth falls off (a Gaussian of 6 cells), since no one knows what the other views see there.
    """
    from scipy.spatial import KDTree

    shape = image.brightness.shape[0] // CELL, image.brightness.shape[1] // CELL
    index, xy = sparse.seen_by(view)
    if len(index) < 32:
        return np.zeros(shape)
    centers = sparse.body_from_cam.translation
    points = sparse.points[index]
    normal = normals_from_neighbours(points, centers[sparse.registered], count=32)
    mu = np.sum(normal * unit(centers[view] - points), -1)
    mu0 = np.sum(normal * sun_in_body[view], -1)
    worth = _detail_seen(sparse, view, points, cameras) * mu.clip(0) * (mu0 / 0.5).clip(0, 1)

    row, col = np.indices(shape)
    cells = np.stack([col + 0.5, row + 0.5], -1).reshape(-1, 2) * CELL
    distance, near = KDTree(xy).query(cells, k=8)
    trust = np.exp(-0.5 * (np.median(distance, -1) / (6 * CELL)) ** 2)
    local = (trust * np.median(worth[near], -1)).reshape(shape)
    return local * _lit_share(image, shape, shadow_fraction)


def _detail_seen(sparse: SparseModel, view: int, points: np.ndarray, cameras: list[Camera]) -> np.ndarray:
    """(n,) how much of the detail of a map at a view's resolution the registered views see, at points (n, 3).

    The share of them that hold a point within their frame, where one of coarser pixels counts by the ratio of areas;
    times how fine the view is, the finest having 1.
    """
    views = np.flatnonzero(sparse.registered)
    depth, inside = np.empty((2, len(views), len(points)))
    for n, k in enumerate(views):
        local = sparse.body_from_cam[k].inverse()(points)
        depth[n] = local[:, 2]
        xy, size = cameras[k].pixel_from_cam(local), np.array([cameras[k].width, cameras[k].height])
        inside[n] = (depth[n] > 0) & np.all((xy > 0) & (xy < size), axis=-1)
    gsd = np.median(depth, axis=1) / np.array([np.mean(cameras[k].focal_px) for k in views])
    own = gsd[views == view]
    seen = np.minimum((own / gsd)[:, None] ** 2, 1.0) * inside
    return seen.mean(0) * np.min(gsd[gsd > 0]) / own


def _lit_share(image: Image, shape: tuple[int, int], shadow_fraction: float) -> np.ndarray:
    lit = image.valid & (image.brightness > shadow_fraction * np.median(image.brightness[image.valid]))
    whole = lit[: shape[0] * CELL, : shape[1] * CELL]
    return whole.reshape(shape[0], CELL, shape[1], CELL).mean((1, 3))


def _best_region(scores: np.ndarray, size: tuple[int, int], camera: Camera, at: Region | None) -> tuple[float, Region]:
    """The best placed region (or the one asked for) and its mean score."""
    width, height = size
    cells = max(1, round(height / CELL)), max(1, round(width / CELL))
    cells = min(cells[0], scores.shape[0]), min(cells[1], scores.shape[1])
    windows = np.lib.stride_tricks.sliding_window_view(scores, cells).mean((2, 3))
    row, col = np.indices(windows.shape) * CELL
    row, col = np.minimum(row, camera.height - height), np.minimum(col, camera.width - width)
    if at is not None:
        off = (row - at.row) ** 2 + (col - at.col) ** 2
        return float(windows.flat[np.argmin(off)]), at
    # Of about equal regions the one nearest to the middle: what lies around it helps matching, and other
    # views are least likely to cut it. A corner is worth a fifth less.
    off = np.hypot(row + height / 2 - camera.height / 2, col + width / 2 - camera.width / 2)
    off = off / np.hypot(camera.height / 2, camera.width / 2)
    windows = windows * (1.0 - 0.2 * off)
    pick = np.unravel_index(np.argmax(windows), windows.shape)
    region = Region(row=int(row[pick]), col=int(col[pick]), height=height, width=width)
    return float(windows[pick]), region


def _candidates(sparse: SparseModel, names: list[str], request: Request | None) -> list[int]:
    if request is None or request.reference is None:
        return np.flatnonzero(sparse.registered).tolist()
    if request.reference not in names:
        raise InputError(f"region.reference {request.reference!r} is not a view (views: {', '.join(names)})")
    view = names.index(request.reference)
    if not sparse.registered[view]:
        raise InputError(f"region.reference {request.reference!r} did not register; name another view or leave it out")
    return [view]


def _size(camera: Camera, request: Request | None, options: RegionOptions) -> tuple[int, int]:
    """(width, height); a requested size must fit, the default is cut to the image."""
    if request is None or request.size_px is None:
        return min(options.size_px[0], camera.width), min(options.size_px[1], camera.height)
    width, height = (int(v) for v in request.size_px)
    if not (2 <= width <= camera.width and 2 <= height <= camera.height):
        raise InputError(
            f"region.size_px {width} x {height} does not fit the image of {camera.width} x {camera.height} px"
        )
    return width, height
