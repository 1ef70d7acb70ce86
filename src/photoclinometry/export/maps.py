"""GeoTIFF maps of a scene: heights, albedo, normals, slope, reflectance, and their standard deviations."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.errors import InputError
from photoclinometry.export.corrected import corrected_reflectance
from photoclinometry.export.frame import Framed
from photoclinometry.export.grid import MapGrid, grid_around, resample, resample_heights
from photoclinometry.export.options import ExportOptions, MapProduct
from photoclinometry.export.sigma import sigma_along, sigma_mean
from photoclinometry.geometry import tangent_basis, unit
from photoclinometry.io.cog import Band, write_cog
from photoclinometry.io.globe import geographic, name_of, need_rasterio
from photoclinometry.io.projection import local_crs, site_projection
from photoclinometry.relief import local_frame
from photoclinometry.render import landmark_faces

_STEEPEST_DEG = 70.0
"""Normals that lean more do not bend heights between landmarks any further."""


@dataclass(frozen=True, kw_only=True)
class Plane:
    """The plane of a map, and where the landmarks are on it."""

    crs: Any
    """rasterio's CRS; None where the unit of length is not known."""
    name: str
    place: np.ndarray
    """(J, 3) x, y and height in the map's unit."""
    gradient: np.ndarray
    """(J, 2) of the height by x and y, from the normals."""
    up: np.ndarray
    """(J, 3) unit vectors, in the frame of the scene."""
    north: np.ndarray
    """(3,) the direction that a map's north is the horizontal part of: the pole's, or a local map's y."""


@dataclass(frozen=True, kw_only=True)
class Map:
    """One file's content."""

    name: str
    """Of the file, without suffix."""
    bands: tuple[Band, ...]
    values: np.ndarray
    """(h, w, n)."""
    about: str


def map_plane(framed: Framed, options: ExportOptions) -> Plane:
    """A map of the body, or the mean plane of a scene in its own frame. Raises InputError."""
    need_rasterio()
    position, step = framed.scene.landmarks.position, 0.01 * framed.scene.gsd
    if framed.globe is not None:
        drawn = site_projection(framed.globe, options.projection or "equirectangular", position, options.center_deg)
        lon, lat, _ = np.radians(geographic(framed.globe, position)).T
        up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
        pole = np.array([0.0, 0.0, 1.0])
        return Plane(
            crs=drawn.crs,
            name=name_of(drawn.crs),
            place=drawn.from_body(position),
            gradient=height_gradient(drawn.from_body, position, framed.scene.landmarks.normal, step),
            up=up,
            north=pole,
        )
    body_from_local = local_frame(framed.scene)
    name = f"{framed.scene.name}: local plane, y is up in the reference image, not north"
    return Plane(
        crs=local_crs(name) if framed.metric else None,
        name=name,
        place=body_from_local.inverse()(position),
        gradient=height_gradient(body_from_local.inverse(), position, framed.scene.landmarks.normal, step),
        up=np.broadcast_to(body_from_local.rotation[:, 2], position.shape),
        north=body_from_local.rotation[:, 1],
    )


def height_gradient(
    place_of: Callable[[np.ndarray], np.ndarray], position: np.ndarray, normal: np.ndarray, step: float
) -> np.ndarray:
    """(J, 2) derivatives of the height by x and y on a map, of ground through points (J, 3) with normals (J, 3).

    place_of: map coordinates and height of points (n, 3); step: a length small against the relief. Not steeper than
    _STEEPEST_DEG; zero where the ground is upright.
    """
    tangent, here = tangent_basis(normal), place_of(position)
    (x1, y1, z1), (x2, y2, z2) = ((place_of(position + step * tangent[..., i]) - here).T for i in range(2))
    area = x1 * y2 - x2 * y1
    upright = np.abs(area) < 1e-9 * np.abs(area).max()
    rise = np.stack([z1 * y2 - z2 * y1, x1 * z2 - x2 * z1], -1)
    gradient = np.where(upright[:, None], 0.0, rise / np.where(upright, 1.0, area)[:, None])
    steepness = np.linalg.norm(gradient, axis=-1, keepdims=True)
    return gradient * np.minimum(1.0, math.tan(math.radians(_STEEPEST_DEG)) / np.maximum(steepness, 1e-300))


def possible_maps(framed: Framed) -> tuple[MapProduct, ...]:
    """The maps that the scene has something for."""
    shape: tuple[MapProduct, ...] = ("dtm", "normals", "slope")
    light: tuple[MapProduct, ...] = ("albedo", "reflectance") if framed.scene.reflectance is not None else ()
    stated = {"position", "normal", "albedo"} & set(framed.scene.uncertainty)
    return (*shape, *light, "sigma") if stated else (*shape, *light)


def write_maps(folder: Path, framed: Framed, products: Sequence[MapProduct], options: ExportOptions) -> dict[str, str]:
    """The maps as `folder`/NAME.tif; what is in each, by file name. Raises InputError and RunFolderError."""
    plane = map_plane(framed, options)
    pixel = options.resolution or _three_digits(framed.scene.gsd)
    grid = grid_around(plane.place[:, :2], pixel)
    about = {"SCENE": framed.scene.name, "FRAME": framed.words, "MAP": plane.name}
    files = {}
    for drawn in draw_maps(framed, plane, grid, products, options):
        write_cog(
            folder / f"{drawn.name}.tif",
            drawn.values,
            np.asarray(np.isfinite(drawn.values).all(-1)),
            drawn.bands,
            corner=grid.corner,
            pixel=grid.pixel,
            crs=plane.crs,
            about=about | {"PRODUCT": drawn.about},
        )
        unit_name = framed.unit or "the scene's unit"
        files[f"{drawn.name}.tif"] = f"{drawn.about}; {plane.name}; pixels of {grid.pixel:g} {unit_name}"
    return files


def draw_maps(
    framed: Framed, plane: Plane, grid: MapGrid, products: Sequence[MapProduct], options: ExportOptions
) -> list[Map]:
    """The maps on a grid, NaN where there is no ground."""
    scene = framed.scene
    faces = landmark_faces(scene)
    if not len(faces):
        raise InputError(f"scene {scene.name!r}: its landmarks form no surface to map; leave the maps out")

    def drawn(values: np.ndarray) -> np.ndarray:
        image, valid = resample(grid, plane.place, values.reshape(len(values), -1), faces)
        image[~valid] = np.nan
        return image

    maps = []
    if "dtm" in products:
        above = f"above a {framed.globe.shape}" if framed.globe else "above the map's mean plane"
        bands = (Band(description="height", unit=framed.unit),)
        height, valid = resample_heights(grid, plane.place, plane.gradient, faces)
        values = np.where(valid, height, np.nan)[..., None]
        maps.append(Map(name="dtm", bands=bands, values=values, about=f"height {above}"))
    if {"normals", "slope"} & set(products):
        both = drawn(np.concatenate([scene.landmarks.normal, plane.up], -1))
        maps += _orientation(unit(both[..., :3]), unit(both[..., 3:]), plane.north, products)
    if "albedo" in products:
        what = "normal albedo" if scene.brightness == "iof" else "relative albedo"
        values = drawn(scene.landmarks.albedo)
        maps.append(Map(name="albedo", bands=(Band(description=what, unit=""),), values=values, about=what))
    if "reflectance" in products:
        values = drawn(corrected_reflectance(scene, options.standard_geometry_deg))
        angles = "incidence {:g}, emission {:g}, phase {:g} degrees".format(*options.standard_geometry_deg)
        what = f"measured {'I/F' if scene.brightness == 'iof' else 'relative brightness'} reduced to {angles}"
        maps.append(Map(name="reflectance", bands=(Band(description=what, unit=""),), values=values, about=what))
    if "sigma" in products:
        maps += [
            Map(name=name, bands=(Band(description=about, unit=unit_name),), values=drawn(values), about=about)
            for name, unit_name, about, values in sigmas(framed, plane.up)
        ]
    return maps


def sigmas(framed: Framed, up: np.ndarray) -> list[tuple[str, str, str, np.ndarray]]:
    """Name, unit, meaning and values (J,) of the landmarks' standard deviations. up: (J, 3)."""
    stated, found = framed.scene.uncertainty, []
    if "position" in stated:
        about = "standard deviation of the height"
        found.append(("sigma_height", framed.unit, about, sigma_along(stated["position"], up)))
    if "normal" in stated:
        about = "standard deviation of the normal about each axis"
        found.append(("sigma_normal", "degree", about, np.degrees(sigma_mean(stated["normal"], 2))))
    if "albedo" in stated:
        found.append(("sigma_albedo", "", "standard deviation of the albedo", sigma_mean(stated["albedo"], 1)))
    return found


def _orientation(normal: np.ndarray, up: np.ndarray, north: np.ndarray, products: Sequence[MapProduct]) -> list[Map]:
    """Maps of normals and slopes from normals and verticals (h, w, 3), NaN where there is none."""
    east = unit(np.cross(north, up))
    parts = np.stack([np.sum(normal * axis, -1) for axis in (east, np.cross(up, east), up)], -1)
    maps = []
    if "normals" in products:
        bands = tuple(Band(description=f"normal, {axis}", unit="") for axis in ("east", "north", "up"))
        maps.append(Map(name="normals", bands=bands, values=parts, about="unit normals: east, north, up of the map"))
    if "slope" in products:
        slope = np.degrees(np.arctan2(np.hypot(parts[..., 0], parts[..., 1]), parts[..., 2]))[..., None]
        bands = (Band(description="slope", unit="degree"),)
        maps.append(Map(name="slope", bands=bands, values=slope, about="angle of the normals to the map's vertical"))
    return maps


def _three_digits(value: float) -> float:
    """Rounded to three significant digits."""
    return round(value, 2 - math.floor(math.log10(value)))
