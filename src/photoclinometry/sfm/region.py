"""The choice of the reference view, and of the region of its image to map."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple, Protocol

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.image import Image
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.region import Region
from photoclinometry.model.sparse import SparseModel
from photoclinometry.photometry.sampled_brightness import SHADOW_SHARE
from photoclinometry.sfm.region_score import CELL, cell_scores

log = logging.getLogger(__name__)

CORNER_LOSS = 0.2
"""Share of its score that a region loses in the image's corner; the loss decreases towards the middle. Matching needs
the ground around a region, and other views are least likely to cut off the middle."""


@dataclass(frozen=True, kw_only=True)
class RegionOptions(Ranged):
    """The region of the dense map, where `site.toml` leaves it open."""

    size_px: Annotated[tuple[int, int], Range(least=2, most=65535)] = (400, 400)
    """Width and height of the region of the reference image [px]; less where the image is smaller."""
    stride: Annotated[int, Range(least=1, most=65535)] = 1
    """Spacing of landmarks, down and across [px]. Views are matched at every pixel in any case."""
    shadow_fraction: Annotated[float, Range(least=0, below=1)] = SHADOW_SHARE
    """A pixel darker than this times the median of its image's valid pixels counts as shadow."""


class Request(Protocol):
    """The region that a site asks for (`io.site.RegionRequest`); None where it is left open."""

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

    A region's score is the mean of its cells' (`cell_scores`), less up to CORNER_LOSS towards the image's corners. The
    values that the request leaves open are chosen so that the score is greatest over all regions of all candidate
    views.
    sun_in_body: (K, 3). Raises InputError for a request that cannot be met, ReconstructionError where every score is 0.
    """
    options = options or RegionOptions()
    site = _Site(sparse, images, cameras, sun_in_body)
    reference, region = _choose_rectangle(site, request, options)
    stride = int(options.stride if request is None or request.stride is None else request.stride)
    if stride >= min(region.width, region.height):
        raise InputError(
            f"region.stride {stride} leaves a single row of landmarks of a region of {region.width} x {region.height} "
            "px; choose a smaller one"
        )
    return reference, replace(region, stride=stride)


class _Site(NamedTuple):
    """The inputs of the choice, for all K views."""

    sparse: SparseModel
    images: list[Image]
    cameras: list[Camera]
    sun_in_body: np.ndarray
    """(K, 3)."""


def _choose_rectangle(site: _Site, request: Request | None, options: RegionOptions) -> tuple[int, Region]:
    """Reference view and region, at stride 1."""
    names = [image.name for image in site.images]
    candidates = _candidates(site.sparse, names, request)
    best: tuple[float, int, Region] | None = None
    for view in candidates:
        camera, asked = site.cameras[view], None
        size = _size(camera, request, options)
        if request is not None and request.center_px is not None:
            asked = region_around(request.center_px, size, camera, names[view])
            if len(candidates) == 1:
                return view, asked
        scores = cell_scores(
            site.sparse, view, site.images[view], site.cameras, site.sun_in_body, options.shadow_fraction
        )
        score, region = _best_region(scores, size, camera, asked)
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
            f"({camera.width} x {camera.height} px); move center_px or reduce size_px"
        )
    return region


def _best_region(
    scores: np.ndarray, size: tuple[int, int], camera: Camera, asked: Region | None
) -> tuple[float, Region]:
    """The score of a region, and the region: that of greatest score, or the requested one."""
    width, height = size
    cells = max(1, round(height / CELL)), max(1, round(width / CELL))
    cells = min(cells[0], scores.shape[0]), min(cells[1], scores.shape[1])
    windows = np.lib.stride_tricks.sliding_window_view(scores, cells).mean((2, 3))
    row, col = np.indices(windows.shape) * CELL
    row, col = np.minimum(row, camera.height - height), np.minimum(col, camera.width - width)
    if asked is not None:
        off = (row - asked.row) ** 2 + (col - asked.col) ** 2
        return float(windows.flat[np.argmin(off)]), asked
    off = np.hypot(row + height / 2 - camera.height / 2, col + width / 2 - camera.width / 2)
    off = off / np.hypot(camera.height / 2, camera.width / 2)
    windows = windows * (1.0 - CORNER_LOSS * off)
    pick = np.unravel_index(np.argmax(windows), windows.shape)
    region = Region(row=int(row[pick]), col=int(col[pick]), height=height, width=width)
    return float(windows[pick]), region


def _candidates(sparse: SparseModel, names: list[str], request: Request | None) -> list[int]:
    """Views that may be the reference: the one that was asked for, or all that are registered."""
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
