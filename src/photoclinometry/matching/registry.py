"""The matchers that `phomo run --matcher` knows. A new one is a file with its class, and an entry here.

    MATCHERS["mine"] = MatcherEntry(options=MyOptions(), make=MyMatcher, precision="0.1 px on rendered images")

A package of its own may add its entry when it is imported.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from photoclinometry.matching.flow import FlowMatcher, FlowOptions
from photoclinometry.matching.interface import Matcher
from photoclinometry.matching.roma import RomaOptions, fingerprint, roma_matcher
from photoclinometry.model.errors import InputError


def _as_they_are(options: Any) -> Any:
    return options


@dataclass(frozen=True, kw_only=True)
class MatcherEntry:
    """A matcher that can be chosen by name."""

    options: Any
    """Options that shape its matches, with defaults; a dataclass."""
    make: Callable[[Any], Matcher]
    """The matcher for such options. Raises InputError where its files or packages are missing."""
    precision: str
    """Its precision, and the images on which that was measured."""
    relit_with: str | None = None
    """The matcher that relighting iterations use after it; left out, itself."""
    fingerprint: Callable[[Any], Any] = _as_they_are
    """The properties of such options on which its matches depend: for files their contents, not their paths."""


MATCHERS: dict[str, MatcherEntry] = {
    "flow": MatcherEntry(
        options=FlowOptions(),
        make=FlowMatcher,
        precision="0.07 px in the median, on a simulated site of 29 views",
    ),
    # A learned matcher is for large changes of light. Against the reference relit there are none, and there the sigmas
    # of flow are known from simulated sites, RoMa's are not.
    "roma": MatcherEntry(
        options=RomaOptions(),
        make=roma_matcher,
        precision="0.5 px per axis, on MegaDepth; not measured on images of small bodies",
        relit_with="flow",
        fingerprint=fingerprint,
    ),
}
"""By name."""


def matcher_entry(name: str) -> MatcherEntry:
    """The entry of a matcher. Raises InputError for names that are not in the table."""
    if name not in MATCHERS:
        near = difflib.get_close_matches(name, MATCHERS, n=1, cutoff=0.0)
        raise InputError(f"no matcher {name!r}; known: {', '.join(MATCHERS)}; nearest: {near[0]}")
    return MATCHERS[name]
