"""GeoTIFF maps of a scene: heights, albedo, normals, slope, reflectance, and their standard deviations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from photoclinometry.evaluate.unreliable import albedo_is_known, normal_is_known, only_known
from photoclinometry.io.rasters.cog import Band, RasterPlace, write_cog
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.model.scene import Scene
from photoclinometry.model.sigma import sigma_along, sigma_of_length
from photoclinometry.output.export.corrected import corrected_reflectance
from photoclinometry.output.export.frame import Framed
from photoclinometry.output.export.grid import MapGrid, grid_around, resample, resample_heights
from photoclinometry.output.export.plane import Plane, map_plane
from photoclinometry.photometry.render import by_splines, cell_coordinates

if TYPE_CHECKING:
    from photoclinometry.output.export.options import ExportOptions


@dataclass(frozen=True, kw_only=True)
class Map:
    """The content of one file."""

    name: str
    """Name of the file, without suffix."""
    bands: tuple[Band, ...]
    values: np.ndarray
    """(h, w, n), NaN where there is no ground."""
    about: str
    """Description for people."""


def write_maps(folder: Path, framed: Framed, products: Sequence[str], options: ExportOptions) -> dict[str, str]:
    """Writes the maps as `folder`/NAME.tif; returns descriptions by file name. Raises InputError and RunFolderError."""
    plane = map_plane(framed, options)
    pixel = _three_digits(framed.scene.spacing) if options.resolution is None else options.resolution
    grid = grid_around(plane.place[:, :2], pixel)
    about = {"SCENE": framed.scene.name, "FRAME": framed.words, "MAP": plane.name}
    files = {}
    for drawn in draw_maps(framed, plane, grid, products, options):
        write_cog(
            folder / f"{drawn.name}.tif",
            drawn.values,
            np.asarray(np.isfinite(drawn.values).all(-1)),
            drawn.bands,
            place=RasterPlace(corner=grid.corner, pixel=grid.pixel, crs=plane.crs),
            about=about | {"PRODUCT": drawn.about},
        )
        unit_name = framed.unit or "the scene's unit"
        files[f"{drawn.name}.tif"] = f"{drawn.about}; {plane.name}; pixels of {grid.pixel:g} {unit_name}"
    return files


def draw_maps(
    framed: Framed, plane: Plane, grid: MapGrid, products: Sequence[str], options: ExportOptions
) -> list[Map]:
    """The maps on a grid, NaN where there is no ground, and where nothing determines a normal or an albedo.

    Between landmarks, normals, albedos and reflectances are those of cubic splines (as of `render.draw_smoothly`),
    standard deviations those on triangles.
    """
    scene = framed.scene
    faces = landmark_faces(scene)
    if not len(faces):
        raise InputError(f"scene {scene.name!r}: its landmarks form no surface to map; leave the maps out")

    def drawn(values: np.ndarray) -> np.ndarray:
        image, valid = resample(grid, plane.place, values.reshape(len(values), -1), faces)
        image[~valid] = np.nan
        return image

    def smooth(values: np.ndarray) -> np.ndarray:
        both = drawn(np.column_stack([values, cell_coordinates(scene)]))
        image, cell = both[..., :-2], both[..., -2:]
        known = np.isfinite(image).all(-1)
        image[known] = np.stack([by_splines(scene, component, cell[known]) for component in values.T], -1)
        return image

    maps = []
    if "dtm" in products:
        above = f"above a {framed.globe.shape}" if framed.globe else "above the map's mean plane"
        height, valid = resample_heights(grid, plane.place, plane.gradient, faces)
        maps.append(_single("dtm", framed.unit, f"height {above}", np.where(valid, height, np.nan)[..., None]))
    if {"normals", "slope"} & set(products):
        axes = ("east", "north", "up") if framed.globe else ("x", "y", "up")
        normal = unit(smooth(only_known(scene.landmarks.normal, normal_is_known(scene))))
        maps += _orientation(normal, unit(drawn(plane.up)), plane.north, axes, products)
    for name, unit_name, about, values in _light(scene, products, options):
        maps.append(_single(name, unit_name, about, np.maximum(smooth(values[:, None]), 0.0)))
    for name, unit_name, about, values in _sigmas(framed, plane.up) if "sigma" in products else []:
        maps.append(_single(name, unit_name, about, drawn(values)))
    return maps


Layer = tuple[str, str, str, np.ndarray]
"""Name, unit, meaning, and a value (J,) for every landmark."""


def _light(scene: Scene, products: Sequence[str], options: ExportOptions) -> list[Layer]:
    absolute, found = scene.brightness == "iof", []
    if "albedo" in products:
        known = only_known(scene.landmarks.albedo, albedo_is_known(scene))
        found.append(("albedo", "", "normal albedo" if absolute else "relative albedo", known))
    if "reflectance" in products:
        angles = "incidence {:g}, emission {:g}, phase {:g} degrees".format(*options.standard_geometry_deg)
        about = f"measured {'I/F' if absolute else 'relative brightness'} reduced to {angles}"
        reflectance = corrected_reflectance(scene, options.standard_geometry_deg)
        found.append(("reflectance", "", about, only_known(reflectance, normal_is_known(scene))))
    return found


def _sigmas(framed: Framed, up: np.ndarray) -> list[Layer]:
    scene, stated, found = framed.scene, framed.scene.uncertainty, []
    if "position" in stated:
        about = "standard deviation of the height"
        found.append(("sigma_height", framed.unit, about, sigma_along(stated["position"], up)))
    if "normal" in stated:
        about = "standard deviation of the angle between the normal and the true one"
        sigma = np.degrees(sigma_of_length(stated["normal"], 2))
        found.append(("sigma_normal", "degree", about, only_known(sigma, normal_is_known(scene))))
    if "albedo" in stated:
        sigma = only_known(sigma_of_length(stated["albedo"], 1), albedo_is_known(scene))
        found.append(("sigma_albedo", "", "standard deviation of the albedo", sigma))
    if "albedo_relative" in stated:
        about = "standard deviation of the albedo after the factor that the whole map has in common"
        found.append(
            ("sigma_albedo_relative", "", about, only_known(stated["albedo_relative"], albedo_is_known(scene)))
        )
    return found


def _orientation(
    normal: np.ndarray, up: np.ndarray, north: np.ndarray, axes: Sequence[str], products: Sequence[str]
) -> list[Map]:
    """Maps of normals and slopes from normals and verticals (h, w, 3), NaN in gaps, and where a normal does not point
    upwards. axes: names of the components."""
    east = unit(np.cross(north, up))
    parts = np.stack([np.sum(normal * axis, -1) for axis in (east, np.cross(up, east), up)], -1)
    parts = np.where(parts[..., 2:] > 0.0, parts, np.nan)
    maps = []
    if "normals" in products:
        bands = tuple(Band(description=f"normal, {axis}", unit="") for axis in axes)
        maps.append(Map(name="normals", bands=bands, values=parts, about=f"unit normals: {', '.join(axes)}"))
    if "slope" in products:
        slope = np.degrees(np.arctan2(np.hypot(parts[..., 0], parts[..., 1]), parts[..., 2]))[..., None]
        maps.append(_single("slope", "degree", "slope: angle of the normals to the map's vertical", slope))
    return maps


def _single(name: str, unit_name: str, about: str, values: np.ndarray) -> Map:
    return Map(name=name, bands=(Band(description=about, unit=unit_name),), values=values, about=about)


def _three_digits(value: float) -> float:
    """Rounded to three significant digits."""
    return round(value, 2 - math.floor(math.log10(value)))
