"""Options of the sparse stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class SfmOptions:
    """Sparse structure from motion."""

    max_features: int = 5000
    """SIFT keypoints per image, the strongest contrast first."""
    partners: int = 20
    """Other views that each view is matched with: the most similar ones by a preview of a few keypoints. Views that do
    not register then are matched with all."""
    relief_keypoints: bool = True
    """Where light differs too much for keypoints of the brightness, also match keypoints of the relief, which shading
    reveals if the Sun's direction is known."""
    mapper: Literal["incremental", "global"] = "incremental"
    """How poses are found: view after view, or all at once."""
    max_ratio: float = 0.8
    """Lowe's ratio test: the best descriptor is nearer than this times the second best."""
    max_epipolar_px: float = 2.0
    """A pair's matches agree with its two-view geometry within this [px]."""
    max_reprojection_px: float = 1.5
    """Observations of sparse points farther from their projection are dropped [px]."""
    min_triangulation_deg: float = 1.0
    """Points whose rays meet at a smaller angle are dropped."""
    min_pair_matches: int = 20
    """Pairs with fewer verified matches count as not overlapping."""
    seed: int = 0
    """Seed of RANSAC and of the mapper."""
    threads: int = -1
    """-1: all cores. One thread reproduces a model bit by bit. Several add up in varying order, so that weakly
    determined values vary within their uncertainty."""
