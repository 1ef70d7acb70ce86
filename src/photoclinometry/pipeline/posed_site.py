"""A site whose views have poses: the input of the stages after structure from motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photoclinometry.adjust import KnownPoses
from photoclinometry.io.site import Site
from photoclinometry.model.geometry import Rigid
from photoclinometry.pipeline.choices import Choices
from photoclinometry.pipeline.folder.stage import Keyed
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.sparse_stages import PosedImages


@dataclass(frozen=True, kw_only=True)
class KnownViews:
    """Poses of views by a larger model, in the frame of the sparse stage."""

    name: tuple[str, ...]
    body_from_cam: Rigid
    """(K,)."""
    covariance: np.ndarray
    """(K, 6, 6) as of `KnownPoses`."""

    def of(self, names: Sequence[str]) -> KnownPoses:
        """Those of some views. Raises ValueError for a view that is not known."""
        rows = [self.name.index(name) for name in names]
        return KnownPoses(body_from_cam=self.body_from_cam[rows], covariance=self.covariance[rows])


@dataclass(frozen=True, kw_only=True)
class PosedSite:
    """A site whose views have poses, and how it is to be mapped."""

    site: Site
    posed: PosedImages
    choices: Choices
    options: RunOptions
    depth: Keyed[np.ndarray] | None = None
    """As of `MatchDensely`."""
    known_views: KnownViews | None = None
    """Of a larger model, whose poses the map's agree with."""
