"""Options of the sparse stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from photoclinometry.model.ranges import Range, Ranged


@dataclass(frozen=True, kw_only=True)
class SfmOptions(Ranged):
    """Sparse structure from motion."""

    max_features: Annotated[int, Range(least=1, most=1_000_000)] = 5000
    """SIFT keypoints per image, the strongest contrast first."""
    partners: Annotated[int, Range(least=1, most=1_000_000)] = 20
    """Other views that each view is matched with: the most similar ones by a preview of a few keypoints; eight, where
    the preview shows that these match well. Views that do not register then are matched with all."""
    relief_keypoints: bool = True
    """Where light differs too much for keypoints of the brightness, also match keypoints of the relief, which shading
    reveals if the Sun's direction is known; and by guidance, where views are left out even so."""
    mapper: Literal["incremental", "global"] = "incremental"
    """How poses are found: view after view, or all at once."""
    max_ratio: Annotated[float, Range(above=0, most=1)] = 0.8
    """Lowe's ratio test: the best descriptor is nearer than this times the second best."""
    max_epipolar_px: Annotated[float, Range(above=0)] = 2.0
    """A pair's matches agree with its two-view geometry within this [px]."""
    max_reprojection_px: Annotated[float, Range(above=0)] = 1.5
    """Observations of sparse points farther from their projection are dropped [px]."""
    min_triangulation_deg: Annotated[float, Range(least=0, below=90)] = 1.0
    """Points whose rays meet at a smaller angle are dropped."""
    min_pair_matches: Annotated[int, Range(least=1, most=1_000_000)] = 20
    """Pairs with fewer verified matches count as not overlapping."""
    seed: Annotated[int, Range(least=0, most=2**31 - 1)] = 0
    """Seed of RANSAC and of the mapper."""
    threads: Annotated[int, Range(least=1, most=1024, also=(-1,))] = -1
    """-1: all cores. One thread reproduces a model bit by bit. Several add up in varying order, so that weakly
    determined values vary within their uncertainty."""
