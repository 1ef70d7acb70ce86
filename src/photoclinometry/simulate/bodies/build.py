"""A body's surface: a smooth shape, refined to even triangles, with fractal relief, craters, boulders and albedo."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.ground import Mesh, read_ground
from photoclinometry.model.errors import InputError
from photoclinometry.simulate import albedo
from photoclinometry.simulate.bodies.landforms import (
    VertexGrid,
    add_boulders,
    add_craters,
    boulder_population,
    crater_population,
)
from photoclinometry.simulate.bodies.noise import fractal_noise
from photoclinometry.simulate.bodies.presets import BodyPreset, Relief
from photoclinometry.simulate.bodies.shapes import mesh_of, onto
from photoclinometry.simulate.bodies.surface import BodySurface
from photoclinometry.simulate.features import smooth_step
from photoclinometry.surface.closed_mesh import (
    Place,
    centroid,
    is_watertight,
    refine,
    signed_volume,
    surface_area,
    unique_edges,
    vertex_areas,
    vertex_normals,
)

_COARSE = 0.06
"""Edges of the mesh that a shape is measured on [radii]."""
_SMALLEST_CRATER, _SMALLEST_BOULDER = 5.0, 2.5
"""Diameters [vertex spacings]; smaller ones would be single vertices."""
_SHORTEST_WAVE = 2.0
"""Shortest wavelength of the fractal relief [vertex spacings]."""
_HURST = 0.85
"""Exponent of the fractal relief: amplitudes fall as wavelength^hurst."""
_ADDED_FACETS = 3.0
"""Longest wavelength and largest crater added to a given mesh [its median edges], which keep its shape."""
_LARGEST_MESH = 12e6
"""Vertices that a simulation may need; more take over 6 GB."""


@dataclass(frozen=True)
class SmoothShape:
    """A closed shape before relief, in metres."""

    vertices: np.ndarray
    """(V, 3)."""
    faces: np.ndarray
    """(F, 3), outwards."""
    place: Place | None
    """Moves points onto the shape; None for a mesh from a file."""
    longest: float
    """Longest wavelength of the relief that is added [m]."""
    largest_crater: float
    """[m]."""

    @property
    def reach(self) -> float:
        """Greatest distance of the surface from the origin [m]."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


def preset_shape(preset: BodyPreset) -> SmoothShape:
    """The shape of a preset about its centre of mass."""
    on_shape = onto(preset.shape)
    vertices, faces = refine(*mesh_of(preset.shape), _COARSE, on_shape)
    middle = centroid(vertices, faces)
    scale = preset.radius / math.cbrt(0.75 / math.pi * signed_volume(vertices, faces))
    return SmoothShape(
        scale * (vertices - middle),
        faces,
        _scaled(on_shape, scale, middle),
        preset.relief.longest * preset.radius,
        preset.relief.largest_crater * preset.radius,
    )


def _scaled(place: Place, scale: float, middle: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda points: scale * (place(points / scale + middle) - middle)


def given_shape(path: Path, unit_scale: float) -> SmoothShape:
    """The closed mesh of a file in its own axes and origin; unit_scale: metres per unit. Raises InputError."""
    mesh = read_ground(path)
    if not isinstance(mesh, Mesh):
        raise InputError(f"{path}: is a map; --shape takes a closed mesh (OBJ, PLY), --surface takes maps")
    vertices, index = np.unique(unit_scale * mesh.vertices, axis=0, return_inverse=True)
    faces = index.ravel()[mesh.faces].astype(np.int32)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3).astype(np.int32)
    if len(faces) == 0 or not is_watertight(faces):
        raise InputError(
            f"{path}: is not a closed mesh whose faces all look the same way; close its holes, or simulate a place "
            "on it with --surface"
        )
    volume = signed_volume(vertices, faces)
    if volume < 0:
        faces = faces[:, ::-1]
    _check_origin_inside(path, vertices, faces)
    edges = unique_edges(faces)[0]
    facet = float(np.median(np.linalg.norm(np.subtract(*(vertices[edges[:, k]] for k in (0, 1))), axis=1)))
    return SmoothShape(vertices, faces, None, _ADDED_FACETS * facet, _ADDED_FACETS * facet)


def _check_origin_inside(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Cameras look at the origin, so a body far away from it would be missed."""
    middle = centroid(vertices, faces)
    extent = float(np.linalg.norm(vertices - middle, axis=1).max())
    if np.linalg.norm(middle) > 0.5 * extent:
        raise InputError(
            f"{path}: its origin is {np.linalg.norm(middle):.4g} m from the middle of a body of {extent:.4g} m; move "
            "the origin of the coordinates into the body"
        )


def build_body(shape: SmoothShape, preset: BodyPreset, spacing: float, seed: int) -> BodySurface:
    """The surface with edges of `spacing` [m] in the mean; the same arguments give the same surface."""
    _check_size(shape, spacing)
    rng = np.random.default_rng([seed, 1])
    smooth, faces = refine(shape.vertices, shape.faces, spacing, shape.place)
    normals = vertex_normals(smooth, faces)
    height, log_albedo = _relief(rng, smooth, faces, normals, shape, preset.relief, spacing)
    vertices = (smooth + height[:, None] * normals).astype(np.float32).astype(np.float64)
    return BodySurface(
        vertices,
        faces,
        vertex_normals(vertices, faces).astype(np.float32).astype(np.float64),
        albedo.from_log(log_albedo, preset.mean_albedo).astype(np.float64),
        spacing,
    )


def _check_size(shape: SmoothShape, spacing: float) -> None:
    count = surface_area(shape.vertices, shape.faces) / (0.5 * math.sqrt(3.0) * spacing**2)
    if count > _LARGEST_MESH:
        raise InputError(
            f"relief at half of --gsd {2 * spacing:.4g} m takes {count:.2g} vertices, more than {_LARGEST_MESH:.2g}; "
            "choose a larger --gsd or a smaller --image-size"
        )


def _relief(
    rng: np.random.Generator,
    smooth: np.ndarray,
    faces: np.ndarray,
    normals: np.ndarray,
    shape: SmoothShape,
    relief: Relief,
    spacing: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Heights [m] along the normals, and log albedo (relative), (V,) both."""
    grid, area = VertexGrid(smooth, spacing), vertex_areas(smooth, faces)
    radius = math.sqrt(float(area.sum()) / (4.0 * math.pi))
    height = fractal_noise(smooth, rng, _HURST, shape.longest, _SHORTEST_WAVE * spacing)
    height *= math.tan(math.radians(relief.slope_deg)) / _rms_slope(height, smooth, faces)
    log_albedo = 0.10 * fractal_noise(smooth, rng, 0.6, radius, 4.0 * spacing)
    patches = fractal_noise(smooth, rng, 1.0, 0.5 * radius, 3.0 * spacing)
    log_albedo += relief.patches * (smooth_step(patches, 1.0, 1.2) - 0.7 * smooth_step(-patches, 1.1, 1.7))
    smallest = _SMALLEST_CRATER * spacing
    for freshest, share in ((0.2, 0.75), (0.0, 0.25)):
        craters = crater_population(
            rng,
            area,
            density=share * relief.crater_density,
            smallest=smallest,
            largest=max(shape.largest_crater, 2.0 * smallest),
            freshest=freshest,
            brightening=0.25,
        )
        add_craters(height, log_albedo, smooth, normals, grid, craters, relief.crater_depth)
    clustered = smooth_step(fractal_noise(smooth, rng, 0.7, 0.7 * radius, 20.0 * spacing), -1.0, 1.5) * 2.0
    boulders = boulder_population(
        rng,
        area * clustered,
        cover=relief.boulder_cover,
        smallest=_SMALLEST_BOULDER * spacing,
        largest=max(min(relief.largest_boulder * radius, shape.largest_crater), 2.0 * _SMALLEST_BOULDER * spacing),
    )
    add_boulders(height, log_albedo, smooth, normals, grid, boulders)
    return height, log_albedo


def _rms_slope(height: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> float:
    """Root mean square slope [-] along the first edges of the faces."""
    a, b = faces[:, 0], faces[:, 1]
    return float(np.sqrt(np.mean(((height[a] - height[b]) / np.linalg.norm(vertices[a] - vertices[b], axis=1)) ** 2)))
