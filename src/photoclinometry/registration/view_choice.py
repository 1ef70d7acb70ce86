"""The choice of views for a map of one place: within limits, and with light as different as possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from photoclinometry.io.relative_path import relative_path
from photoclinometry.io.site import MIN_VIEWS, RegionRequest, Site, SiteView, write_site
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.ranges import OptionError, Range, Ranged
from photoclinometry.registration.place import place_at, semi_axes
from photoclinometry.registration.viewing import Sighting, Sightings, light_and_sight, sightings

REGION_PX = 400
"""Width and height of the region of a chosen site [px], where the image is large enough around the place."""
SMALLEST_REGION_PX = 64
"""Smallest region around the place [px]. Where no image contains it, the region is left open: a smaller map is
useless."""
_SAME_RESOLUTION = 1.25
"""Views within this factor of the median resolution may be the reference: the map is made at its resolution."""


GroundSample = Annotated[float, Range(above=0)]
"""Ground sample distance [m]."""


@dataclass(frozen=True, kw_only=True)
class ViewLimits(Ranged):
    """Limits for the choice among the views that see a place."""

    max_emission_deg: Annotated[float, Range(above=0, most=90)] = 70.0
    """Greatest emission angle [degrees]: beyond it ground is foreshortened threefold and more."""
    max_incidence_deg: Annotated[float, Range(above=0, most=90)] = 80.0
    """Greatest incidence angle [degrees]: beyond it most ground is in shadow."""
    gsd_m: tuple[GroundSample, GroundSample] | None = None
    """Finest and coarsest ground sample distance [m]; all by default. Views within a factor of two match best."""
    count: Annotated[int, Range(least=MIN_VIEWS)] | None = None
    """Most views: those that differ most in the directions of Sun and camera. All by default."""

    def __post_init__(self):
        super().__post_init__()
        if self.gsd_m is not None and self.gsd_m[0] > self.gsd_m[1]:
            fine, coarse = self.gsd_m
            raise OptionError(type(self), "gsd_m", f"is {fine:g} {coarse:g}; give the finest, then the coarsest")


@dataclass(frozen=True, kw_only=True)
class ViewChoice:
    """The views that see a place, and those chosen for a map of it."""

    sightings: Sightings
    chosen: tuple[Sighting, ...]
    """In the order of the site."""
    left_out: dict[str, int]
    """Number of the views of the place that each limit excludes, by its option; one view may fail several."""


def choose_views(
    site: Site,
    lon_deg: float,
    lat_deg: float,
    radii_m: tuple[float, ...] | None = None,
    limits: ViewLimits = ViewLimits(),
) -> ViewChoice:
    """The views of a site that see a place by their pose priors, and those within the limits.

    lon_deg: eastward, lat_deg: planetocentric. radii_m: one radius, equatorial and polar, or three semi-axes; by
    default those of the site's body. Raises InputError where no view has a pose prior, none sees the place, or the
    body's size is not known.
    """
    if radii_m is None and site.body_radius_m is not None:
        radii_m = (site.body_radius_m,)
    place = place_at(lon_deg, lat_deg, semi_axes(site.body, radii_m))
    found = sightings(site, place)
    if not found.seen:
        raise InputError(
            f"{site.path}: no view sees {lon_deg:g} {lat_deg:g}: from {found.beyond_limb} it lies beyond the limb, "
            f"beside {found.outside_image} images; {found.without_prior} have no pose prior. Longitudes count eastward"
        )
    within = {
        "max_emission_deg": [s.emission_deg <= limits.max_emission_deg for s in found.seen],
        "max_incidence_deg": [s.incidence_deg <= limits.max_incidence_deg for s in found.seen],
    }
    if limits.gsd_m is not None:
        fine, coarse = limits.gsd_m
        within["gsd_m"] = [fine <= s.gsd_m <= coarse for s in found.seen]
    passed = np.logical_and.reduce(list(within.values()))
    chosen = diverse([s for s, ok in zip(found.seen, passed, strict=True) if ok], limits.count)
    left_out = {_flag(name): len(ok) - sum(ok) for name, ok in within.items()}
    return ViewChoice(sightings=found, chosen=chosen, left_out=left_out)


def diverse(seen: Sequence[Sighting], count: int | None) -> tuple[Sighting, ...]:
    """`count` of the views, in their order: the one of least emission, then always the one that differs most from the
    chosen.

    Views are compared by the directions of Sun and camera (`light_and_sight`). All of them if `count` is None or more.
    """
    if count is None or len(seen) <= count:
        return tuple(seen)
    first = int(np.argmin([s.emission_deg for s in seen]))
    return tuple(seen[k] for k in most_diverse(light_and_sight(seen), [first], count))


def most_diverse(apart: np.ndarray, first: Sequence[int] | np.ndarray, count: int) -> np.ndarray:
    """(m,) those in `first`, then always the one that differs most from the chosen, up to `count`; ascending.

    apart: (n, n) differences between any two.
    """
    taken = [int(k) for k in first]
    nearest = apart[taken].min(0)
    while len(taken) < min(count, len(apart)):
        nearest[taken] = -1.0  # a chosen one is not chosen again, even where others equal it
        taken.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, apart[taken[-1]])
    return np.sort(taken)


def write_chosen_site(path: Path, site: Site, choice: ViewChoice) -> Site:
    """Writes the site of the chosen views, its region about the place, to `path`, a new file; returns it.

    Where the place is at the edge of every image, the region is left open. Images stay where they are: their paths are
    relative to the new file. Raises InputError for fewer than MIN_VIEWS views, RunFolderError where the file exists or
    cannot be written.
    """
    if path.exists():
        raise RunFolderError(f"{path}: exists; choose another --out, such as a new folder's site.toml")
    if len(choice.chosen) < MIN_VIEWS:
        limits = ", ".join(f"{flag} leaves out {n}" for flag, n in choice.left_out.items() if n) or "none is left out"
        raise InputError(
            f"{len(choice.chosen)} of the {len(choice.sightings.seen)} views that see the place are within the limits, "
            f"a map needs {MIN_VIEWS} at least ({limits}); widen them"
        )
    by_name = {view.name: view for view in site.views}
    names = {s.name: relative_path(by_name[s.name].image, path.parent) for s in choice.chosen}
    views = tuple(replace(by_name[old], name=new, image=path.parent / new) for old, new in names.items())
    reference = reference_view(choice.chosen, by_name)
    region = None
    if reference is not None:
        size = _room(reference, by_name[reference.name])
        region = RegionRequest(names[reference.name], reference.pixel, (size, size))
    chosen = replace(site, views=views, region=region, path=path)
    write_site(path, chosen)
    return chosen


def reference_view(chosen: Sequence[Sighting], views: dict[str, SiteView]) -> Sighting | None:
    """The chosen view of least emission that has room for a region about the place, of typical resolution if possible.

    None where none has SMALLEST_REGION_PX of it.
    """
    middle = float(np.median([s.gsd_m for s in chosen]))
    roomy = [s for s in chosen if _room(s, views[s.name]) >= SMALLEST_REGION_PX]
    usual = [s for s in roomy if middle / _SAME_RESOLUTION <= s.gsd_m <= middle * _SAME_RESOLUTION]
    return min(usual or roomy, key=lambda s: s.emission_deg, default=None)


def _room(seen: Sighting, view: SiteView) -> int:
    """Side of the largest square about the place in the image [px], REGION_PX at most."""
    (x, y), camera = seen.pixel, view.camera
    return min(REGION_PX, int(2.0 * min(x, y, camera.width - x, camera.height - y)))


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
