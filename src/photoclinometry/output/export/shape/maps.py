"""GeoTIFFs of a whole body: an equidistant cylindrical map and two polar stereographic ones of each quantity.

A pixel shows the outermost ground in its direction from the origin. All maps are on a sphere, with planetocentric
latitudes and longitudes that count eastward.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.rasters.cog import Band, RasterPlace, write_cog
from photoclinometry.io.rasters.globe import geographic
from photoclinometry.io.rasters.projection import body_projections
from photoclinometry.model.errors import InputError
from photoclinometry.output.export.grid import MAX_PIXELS, MapGrid
from photoclinometry.output.export.shape.ground import SurfacePoints
from photoclinometry.output.export.shape.placed import PlacedShape

POLAR_LATITUDE_DEG = 60.0
"""Polar maps show ground from here to the pole. There the cylindrical map is stretched twice and more."""

Layer = tuple[str, str, str, np.ndarray]
"""Name, unit, meaning, and a value (n,) for every point."""


def write_body_maps(folder: Path, placed: PlacedShape, products: tuple[str, ...], options: Any) -> dict[str, str]:
    """Writes maps/QUANTITY_PROJECTION.tif; returns a description. Raises InputError and RunFolderError."""
    projections = body_projections(placed.globe)
    radius = placed.globe.radii_m[0]
    count = 0
    for name, grid in map_grids(radius, pixel_width(placed, radius)).items():
        projection = projections[name]
        direction, shown = directions(name, grid, radius)
        found, face, weight = placed.rays.outermost(direction[shown])
        met = np.isfinite(found)
        shown[shown] = met
        place = RasterPlace(corner=grid.corner, pixel=grid.pixel, crs=projection.crs)
        about = {"BODY": placed.name, "MAP": name, "GLOBE": placed.globe.shape}
        for quantity, unit, meaning, values in layers(SurfacePoints(placed, face[met], weight[met])):
            image = np.full(grid.shape, np.nan)
            image[shown] = values
            band = Band(description=meaning, unit=unit)
            write_cog(
                folder / "maps" / f"{quantity}_{name}.tif",
                image[..., None],
                np.isfinite(image),
                (band,),
                place=place,
                about=about | {"PRODUCT": meaning},
            )
            count += 1
    words = f"{count} GeoTIFFs: equidistant cylindrical, polar stereographic beyond latitude {POLAR_LATITUDE_DEG:g}"
    return {"maps": f"{words}; on a sphere of {radius:.10g} m, heights above a {placed.globe.shape}"}


def layers(ground: SurfacePoints) -> Iterator[Layer]:
    """The layers that the model and the options allow."""
    shape, gravity = ground.placed.shape, ground.gravity
    position = ground.position
    globe = ground.placed.globe
    yield "radius", "m", "distance from the origin", np.linalg.norm(position, axis=-1)
    yield "height", "m", f"height above a {globe.shape}", geographic(globe, position)[:, 2]
    yield "tilt", "degree", "angle between the normal and the direction from the origin", np.degrees(ground.tilt)
    if gravity is not None:
        yield "slope", "degree", "angle between the normal and the plumb line", np.degrees(gravity.slope(ground.normal))
        yield "elevation", "m", "height above the mean equipotential of the surface", gravity.elevation
        yield "gravity", "m/s2", "gravity with centrifugal acceleration", gravity.magnitude
    if shape.albedo is not None:
        yield "albedo", "", "albedo", ground.mean(shape.albedo)
    known = {
        "height": ("m", "standard deviation of the height", 1.0),
        "normal": ("degree", "standard deviation of the normal", 180.0 / math.pi),
        "albedo": ("percent", "standard deviation of the albedo, as a share of it", 100.0),
    }
    for name, (unit, meaning, factor) in known.items():
        if name in shape.sigma:
            yield f"sigma_{name}", unit, meaning, factor * ground.mean(shape.sigma[name])
    if ground.views is not None:
        yield "views", "", "number of images that measured the ground, 0 where it is a smooth guess", ground.views


def pixel_width(placed: PlacedShape, radius: float) -> float:
    """Width of a pixel [m]: as asked for, or about the mean edge of the model, so that 180 degrees are whole pixels."""
    finest = math.pi * radius * math.sqrt(2.0 / MAX_PIXELS)
    if placed.resolution is not None and placed.resolution < finest:
        raise InputError(
            f"--resolution {placed.resolution:g} m makes a map of more than {MAX_PIXELS:.2g} pixels of a body of "
            f"radius {radius:.4g} m; give {finest:.3g} m or more"
        )
    asked = placed.resolution or max(placed.edge, finest)
    return math.pi * radius / max(1, round(math.pi * radius / asked))


def map_grids(radius: float, pixel: float) -> dict[str, MapGrid]:
    """The pixels of the three maps, by the names of `body_projections`."""
    rows = round(math.pi * radius / pixel)
    half = math.ceil(polar_distance(radius, math.radians(POLAR_LATITUDE_DEG)) / pixel)
    polar = MapGrid(corner=(-half * pixel, half * pixel), pixel=pixel, shape=(2 * half, 2 * half))
    corner = (-math.pi * radius, 0.5 * math.pi * radius)
    cylindrical = MapGrid(corner=corner, pixel=pixel, shape=(rows, 2 * rows))
    return {"cylindrical": cylindrical, "north": polar, "south": polar}


def polar_distance(radius: float, latitude: float) -> float:
    """From the pole on a polar stereographic map, true to scale there, to a latitude [rad]."""
    return 2.0 * radius * math.tan(0.25 * math.pi - 0.5 * latitude)


def directions(name: str, grid: MapGrid, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (h, w, 3) of the pixels' centres, and (h, w) whether the map shows the place."""
    x, y = np.moveaxis(grid.pixel_centers(), -1, 0)
    if name == "cylindrical":
        longitude, latitude = x / radius, y / radius
    else:
        sign = 1.0 if name == "north" else -1.0
        longitude = np.arctan2(x, -sign * y)
        latitude = sign * (0.5 * math.pi - 2.0 * np.arctan2(np.hypot(x, y), 2.0 * radius))
    level = np.cos(latitude)
    vectors = np.stack([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)], -1)
    return vectors, np.abs(latitude) >= (0.0 if name == "cylindrical" else math.radians(POLAR_LATITUDE_DEG))
