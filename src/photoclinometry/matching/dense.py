"""Every view matched with the reference, and the matches triangulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photoclinometry.matching.densify import DenseTracks, DensifyOptions, densify
from photoclinometry.matching.interface import Matcher, Matches, MatchSetup
from photoclinometry.model.progress import Progress


def match_views(
    setup: MatchSetup, targets: Sequence[int], matcher: Matcher, depth: np.ndarray, progress: Progress, what: str
) -> dict[int, Matches]:
    """The matches of each target view, by its index. depth: as of `MatchSetup.request`; what: progress' first word."""
    matches = {}
    for done, target in enumerate(targets):
        progress(what, done, len(targets))
        matches[target] = matcher.match(setup.request(target, depth))
    progress(what, len(targets), len(targets))
    return matches


def triangulated(setup: MatchSetup, matches: dict[int, Matches], options: DensifyOptions) -> DenseTracks:
    """Landmarks from the matches of `setup` (`densify`). Raises ReconstructionError where no pixel qualifies."""
    return densify(setup.region, setup.reference, matches, list(setup.cameras), setup.body_from_cam, options)
