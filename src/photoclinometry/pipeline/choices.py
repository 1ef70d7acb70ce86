"""What the options mean for a site: its reflectance model, and its matchers."""

from __future__ import annotations

import hashlib
import inspect
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from photoclinometry.matching.interface import Matcher
from photoclinometry.matching.registry import matcher_entry
from photoclinometry.model.reflectance import Reflectance, has_published, published
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.stage import Keyed, digest

log = logging.getLogger(__name__)


def choose_reflectance(name: str, brightness: str, body: str | None) -> Reflectance | None:
    """The reflectance model that `RunOptions.reflectance` means for a site's brightness and body; None for geometry
    alone."""
    if name == "none":
        return None
    if name != "auto":
        return published(name, body)
    calibrated = brightness == "iof" and has_published("lunar-lambert", body)
    chosen = "lunar-lambert" if calibrated else "mcewen"
    log.info("reflectance: %s", chosen)
    return published(chosen, body)


def first_matcher(options: RunOptions) -> Matcher:
    """The matcher of the first map. Raises InputError where its files or packages are missing."""
    return matcher_entry(options.matcher_name).make(options.of_matcher(options.matcher_name))


def keyed_first_matcher(options: RunOptions) -> Keyed[Matcher]:
    """As `first_matcher`, with a key of all that its matches depend on."""
    return _keyed_matcher(options.matcher_name, options)


def keyed_relit_matcher(options: RunOptions) -> Keyed[Matcher]:
    """The matcher of what shows the same light: the reference relit, and views that were held out with their map."""
    name = options.matcher_name
    return _keyed_matcher(matcher_entry(name).relit_with or name, options)


def _keyed_matcher(name: str, options: RunOptions) -> Keyed[Matcher]:
    entry, chosen = matcher_entry(name), options.of_matcher(name)
    matcher = entry.make(chosen)
    log.info("matcher: %s (%s)", name, entry.precision)
    return Keyed(matcher, digest(name, entry.fingerprint(chosen), _code_of(entry.make)))


def _code_of(make: Callable[..., Any]) -> str:
    """A digest of the file that makes a matcher: one from outside this package is not in `program_digest`."""
    file = getattr(inspect.getmodule(make), "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""
