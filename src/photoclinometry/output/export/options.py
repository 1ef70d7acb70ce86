"""The products to export, and the place of the scene's frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from photoclinometry.io.rasters.projection import Projection
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.output.export.formats import FORMATS
from photoclinometry.output.export.shape.formats import SHAPE_FORMATS

if TYPE_CHECKING:
    Product = str
else:
    Product = Literal[*dict.fromkeys((*FORMATS, *SHAPE_FORMATS))]


_Longitude = Annotated[float, Range(least=-360, most=360)]
_Latitude = Annotated[float, Range(least=-90, most=90)]
_Slant = Annotated[float, Range(least=0, below=90)]
"""Angle from the vertical at which ground is lit and seen [degrees]."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions(Ranged):
    """The products to export, and the place of the scene's frame."""

    products: tuple[Product, ...] = ()
    """Formats to write, of the map of a place or of a whole body. Left out: all that it holds and its frame allows."""
    transform: Path | None = None
    """TOML file with scale, rotation (3 rows), translation [m]: body-fixed = scale rotation @ scene + translation."""
    site: Path | None = None
    """site.toml of the run, with pose priors in the body-fixed frame [m] for three views or more, as `phomo ingest`
    writes them: they determine where on the body the scene lies."""
    body_fixed: bool = False
    """The scene's own frame is body-fixed: origin in the body's centre, z to the north pole, x to longitude 0."""
    unit_m: Annotated[float | None, Range(above=0)] = None
    """Metres in the unit of length (1000 for km) of a scene or a model. Without this, --transform and --site, the scale
    of a scene is unknown."""
    body: str | None = None
    """Body that the map is of. Left out: the scene's."""
    radii_m: Annotated[tuple[float, ...] | None, Range(above=0)] = None
    """Radius of the sphere that maps are drawn on, or equatorial and polar radius of a spheroid [m]. Left out: the
    IAU's sphere of the body."""
    projection: Projection | None = None
    """Of maps, where the frame is body-fixed. Left out: equirectangular."""
    center_deg: tuple[_Longitude, _Latitude] | None = None
    """East longitude and latitude of the centre of an orthographic map [degrees]. Left out: the middle of the scene."""
    resolution: Annotated[float | None, Range(above=0)] = None
    """Width of a map's pixel [m, or the scene's unit where metres are unknown]. Left out: the ground sample
    distance times the region's stride."""
    standard_geometry_deg: tuple[_Slant, _Slant, Annotated[float, Range(least=0, most=180)]] = (30.0, 0.0, 30.0)
    """Incidence, emission and phase that the reflectance map is reduced to [degrees]."""
