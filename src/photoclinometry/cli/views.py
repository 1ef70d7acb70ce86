"""`phomo views`: which images of a site see a place of the body, and a site of those chosen for a map of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from photoclinometry.cli.columns import plain_number, rows_as_text, short_names
from photoclinometry.cli.site_path import site_file
from photoclinometry.io.rasters.projection import degrees_words
from photoclinometry.registration.view_choice import ViewLimits

if TYPE_CHECKING:
    from photoclinometry.registration.view_choice import ViewChoice

_LONGEST_NAME = 36
"""Longer names of images leave no room for the numbers [characters]: what all have in common is left out."""


def views(
    site: tyro.conf.Positional[Path],
    /,
    at: Annotated[tuple[float, float], tyro.conf.arg(metavar="LON LAT")],
    radii_m: tuple[float, ...] | None = None,
    out: Path | None = None,
    limits: Annotated[ViewLimits, tyro.conf.arg(name="")] = ViewLimits(),  # noqa: B008
) -> None:
    """List the images of a site that see a place of the body, and write a site of those chosen for a map of it.

    The site needs pose priors, as `phomo ingest` writes them from SPICE kernels, ISIS cubes or SUMFILEs. The body is
    taken for its reference ellipsoid: no ground hides other ground. Images are not opened.

    Args:
        site: A site.toml, or a folder with one.
        at: Longitude, eastward, and planetocentric latitude of the place [degrees]. Range: -360 to 360, then -90 to
            90.
        radii_m: The body's radius, its equatorial and polar radius, or its three semi-axes [m]. Range: above 0.
            Default: the body's.
        out: A new site.toml, or a folder for one: the chosen images, and the region about the place. Images stay where
            they are.
        limits: Which of the images that see the place are chosen.
    """
    from photoclinometry.io.site import read_site
    from photoclinometry.registration.view_choice import choose_views, write_chosen_site

    found = read_site(site_file(site))
    choice = choose_views(found, at[0], at[1], radii_m, limits)
    show(choice)
    if out is not None:
        path = out if out.suffix == ".toml" else out / "site.toml"
        written = write_chosen_site(path, found, choice)
        region = written.region
        if region is None or region.size_px is None:
            _say("region: chosen by `phomo run`, since the place is at the edge of every image")
        else:
            _say(f"region: {region.size_px[0]} x {region.size_px[1]} px about the place, in {region.reference}")
        print(path)


def show(choice: ViewChoice) -> None:
    """A line for each view that sees the place, chosen ones marked, and how many there are of each kind."""
    found = choice.sightings
    names, pattern = short_names([Path(s.name).stem for s in found.seen], _LONGEST_NAME)
    chosen = {s.name for s in choice.chosen}
    rows = [
        (
            f"{'*' if s.name in chosen else ' '} {name}",
            plain_number(s.gsd_m),
            *(f"{angle:.1f}" for angle in (s.emission_deg, s.incidence_deg, s.phase_deg, s.sub_spacecraft_deg)),
            plain_number(s.distance_m / 1e3),
        )
        for name, s in zip(names, found.seen, strict=True)
    ]
    for line in rows_as_text(("  image", "m/px", "emis.", "inc.", "phase", "sub-sc", "km"), rows):
        print(line)
    if pattern:
        _say(f"image: * of {pattern}")
    place = degrees_words(found.place.lon_deg, found.place.lat_deg)
    _say(
        f"{len(found.seen)} views see {place}; {len(chosen)} are chosen (*). Of the others, "
        f"{found.beyond_limb} have it beyond the limb, {found.outside_image} have it beside the image, and "
        f"{found.without_prior} have no pose prior"
    )


def _say(text: str) -> None:
    from rich.console import Console

    Console(stderr=True).print(text, soft_wrap=True, highlight=False, markup=False)
