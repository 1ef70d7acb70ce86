"""FITS planes as the OSIRIS-REx Altimetry Working Group (AltWG) has them: a global grid, and a table of facets.

Names of planes, units and keywords are those of AltWG's tools, which APL published as Terrasaur (`PlaneInfo`,
`HeaderTag`): lengths in km but elevations in m, potentials negative, gravity with the centrifugal acceleration. Rows of
the grid go north, columns east from longitude 0; the planes of latitude and longitude give each pixel's place. Planes
that AltWG does not have are named "Sigma of ..." and "Number of images".
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry import __version__
from photoclinometry.io.fits_planes import Card, Plane, write_cube, write_table
from photoclinometry.model.geometry import KM_PER_M
from photoclinometry.output.export.shape.ground import SurfacePoints, facet_middles
from photoclinometry.output.export.shape.maps import pixel_width
from photoclinometry.output.export.shape.placed import PlacedShape
from photoclinometry.surface.closed_mesh import area_vectors

_MM_PER_M = 1e3
_MOST_ROWS = 1800
"""Of the grid: ten pixels a degree, 26 MB a plane."""


def write_planes(folder: Path, placed: PlacedShape, products: tuple[str, ...], options: Any) -> dict[str, str]:
    """Writes global.fits and facets.fits; returns descriptions by file name. Raises RunFolderError."""
    radius = placed.mean_radius
    rows = min(_MOST_ROWS, round(math.pi * radius / pixel_width(placed, radius)))
    latitude = -90.0 + (np.arange(rows) + 0.5) * 180.0 / rows
    longitude = (np.arange(2 * rows) + 0.5) * 180.0 / rows
    lon, lat = np.meshgrid(np.radians(longitude), np.radians(latitude))
    direction = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    found, face, weight = placed.rays.outermost(direction.reshape(-1, 3))
    met = np.isfinite(found)
    cube = []
    for plane in planes_of(SurfacePoints(placed, face[met], weight[met])):
        image = np.full(rows * 2 * rows, np.nan)
        image[met] = plane.values
        cube.append(Plane(plane.name, plane.unit, image.reshape(rows, 2 * rows)))
    step = math.radians(180.0 / rows) * radius
    write_cube(folder / "global.fits", cube, [*_about(placed, "global.fits", step), *_grid(latitude, longitude)])
    middles = facet_middles(placed)
    area = np.linalg.norm(area_vectors(placed.shape.vertices, placed.shape.faces), axis=1)
    columns = [
        Plane("Facet number", "", 1 + np.arange(len(area))),
        *planes_of(middles),
        Plane("Facet Area", "km^2", KM_PER_M**2 * area),
    ]
    write_table(folder / "facets.fits", columns, _about(placed, "facets.fits", placed.edge))
    return {
        "global.fits": f"{len(cube)} planes on a grid of {180.0 / rows:.4g} degrees, named as AltWG's",
        "facets.fits": f"table of {len(area):,} facets with the same quantities",
    }


def planes_of(ground: SurfacePoints) -> Iterator[Plane]:
    """The planes of points of the surface, in AltWG's order."""
    shape, gravity = ground.placed.shape, ground.gravity
    position, normal = KM_PER_M * ground.position, ground.normal
    radius = np.linalg.norm(position, axis=-1)
    yield Plane("Latitude of vertices", "deg", np.degrees(np.arcsin(position[:, 2] / radius)), True)
    yield Plane("Longitude of vertices", "deg", np.degrees(np.arctan2(position[:, 1], position[:, 0])) % 360.0, True)
    yield Plane("Radius of vertices", "km", radius, True)
    for k, axis in enumerate("XYZ"):
        yield Plane(f"{axis} coordinate of vertices", "km", position[:, k], True)
    for k, axis in enumerate("XYZ"):
        yield Plane(f"Normal vector {axis}", "", normal[:, k])
    if gravity is not None:
        for k, axis in enumerate("XYZ"):
            yield Plane(f"Gravity vector {axis}", "m/s^2", gravity.acceleration[:, k])
        yield Plane("Gravitational magnitude", "m/s^2", gravity.magnitude)
        yield Plane("Gravitational potential", "J/kg", gravity.potential)
        yield Plane("Elevation", "m", gravity.elevation)
        yield Plane("Slope", "deg", np.degrees(gravity.slope(normal)))
    yield Plane("Facet tilt", "deg", np.degrees(ground.tilt))
    if shape.albedo is not None:
        yield Plane("Relative albedo", "", ground.mean(shape.albedo))
    if "height" in shape.sigma:
        yield Plane("Sigma", "km", KM_PER_M * ground.mean(shape.sigma["height"]))
    if "normal" in shape.sigma:
        yield Plane("Sigma of normal", "deg", np.degrees(ground.mean(shape.sigma["normal"])))
    if "albedo" in shape.sigma and shape.albedo is not None:
        yield Plane("Sigma of albedo", "", ground.mean(shape.sigma["albedo"] * shape.albedo))
    if ground.views is not None:
        yield Plane("Number of images", "", ground.views)


def _about(placed: PlacedShape, file: str, spacing: float) -> list[Card]:
    """Keywords that both files have; spacing: between points [m]."""
    cards = [
        Card("TARGET", (placed.body or "unknown").upper(), "Target object"),
        Card("DATASRC", "PHOMO", "Shape model data source"),
        Card("DATASRCF", placed.name, "Source shape model data filename"),
        Card("SOFTWARE", "photoclinometry", "Software used to create map data"),
        Card("SOFT_VER", __version__, "Version of software used to create map data"),
        Card("PRODNAME", file, "Product filename"),
        Card("MAP_NAME", "shape model planes", "Map data type"),
        Card("MAP_TYPE", "global", "Defines whether this is a global or local map"),
        Card("GSD", _MM_PER_M * spacing, "[mm] grid spacing in units/pixel"),
    ]
    sigma = placed.shape.sigma.get("height")
    if sigma is not None and np.isfinite(sigma).any():
        cards.append(Card("SIGMA", float(np.sqrt(np.nanmean(sigma**2))), "Global uncertainty of the data [m]"))
        cards.append(Card("SIG_DEF", "RMS of standard deviations of height", "SIGMA uncertainty metric"))
    if placed.gravity is not None and placed.options.density_kg_m3 is not None:
        cards.append(Card("DENSITY", placed.options.density_kg_m3, "[kgm^-3] density of body"))
        cards.append(Card("ROT_RATE", placed.spin, "[rad/sec] rotation rate of body"))
        cards.append(Card("REF_POT", placed.gravity.reference, "[J/kg] reference potential of body"))
    return cards


def _grid(latitude: np.ndarray, longitude: np.ndarray) -> list[Card]:
    """Keywords of the grid, of the centres of its pixels [degrees]."""
    south, north = float(latitude[0]), float(latitude[-1])
    west, east = float(longitude[0]), float(longitude[-1])
    corners = {"LL": (south, west), "UL": (north, west), "UR": (north, east), "LR": (south, east)}
    return [
        Card("PROJECTN", "Equirectangular", "Simple cylindrical projection"),
        Card("CLON", 180.0, "[deg] longitude at center of image"),
        Card("CLAT", 0.0, "[deg] latitude at center of image"),
        Card("MINLON", west, "[deg] minimum longitude of global DTM"),
        Card("MAXLON", east, "[deg] maximum longitude of global DTM"),
        Card("MINLAT", south, "[deg] minimum latitude of global DTM"),
        Card("MAXLAT", north, "[deg] maximum latitude of global DTM"),
        Card("PXPERDEG", len(latitude) / 180.0, "[pixel per degree] grid spacing of global map."),
        *(Card(f"{name}CLAT", lat, "[deg]") for name, (lat, _) in corners.items()),
        *(Card(f"{name}CLNG", lon, "[deg]") for name, (_, lon) in corners.items()),
    ]
