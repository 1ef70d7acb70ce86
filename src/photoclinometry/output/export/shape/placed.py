"""A shape model in metres, with what its products share: coarser levels, gravity, mass properties, reference sphere."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from photoclinometry.io.rasters.globe import Globe, find_globe
from photoclinometry.io.spice_dsk import DskPlace, known_to_spice
from photoclinometry.model.errors import InputError
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.export.shape.levels import Level, levels_of
from photoclinometry.output.export.shape.options import ShapeOptions
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.surface.closed_mesh import is_watertight, signed_volume, unique_edges, vertex_normals
from photoclinometry.surface.decimate import decimate
from photoclinometry.surface.mass_properties import (
    DEFAULT_CORRELATION,
    MassProperties,
    mean_radius,
    properties_by_length,
)
from photoclinometry.surface.polyhedron_gravity import GRAVITATIONAL_CONSTANT, Polyhedron
from photoclinometry.surface.radial_rays import RadialRays, is_star_shaped
from photoclinometry.surface.surface_gravity import GroundGravity, carried, ground_gravity, spin_rate


@dataclass(frozen=True)
class PlacedShape:
    """A closed, body-fixed model, in metres unless its unit is unknown. What takes time is made when asked for."""

    shape: ShapeModel
    """With normals at all vertices."""
    name: str
    options: ShapeOptions
    body: str | None
    radii_m: tuple[float, ...] | None
    resolution: float | None
    """Width of a map's pixel [m]."""

    @cached_property
    def levels(self) -> list[Level]:
        """The model, last, and coarser ones."""
        return levels_of(self.shape)

    @cached_property
    def rays(self) -> RadialRays:
        return RadialRays(self.shape.vertices, self.shape.faces)

    @cached_property
    def star_shaped(self) -> bool:
        """Whether each direction from the origin meets the surface once."""
        return is_star_shaped(self.shape.vertices, self.shape.faces)

    @cached_property
    def holds_origin(self) -> bool:
        """Whether the origin is inside: the faces then fill the whole sphere of directions."""
        body = Polyhedron(self.shape.vertices, self.shape.faces, 1.0 / GRAVITATIONAL_CONSTANT)
        return bool(body.field(np.zeros((1, 3)))[2][0] < -2.0 * math.pi)

    @cached_property
    def edge(self) -> float:
        """Mean length of an edge."""
        edges = unique_edges(self.shape.faces)[0]
        return float(np.linalg.norm(np.subtract(*self.shape.vertices[edges.T]), axis=1).mean())

    @cached_property
    def mean_radius(self) -> float:
        """Of the sphere of the same volume."""
        return mean_radius(signed_volume(self.shape.vertices, self.shape.faces))

    @cached_property
    def correlation(self) -> float:
        """Correlation length of height errors."""
        given = self.options.correlation_m
        return DEFAULT_CORRELATION * self.mean_radius if given is None else given

    def properties(self, correlation_lengths: Sequence[float]) -> list[MassProperties]:
        """Mass properties, with the standard deviations of each correlation length."""
        return properties_by_length(
            self.shape.vertices,
            self.shape.faces,
            correlation_lengths,
            normals=self.shape.normals,
            sigma_height=self.shape.sigma.get("height"),
        )

    @cached_property
    def spin(self) -> float:
        """[rad/s]."""
        return spin_rate(self.options.spin_period_h)

    @cached_property
    def gravity(self) -> GroundGravity | None:
        """At the model's vertices; None without a density."""
        density, shape = self.options.density_kg_m3, self.shape
        if density is None:
            return None
        vertices, faces = decimate(shape.vertices, shape.faces, self.options.gravity_facets)
        mass = density * signed_volume(shape.vertices, shape.faces)
        body = Polyhedron(vertices, faces, mass / signed_volume(vertices, faces))
        face, weight = MeshSurface(vertices, faces, closed=True).weights(shape.vertices)
        return carried(ground_gravity(body, self.spin), body, shape.vertices, face, weight)

    @property
    def dsk_place(self) -> DskPlace:
        """The body and the frame of SPICE's shape kernel, as they are given."""
        about = self.options
        body = about.naif_id if about.naif_id is not None else str(self.body)
        return DskPlace(body=body, frame=about.frame, surface=about.surface_id, kernels=about.kernels)

    @cached_property
    def unknown_to_spice(self) -> str | None:
        """Why SPICE cannot take the model; None: it can, or it is not installed."""
        if importlib.util.find_spec("spiceypy") is None:
            return None
        if self.body is None and self.options.naif_id is None:
            return "SPICE needs to know which body it is; give --body or --naif-id"
        try:
            known_to_spice(self.dsk_place)
        except InputError as error:
            return str(error)
        return None

    @cached_property
    def globe(self) -> Globe:
        """The reference sphere or spheroid: as given, or the IAU's, or the sphere of the model's volume.

        Raises InputError without rasterio.
        """
        try:
            return find_globe(self.body, self.radii_m)
        except InputError:
            if self.radii_m is not None:
                raise
            radius = float(f"{self.mean_radius:.4g}")
            return find_globe(self.body or "body", (radius,))


def placed_shape(
    shape: ShapeModel,
    name: str,
    options: ShapeOptions,
    *,
    where: str,
    body: str | None = None,
    radii_m: tuple[float, ...] | None = None,
    resolution: float | None = None,
) -> PlacedShape:
    """where: where it was read, for errors. Raises InputError for a model that is not closed, or looks inwards."""
    shape = shape.with_used_vertices()
    vertices, faces = shape.vertices, np.ascontiguousarray(shape.faces, np.int32)
    if len(faces) == 0 or not is_watertight(faces):
        raise InputError(f"{where}: is not a closed mesh whose faces all look the same way; close its holes first")
    if signed_volume(vertices, faces) <= 0:
        raise InputError(f"{where}: its faces look inwards; turn them round")
    normals = vertex_normals(vertices, faces) if shape.normals is None else shape.normals
    known = np.isfinite(normals).all(-1, keepdims=True)
    normals = np.where(known, normals, vertex_normals(vertices, faces))
    whole = ShapeModel(vertices, faces, normals, shape.albedo, shape.sigma, shape.views, shape.tile, shape.unit)
    return PlacedShape(whole, name, options, body, radii_m, resolution)
