"""The choices that the options imply for a site: its reflectance model, its matchers, and the views held out."""

from __future__ import annotations

import hashlib
import inspect
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.evaluate.held_out import held_out_mask
from photoclinometry.io.altimetry_csv import read_altimetry
from photoclinometry.io.control_points_csv import read_control_points
from photoclinometry.io.site import MIN_VIEWS, Site
from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.matching.interface import Matcher
from photoclinometry.matching.registry import matcher_entry
from photoclinometry.model.altimetry import AltimeterTracks
from photoclinometry.model.control import ControlPoint
from photoclinometry.model.errors import InputError, PhotoclinometryError
from photoclinometry.model.reflectance import Reflectance, has_published, models_for, published, starting_model
from photoclinometry.photometry.predict import exposure_is_free
from photoclinometry.pipeline.folder.stage import Keyed, digest
from photoclinometry.pipeline.options import RunOptions

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Choices:
    """The model, the matchers and the data of a run."""

    reflectance: Reflectance | None
    """None of geometry alone."""
    candidates: tuple[str, ...]
    """Names of models of which the last estimate takes the best; none where the model is given."""
    last_reflectance: Reflectance | None = None
    """The model of the last estimate, where another map's choice gave one that differs from the earlier estimates'."""
    matcher: Keyed[Matcher]
    """Of the first map."""
    relit_matcher: Keyed[Matcher]
    """The matcher of images under the same light: of views with the relit reference, and of held-out views with the
    finished map."""
    held_out: np.ndarray
    """(K,) bool."""
    max_iterations: int
    """Relighting iterations at most."""
    control: tuple[ControlPoint, ...] = ()
    """Ground control points."""
    altimetry: AltimeterTracks | None = None
    """Laser altimetry, in the frame of pose priors or control points."""


def choose(site: Site, options: RunOptions) -> Choices:
    """The choices that the options imply for a site. Raises InputError where they do not fit it, or a matcher lacks
    something."""
    reference = site.region.reference if site.region else None
    names = [view.name for view in site.views]
    control = read_control_points(options.control, names) if options.control else ()
    altimetry = read_altimetry(options.altimetry) if options.altimetry else None
    if altimetry is not None and not control and not (options.pose_priors and site.pose_priors):
        raise InputError(
            f"{options.altimetry}: shots need a map that is roughly in place, and the site has no pose priors; add "
            "cam_from_body to the views of site.toml, or pass --control"
        )
    reflectance = choose_reflectance(options.reflectance, site.body)
    name = options.matcher_name
    held_out = held_out_mask(names, options.hold_out, reference)
    check_enough_views(site, ~held_out, options.densify)
    log.info("matcher: %s (%s)", name, matcher_entry(name).precision)
    return Choices(
        reflectance=reflectance,
        candidates=candidate_models(reflectance, site.body, site.brightness)
        if options.reflectance == "auto" and reflectance
        else (),
        matcher=keyed_matcher(name, options),
        relit_matcher=keyed_matcher(matcher_entry(name).relit_with or name, options),
        held_out=held_out,
        max_iterations=0 if reflectance is None else options.max_iterations,
        control=control,
        altimetry=altimetry,
    )


def check_enough_views(
    site: Site, mapped: np.ndarray, densify: DensifyOptions, error: type[PhotoclinometryError] = InputError
) -> None:
    """Raises `error` where no landmark can be in as many views as it is to be in. mapped: (K,) bool."""
    count = int(np.count_nonzero(mapped))
    fewest = densify.views_needed(count)
    if count < fewest:
        enough = count >= MIN_VIEWS
        raise error(
            f"{site.path}: {count} views are to be mapped, but landmarks are to be in {fewest} views at least; add "
            f"views{f', or pass --densify.min-views {count} or --preset few-views' if enough else ''}"
        )


def choose_reflectance(name: str, body: str | None) -> Reflectance | None:
    """The reflectance model that `RunOptions.reflectance` means for a body; None for geometry alone."""
    if name == "none":
        return None
    if name != "auto":
        return starting_model(name, body)
    chosen = "lunar-lambert" if has_published("lunar-lambert", body) else "mcewen"
    log.info("reflectance: %s", chosen)
    return published(chosen, body)


def candidate_models(first: Reflectance, body: str | None, brightness: str) -> tuple[str, ...]:
    """Names of the model to begin with and of the models that may turn out better for images of a body.

    Of calibrated images they predict the brightness itself, if the first does: a model without a phase function has
    relative albedos.
    """
    return models_for(body, absolute=not exposure_is_free(brightness, first))


def keyed_matcher(name: str, options: RunOptions) -> Keyed[Matcher]:
    """A matcher by name, with a key of all that its matches depend on. Raises InputError."""
    entry, chosen = matcher_entry(name), options.of_matcher(name)
    return Keyed(entry.make(chosen), digest(name, entry.fingerprint(chosen), _code_of(entry.make)))


def _code_of(make: Callable[..., Any]) -> str:
    """A digest of the file that makes a matcher: one from outside this package is not in `program_digest`."""
    file = getattr(inspect.getmodule(make), "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""
