"""Arcs of attitude and orbit: groups of images whose Suns and poses have common errors."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta

ARC_GAP = timedelta(days=1)
"""Images that follow each other by less belong to one arc. Attitudes and orbits are reconstructed piece by piece, from
one manoeuvre or kernel to the next: pieces of days to weeks (Dawn's attitude kernels are of a week each). Images within
a day nearly always belong to one piece. Splitting one piece in two costs little, since its error is estimated twice;
joining two pieces holds views to Suns and poses that contradict each other."""


def arcs_of(source: Sequence[str], time: Sequence[datetime | None]) -> list[str | None]:
    """The arc of each of K images, by a name with its date; None for all where there is one arc.

    source: camera, and origin of Sun and pose; each has arcs of its own. An image without a time has no arc.
    """
    latest: dict[str, tuple[datetime, str]] = {}
    arcs: list[str | None] = [None] * len(source)
    dated = sorted((when, name, k) for k, (name, when) in enumerate(zip(source, time, strict=True)) if when is not None)
    for when, name, k in dated:
        before, arc = latest.get(name, (datetime.min, ""))
        if when - before > ARC_GAP:
            arc = f"{name}, {when:%Y-%m-%d}"
        latest[name], arcs[k] = (when, arc), arc
    return arcs if len({arc for arc in arcs if arc is not None}) > 1 else [None] * len(source)
