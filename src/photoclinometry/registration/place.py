"""Places of a body by longitude and latitude, on the body's reference ellipsoid. No shape model is needed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photoclinometry.model.bodies import SEMI_AXES_M
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit


@dataclass(frozen=True, kw_only=True)
class Place:
    """A point of a body's reference ellipsoid."""

    lon_deg: float
    """Eastward, as it was given; NaN of a place that no ellipsoid has."""
    lat_deg: float
    """Planetocentric."""
    position: np.ndarray
    """(3,) in the body-fixed frame [m]."""
    normal: np.ndarray
    """(3,) unit vector, outwards, of the ellipsoid."""
    semi_axes_m: tuple[float, float, float]
    """Of the ellipsoid, along x, y, z; zero where none is known."""


def plane_at(point: np.ndarray, normal: np.ndarray) -> Place:
    """A point (3,) on a plane, of a body whose size is not known. Raises InputError for the zero vector as a normal."""
    if not np.any(normal):
        raise InputError("the normal of the plane is the zero vector; give one that points upwards")
    return Place(lon_deg=math.nan, lat_deg=math.nan, position=point, normal=unit(normal), semi_axes_m=(0.0, 0.0, 0.0))


def lon_lat_deg(point: np.ndarray) -> tuple[float, float]:
    """Longitude, eastward, from -180 to 180, and planetocentric latitude of a body-fixed point (3,) [degrees]."""
    x, y, z = point
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))


def place_at(lon_deg: float, lat_deg: float, semi_axes_m: tuple[float, float, float]) -> Place:
    """The point of an ellipsoid in a direction from its centre: longitude eastward, planetocentric latitude [degrees].

    Raises InputError for angles outside of [-360, 360] and [-90, 90].
    """
    if not (-360.0 <= lon_deg <= 360.0 and -90.0 <= lat_deg <= 90.0):
        raise InputError(
            f"{lon_deg:g} {lat_deg:g} is not a longitude and a latitude: give degrees eastward from -360 to 360, then "
            "degrees northward from -90 to 90"
        )
    lon, lat = math.radians(lon_deg), math.radians(lat_deg)
    direction = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    axes = np.array(semi_axes_m, float)
    position = direction / np.linalg.norm(direction / axes)
    return Place(
        lon_deg=lon_deg,
        lat_deg=lat_deg,
        position=position,
        normal=unit(position / axes**2),
        semi_axes_m=semi_axes_m,
    )


def semi_axes(body: str | None, radii_m: tuple[float, ...] | None = None) -> tuple[float, float, float]:
    """The semi-axes [m] of a body's reference ellipsoid, or of the sphere, spheroid or ellipsoid that `radii_m` gives.

    radii_m: one radius, the equatorial and the polar one, or three semi-axes. Raises InputError for other numbers, and
    for a body that SEMI_AXES_M does not have.
    """
    if radii_m is not None:
        if len(radii_m) not in (1, 2, 3) or not all(math.isfinite(r) and r > 0 for r in radii_m):
            raise InputError(
                f"radii {' '.join(f'{r:g}' for r in radii_m) or '(none)'}: give one of a sphere, the equatorial and "
                "the polar one, or three semi-axes, in metres above 0"
            )
        first, last = radii_m[0], radii_m[-1]
        return (first, radii_m[1] if len(radii_m) == 3 else first, last)
    found = SEMI_AXES_M.get((body or "").lower())
    if found is None:
        raise InputError(
            f"the size of body {body!r} is not known (known: {', '.join(SEMI_AXES_M)}); give its radius in metres "
            "(--radii-m)"
        )
    return found
