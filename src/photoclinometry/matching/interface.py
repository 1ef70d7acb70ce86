"""The input and the result of a dense matcher. A new matcher is one class with `name` and `match`.

    class MyMatcher:
        name = "mine"

        def match(self, request: MatchRequest) -> Matches:
            ...

An entry in `registry.MATCHERS` makes it a choice of `phomo run --matcher`.

`in_threads = True` beside the name says that several threads may call `match` at once; without it, only one does.

Two pictures can be matched by `reference`, `target` and `region` alone; `prediction` is where a pixel is expected, for
matchers that can use it. To match against another picture of the reference, for instance one rendered under the
target's Sun, replace the reference image: `replace(request, reference=rendered)`, with the rendering's own mask.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from photoclinometry.matching.prewarp import predict_pixels
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.image import Image
from photoclinometry.model.region import Region

MARGIN_PX = 48
"""Pixels around the region that dense matching looks at."""


@dataclass(frozen=True, kw_only=True)
class MatchRequest:
    """Find the pixels of a region of the reference image in the target image."""

    reference: Image
    """The whole reference image, or a picture of it under another light."""
    target: Image
    region: Region
    """The pixels of the reference whose positions are wanted: those of its map grid."""
    padded: Region
    """`region` with a margin, cut to the image: windows near the region's edge look there."""
    prediction: np.ndarray
    """(padded.height, padded.width, 2) where each padded pixel's centre is expected in the target [px]."""

    def __post_init__(self):
        expected = (self.padded.height, self.padded.width, 2)
        if self.prediction.shape != expected:
            raise InputError(f"prediction has shape {self.prediction.shape}, expected {expected}")

    @property
    def inner(self) -> tuple[slice, slice]:
        """Slices that cut the map's grid, every `region.stride`-th pixel, out of arrays over `padded`."""
        down, right = self.region.slices_in(self.padded)
        return slice(down.start, down.stop, self.region.stride), slice(right.start, right.stop, self.region.stride)


@dataclass(frozen=True, kw_only=True)
class Matches:
    """One target's answer for every pixel (h, w) of the region's map grid."""

    position: np.ndarray
    """(h, w, 2) float64: position of the pixel's centre in the target [px]. Defined only where `valid`."""
    certainty: np.ndarray
    """(h, w) float32 in [0, 1]."""
    sigma_px: np.ndarray
    """(h, w) float32: standard deviation of the position about each axis [px]."""
    valid: np.ndarray
    """(h, w) bool."""


def region_matches(
    request: MatchRequest, position: np.ndarray, certainty: np.ndarray, sigma_px: np.ndarray, valid: np.ndarray
) -> Matches:
    """Matches on the map's grid from those on the padded region: arrays (h, w, ...) as in `Matches`."""
    position, certainty, sigma_px, valid = (a[request.inner] for a in (position, certainty, sigma_px, valid))
    return Matches(
        position=np.where(valid[..., None], position, 0.0),
        certainty=np.where(valid, certainty, 0.0).astype(np.float32),
        sigma_px=sigma_px.astype(np.float32),
        valid=valid.copy(),
    )


class Matcher(Protocol):
    """Anything that answers a request."""

    @property
    def name(self) -> str: ...

    def match(self, request: MatchRequest) -> Matches: ...


def padded_region(region: Region, margin: int, camera: Camera) -> Region:
    """The region grown by a margin [px] on all sides, cut to the image."""
    row, col = max(0, region.row - margin), max(0, region.col - margin)
    bottom = min(camera.height, region.row + region.height + margin)
    right = min(camera.width, region.col + region.width + margin)
    return Region(row=row, col=col, height=bottom - row, width=right - col)


@dataclass(frozen=True, kw_only=True)
class MatchSetup:
    """The views that are matched, their poses, and the region of one of them whose pixels are wanted."""

    images: Sequence[Image]
    """(K,)."""
    cameras: Sequence[Camera]
    """(K,)."""
    body_from_cam: Rigid
    """(K,) poses, good to a few pixels."""
    reference: int
    """The view that `region` is of."""
    region: Region
    margin_px: int = MARGIN_PX

    @property
    def padded(self) -> Region:
        """The region with its margin."""
        return padded_region(self.region, self.margin_px, self.cameras[self.reference])

    def request(self, target: int, depth: np.ndarray) -> MatchRequest:
        """The request to match the reference with view `target`.

        depth: (padded.height, padded.width) in the reference camera, from which positions are predicted.
        """
        reference, padded = self.reference, self.padded
        prediction = predict_pixels(
            depth,
            padded,
            self.cameras[reference],
            self.body_from_cam[reference],
            self.cameras[target],
            self.body_from_cam[target],
        )
        return MatchRequest(
            reference=self.images[reference],
            target=self.images[target],
            region=self.region,
            padded=padded,
            prediction=prediction,
        )
