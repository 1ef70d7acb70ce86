"""Every view matched with the reference, and the matches triangulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photoclinometry.matching.densify import DenseTracks, DensifyOptions, densify
from photoclinometry.matching.interface import Matcher, Matches, MatchSetup
from photoclinometry.model.progress import Progress
from photoclinometry.model.threads import counted, in_threads


def match_views(
    setup: MatchSetup, targets: Sequence[int], matcher: Matcher, depth: np.ndarray, progress: Progress, what: str
) -> dict[int, Matches]:
    """The matches of each target view, by its index. depth: as of `MatchSetup.request`; what: progress' first word."""

    def matches_of(target: int) -> Matches:
        return matcher.match(setup.request(target, depth))

    def report(done: int) -> None:
        progress(what, done, len(targets))

    report(0)
    if getattr(matcher, "in_threads", False):
        found = in_threads(matches_of, targets, report)
    else:
        found = counted(map(matches_of, targets), report)
    return dict(zip(targets, found, strict=True))


def triangulated(setup: MatchSetup, matches: dict[int, Matches], options: DensifyOptions) -> DenseTracks:
    """Landmarks from the matches of `setup` (`densify`). Raises ReconstructionError where no pixel qualifies."""
    return densify(setup.region, setup.reference, matches, list(setup.cameras), setup.body_from_cam, options)
