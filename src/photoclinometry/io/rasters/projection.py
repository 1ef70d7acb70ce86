"""Map projections of a globe, from and to body-fixed positions. Needs the extra `geo` (rasterio)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from photoclinometry.io.rasters.globe import (
    Globe,
    body_fixed,
    find_globe,
    geographic,
    iau_crs,
    need_rasterio,
    quoted,
    transform_points,
)
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit

Projection = Literal["equirectangular", "orthographic", "polar-stereographic"]

_CODE = {"geographic": 0, "equirectangular": 10, "equirectangular-180": 15, "north": 30, "south": 35}
"""Kinds of systems in IAU_2015: the last two digits of a code."""
_HIGHEST_EQUIRECTANGULAR_DEG = 85.0
"""Latitude beyond which equirectangular pixels are stretched more than eleven times from west to east."""
_LOWEST_POLAR_DEG = 30.0
"""Latitude below which lengths of a polar stereographic map are a third too long and more: 2 / (1 + sin latitude)."""
_FLATTEST_POLAR = 0.01
"""Flattening beyond which PROJ's polar stereographic maps do not read back to their positions."""
_HORIZON = 0.05
"""Cosine of the angle from the centre to which an orthographic map extends: 87 degrees, nearly edge-on."""


@dataclass(frozen=True, kw_only=True)
class MapProjection:
    """A projected reference system [m] of a globe."""

    globe: Globe
    crs: Any
    """The rasterio CRS."""

    def from_body(self, position: np.ndarray) -> np.ndarray:
        """Easting, northing and height above the globe (n, 3) [m] of body-fixed positions (n, 3) [m]."""
        return transform_points(self.globe.crs, self.crs, geographic(self.globe, position))

    def to_body(self, east_north_height: np.ndarray) -> np.ndarray:
        """The inverse of `from_body`."""
        return body_fixed(self.crs, self.globe.radii_m, east_north_height)


def site_projection(
    globe: Globe, projection: Projection, position: np.ndarray, center_deg: tuple[float, float] | None = None
) -> MapProjection:
    """The projection for a map of landmarks (n, 3) [m].

    equirectangular: true to scale along the equator, centred on longitude 0, or on 180 for landmarks on both sides of
    it. orthographic: as seen from far above `center_deg` (longitude, latitude), by default the middle of the landmarks
    rounded to 0.01 degrees. polar-stereographic: about the nearer pole, true to scale there. Raises InputError if the
    projection cannot show the landmarks.
    """
    if projection == "orthographic":
        middle = geographic(globe, unit(position).mean(0, keepdims=True) * globe.radii_m[0])[0]
        lon, lat = (round(float(x), 2) for x in middle[:2]) if center_deg is None else center_deg
        if not (-360.0 <= lon <= 360.0 and -90.0 <= lat <= 90.0):
            raise InputError(f"--center-deg {lon} {lat} is not a longitude and latitude")
        _check_seen(lon, lat, geographic(globe, position)[:, :2])
        name = f"Orthographic about {degrees_words(lon, lat)}"
        return MapProjection(globe=globe, crs=_projected(globe, name, "Orthographic", lat, lon))
    lon, lat = geographic(globe, position)[:, :2].T
    if projection == "polar-stereographic":
        a, c = globe.radii_m
        if 1.0 - c / a > _FLATTEST_POLAR:
            raise InputError(
                f"PROJ cannot read a {projection} map of a spheroid of {a:g} and {c:g} m back; choose --projection "
                "orthographic, or give the radius of a sphere (--radii-m)"
            )
        kind = "north" if np.median(lat) >= 0 else "south"
        pole = 90.0 if kind == "north" else -90.0
        if np.any(lat * pole < 0):
            raise InputError(
                f"the map crosses the equator, and a {projection} map shows one hemisphere; choose --projection "
                "equirectangular or orthographic"
            )
        nearest = float(np.abs(lat).min())
        if nearest < _LOWEST_POLAR_DEG:
            stretch = 100.0 * (2.0 / (1.0 + np.sin(np.radians(nearest))) - 1.0)
            raise InputError(
                f"the map reaches latitude {lat[np.argmin(np.abs(lat))]:.1f}, where lengths of a {projection} map are "
                f"{stretch:.0f} % too long; choose --projection equirectangular or orthographic"
            )
        crs = _iau_or(globe, kind) or _projected(globe, f"{kind.title()} Polar", "Polar_Stereographic", pole, 0.0)
        return MapProjection(globe=globe, crs=crs)
    if np.abs(lat).max() > _HIGHEST_EQUIRECTANGULAR_DEG:
        raise InputError(
            f"the map reaches latitude {lat[np.argmax(np.abs(lat))]:.1f}, where equirectangular maps are stretched; "
            "choose --projection polar-stereographic or orthographic"
        )
    middle = 0.0
    if np.ptp(lon) > 180.0:
        middle = 180.0
        if np.ptp(lon % 360.0) > 180.0:
            raise InputError("the map reaches around the body; choose --projection orthographic")
    crs = _iau_or(globe, "equirectangular-180" if middle else "equirectangular")
    name = f"Equirectangular, clon = {middle:g}"
    return MapProjection(globe=globe, crs=crs or _projected(globe, name, "Equirectangular", 0.0, middle))


def body_projections(globe: Globe) -> dict[str, MapProjection]:
    """Three maps of a whole body: "cylindrical" (equidistant, about longitude 0) and polar stereographic, "north" and
    "south". They are on the sphere of the globe's equatorial radius, with planetocentric latitudes, since PROJ's polar
    maps of flat spheroids do not read back."""
    radius = globe.radii_m[0]
    sphere = globe if globe.radii_m[1] == radius else find_globe(globe.name.split(",")[0], (radius,))
    own = {
        "cylindrical": ("equirectangular", "Equirectangular, clon = 0", "Equirectangular", 0.0),
        "north": ("north", "North Polar", "Polar_Stereographic", 90.0),
        "south": ("south", "South Polar", "Polar_Stereographic", -90.0),
    }
    return {
        name: MapProjection(globe=sphere, crs=_iau_or(sphere, kind) or _projected(sphere, words, method, latitude, 0.0))
        for name, (kind, words, method, latitude) in own.items()
    }


def _check_seen(lon_deg: float, lat_deg: float, points_deg: np.ndarray) -> None:
    """Raises InputError if points (longitude, latitude) (n, 2) lie on the far side of the body from the centre."""
    lon, lat = np.radians(points_deg).T
    center = np.radians(lat_deg)
    cosine = np.sin(center) * np.sin(lat) + np.cos(center) * np.cos(lat) * np.cos(lon - np.radians(lon_deg))
    hidden = int(np.sum(cosine < _HORIZON))
    if hidden:
        raise InputError(
            f"{hidden} of {len(lon)} landmarks lie on the far side of an orthographic map about "
            f"{degrees_words(lon_deg, lat_deg)}; choose another --center-deg"
        )


def degrees_words(lon_deg: float, lat_deg: float) -> str:
    """A longitude, eastward, and a latitude in words: "135.14 W, 10 S" for -135.14 and -10, or 224.86 and -10."""
    east = round((lon_deg + 180.0) % 360.0 - 180.0, 9)
    return f"{abs(east):g} {'W' if east < 0 else 'E'}, {abs(lat_deg):g} {'S' if lat_deg < 0 else 'N'}"


def local_crs(name: str) -> Any:
    """The rasterio CRS of a plane [m] whose place on the body is unknown (an engineering CRS)."""
    need_rasterio()
    from rasterio.crs import CRS

    return CRS.from_wkt(f'LOCAL_CS["{quoted(name)}",UNIT["metre",1]]')


def _iau_or(globe: Globe, kind: str) -> Any:
    """The IAU's reference system of this kind; None for a globe with given radii."""
    return None if globe.iau is None else iau_crs(globe.iau + _CODE[kind])


def _projected(globe: Globe, name: str, method: str, latitude: float, longitude: float) -> Any:
    from rasterio.crs import CRS

    parallel = "standard_parallel_1" if method == "Equirectangular" else "latitude_of_origin"
    scale = 'PARAMETER["scale_factor",1],' if method == "Polar_Stereographic" else ""
    return CRS.from_wkt(
        f'PROJCS["{globe.name} / {name}",{globe.crs.to_wkt()},PROJECTION["{method}"],'
        f'PARAMETER["{parallel}",{latitude!r}],PARAMETER["central_meridian",{longitude!r}],{scale}'
        'PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1]]'
    )
