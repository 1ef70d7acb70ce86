"""Reference spheres and spheroids of bodies, with longitudes and latitudes. Needs the extra `geo` (rasterio).

A body's frame has its origin in the centre, z to the north pole and x to longitude zero; longitudes count eastward.
Bodies in PROJ's IAU_2015 (Archinal et al. 2018, doi:10.1007/s10569-017-9805-5) have the sphere that the IAU recommends
for maps. Other bodies need radii.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from photoclinometry.model.bodies import IAU_NUMBER
from photoclinometry.model.errors import InputError

_LATITUDE_STEPS = 30
"""Steps of Bowring's iteration: three reach rounding near a spheroid as flat as Vesta, points deep inside need more."""


@dataclass(frozen=True, kw_only=True)
class Globe:
    """The sphere or spheroid that maps of a body refer to."""

    name: str
    radii_m: tuple[float, float]
    """Equatorial and polar."""
    crs: Any
    """rasterio's CRS of longitudes and latitudes."""
    iau: int | None = None
    """The code of `crs` in IAU_2015."""

    @property
    def shape(self) -> str:
        """Shape and radii in words."""
        return _shape(*self.radii_m)


def find_globe(body: str | None, radii_m: tuple[float, ...] | None = None) -> Globe:
    """The globe of a body in IAU_2015, or one with given radii [m]: that of a sphere, or equatorial and polar.

    Raises InputError for a body that is not in IAU_2015, unless radii are given.
    """
    need_rasterio()
    if radii_m is not None:
        return _globe_of_radii(body, radii_m)
    number = IAU_NUMBER.get((body or "").lower())
    if number is None:
        raise InputError(
            f"no IAU_2015 reference system is known for body {body!r} (known: {', '.join(IAU_NUMBER)}); give its "
            "radii [m]: one of a sphere, or equatorial and polar (--radii-m)"
        )
    crs = iau_crs(100 * number)
    radii = semi_axes(crs)
    assert radii is not None
    return Globe(name=name_of(crs), radii_m=radii, crs=crs, iau=100 * number)


def geographic(globe: Globe, position: np.ndarray) -> np.ndarray:
    """Longitude in [-180, 180] and latitude [degrees], and height above the globe [m], (n, 3), of positions (n, 3) [m].

    Latitudes are planetocentric on a sphere, planetographic on a spheroid: Bowring's formula, Survey Review 23 (1976)
    323, iterated to convergence. PROJ applies it once, with an error of 20 m 15 km above a spheroid as flat as Vesta.
    """
    a, c = globe.radii_m
    x, y, z = np.asarray(position, float).T
    across = np.hypot(x, y)
    latitude = reduced = np.arctan2(a * z, c * across)
    for _ in range(_LATITUDE_STEPS):
        sine, cosine = np.sin(reduced), np.cos(reduced)
        latitude = np.arctan2(z + (a * a - c * c) / c * sine**3, across - (a * a - c * c) / a * cosine**3)
        reduced = np.arctan2(c * np.sin(latitude), a * np.cos(latitude))
    foot = np.stack([a * np.cos(reduced), c * np.sin(reduced)])
    height = (across - foot[0]) * np.cos(latitude) + (z - foot[1]) * np.sin(latitude)
    return np.stack([np.degrees(np.arctan2(y, x)), np.degrees(latitude), height], -1)


def need_rasterio() -> None:
    """Raises InputError if rasterio is not installed."""
    try:
        import rasterio  # noqa: F401
    except ImportError as error:
        raise InputError(
            "maps of a body (GeoTIFF) need rasterio: pip install 'photoclinometry[geo]', or export other --products"
        ) from error


def name_of(crs: Any) -> str:
    """The name of a rasterio CRS."""
    return str(crs.to_dict(projjson=True).get("name", "unnamed"))


def semi_axes(crs: Any) -> tuple[float, float] | None:
    """Equatorial and polar radius [m] of a reference system's ellipsoid; None if it has none."""
    return _ellipsoid_below(crs.to_dict(projjson=True)) if crs else None


def body_fixed(crs: Any, radii_m: tuple[float, float], east_north_height: np.ndarray) -> np.ndarray:
    """Positions (n, 3) [m] of map coordinates and heights above the ellipsoid of `radii_m` (n, 3)."""
    from rasterio.crs import CRS

    centred = CRS.from_dict(proj="geocent", a=radii_m[0], b=radii_m[1], units="m", no_defs=True)
    return transform_points(crs, centred, east_north_height)


def iau_crs(code: int) -> Any:
    """The rasterio CRS of a code in IAU_2015."""
    from rasterio.crs import CRS

    return CRS.from_user_input(f"IAU_2015:{code}")


def quoted(name: str) -> str:
    """A name that WKT can hold."""
    return name.replace('"', "'")


def transform_points(source: Any, target: Any, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) transformed from one rasterio CRS to another by PROJ."""
    from rasterio.warp import transform

    moved = transform(source, target, *np.asarray(points, float).T)
    return np.stack([np.asarray(axis, float) for axis in moved], -1)


def _shape(a: float, c: float) -> str:
    return f"sphere of {a:.10g} m" if a == c else f"spheroid of {a:.10g} and {c:.10g} m"


def _globe_of_radii(body: str | None, radii_m: tuple[float, ...]) -> Globe:
    from rasterio.crs import CRS

    if not (len(radii_m) in (1, 2) and all(math.isfinite(r) and r > 0 for r in radii_m) and radii_m[-1] <= radii_m[0]):
        raise InputError(
            f"radii {' '.join(map(str, radii_m))}: give one of a sphere, or the equatorial and a polar one that is not "
            "larger [m]; PROJ has no maps of other shapes (take the mean radius)"
        )
    a, c = radii_m[0], radii_m[-1]
    flattening = 0.0 if a == c else a / (a - c)
    name = quoted(f"{(body or 'body').title()}, {_shape(a, c)}")
    crs = CRS.from_wkt(
        f'GEOGCS["{name}",DATUM["{name}",SPHEROID["{name}",{a!r},{flattening!r}]],PRIMEM["Reference Meridian",0],'
        'UNIT["degree",0.0174532925199433]]'
    )
    return Globe(name=name, radii_m=(a, c), crs=crs)


def _ellipsoid_below(node: Any) -> tuple[float, float] | None:
    """Semi-axes of the first ellipsoid in a node of PROJJSON or below it."""
    for key, value in node.items() if isinstance(node, dict) else ():
        if key == "ellipsoid":
            if "radius" in value:
                return float(value["radius"]), float(value["radius"])
            a = float(value["semi_major_axis"])
            flattening = 1.0 / value["inverse_flattening"] if value.get("inverse_flattening") else 0.0
            return a, float(value.get("semi_minor_axis", a * (1.0 - flattening)))
        found = _ellipsoid_below(value)
        if found is not None:
            return found
    return None
