"""Figures of a found closed mesh against the truth of a simulated body.

Distances are in ground sample distances of the truth's finest images (GSD). Points of the mesh are its vertices and the
middles of its faces, those of the truth the middles of its triangles, thinned at random. Points count equally, so
meshes should be even.
"""

from __future__ import annotations

import numpy as np

from photoclinometry.evaluate.metrics import calibration, spread
from photoclinometry.evaluate.sigma_calibration import tangent_error
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, angle_between, unit
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.registration.alignment import align_poses, refine_on_surface
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.simulate.bodies.truth import BodyTruth, views_of_triangles
from photoclinometry.surface.closed_mesh import signed_volume, surface_area, vertex_normals

FEWEST_VIEWS = 3
"""Views that must see ground lit for it to be expected in a mesh."""
LARGEST_EMISSION_DEG = 60.0
"""Views at larger emission angles do not count."""
FOUND_WITHIN_GSD = 1.0
"""Largest distance of the mesh from ground that counts as found."""
_SAMPLES = 40_000
"""Number of triangles of the truth and of points of the mesh that are used: figures are good to a per cent."""
PIXEL_SIGMA_PX = 1.0 / np.sqrt(12.0)
"""Standard deviation of a pixel's area along each axis [px]."""
_NEAREST_WEIGHT = 1e-6
"""Least weight of the nearest vertex in such a mean, so that the mean exists where no vertex is in reach."""
_REACH = 3.0
"""Largest distance of vertices that enter a mean, in standard deviations of its Gaussian."""


def align_body(
    found: ShapeModel, truth: BodyTruth, body_from_cam: Rigid | None = None, names: tuple[str, ...] | None = None
) -> Similarity:
    """truth_from_found, with scale: aligned by camera poses, where they are given, then by the surface.

    body_from_cam: (K,) poses in the frame of `found`; names: (K,) of their views. Without poses the mesh must be near
    its place. Raises InputError for unknown names, and where poses or surfaces do not determine the frame.
    """
    start = Similarity(1.0, np.eye(3), np.zeros(3))
    if body_from_cam is not None:
        if names is None or len(names) != len(body_from_cam):
            raise InputError("poses need the name of a view each")
        index = [truth.view_index(name) for name in names]
        middle = np.mean(found.vertices, axis=0)
        distance = float(np.median(np.linalg.norm(body_from_cam.translation - middle, axis=1)))
        start = align_poses(body_from_cam, truth.views.body_from_cam[index], distance)
    surface = truth.surface
    closest = MeshSurface(surface.vertices, surface.faces, closed=True)
    return refine_on_surface(np.asarray(found.vertices, float), normals_of(found), closest, start).similarity


def compare_body(
    found: ShapeModel, truth: BodyTruth, *, mean_over_gsd: float | None = None, seed: int = 0
) -> dict[str, float]:
    """Figures of a mesh in the truth's frame, by name; see `align_body`. Figures that do not exist are left out.

    `distance_..._gsd` from the mesh to the truth, `distance_back_..._gsd` from the well seen truth to the mesh;
    `completeness_percent`: share of the truth's well seen area that has the mesh within 1 GSD; `seen_percent`: share of
    the whole area that is well seen (FEWEST_VIEWS, LARGEST_EMISSION_DEG); `normal_..._deg` and `albedo_..._percent` at
    the mesh's vertices within 1 GSD of well seen truth, albedos after their common factor; `..._sigma_...`: the same
    errors, and those of heights, over the mesh's standard deviations (`metrics.calibration`); `volume_percent`: how
    much the mesh is too large. mean_over_gsd: standard deviation of the Gaussian that the truth's normals, albedos and
    heights are averaged with; left out, that of the finest images' pixels and point-spread function (`resolution_gsd`).
    0 compares with the truth's vertices. seed: of the samples. Raises InputError for meshes without faces.
    """
    if len(found.faces) == 0 or not np.isfinite(found.vertices).all():
        raise InputError("the mesh to compare has no faces, or vertices that are not finite")
    found = found.with_used_vertices()
    vertices, faces = found.vertices, found.faces
    rng, surface, gsd = np.random.default_rng(seed), truth.surface, truth.gsd
    truth_mesh, mesh = MeshSurface(surface.vertices, surface.faces, closed=True), MeshSurface(vertices, faces)
    points = _thinned(rng, np.concatenate([vertices, vertices[faces].mean(1)]))
    figures = spread(_distance(points, truth_mesh) / gsd, "distance", "gsd")

    chosen = _thinned(rng, np.arange(len(surface.faces)))
    corner = surface.vertices[surface.faces[chosen]]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    seen = views_of_triangles(truth, chosen, LARGEST_EMISSION_DEG) >= FEWEST_VIEWS
    back = _distance(corner.mean(1), mesh) / gsd
    figures |= spread(back[seen], "distance_back", "gsd")
    figures["seen_percent"] = float(100.0 * area[seen].sum() / area.sum())
    if seen.any():
        figures["completeness_percent"] = float(
            100.0 * area[seen & (back <= FOUND_WITHIN_GSD)].sum() / area[seen].sum()
        )
    width = resolution_gsd(truth) if mean_over_gsd is None else mean_over_gsd
    figures |= _at_vertices(rng, found, truth, truth_mesh, corner.mean(1)[seen], width)
    volume = signed_volume(surface.vertices, surface.faces)
    figures["volume_percent"] = float(100.0 * (signed_volume(vertices, faces) / volume - 1.0))
    return figures


def resolution_gsd(truth: BodyTruth) -> float:
    """Standard deviation of the area that one pixel of the finest images averages over [GSD], seen from above."""
    return float(np.hypot(truth.psf_sigma_px, PIXEL_SIGMA_PX))


def _at_vertices(
    rng: np.random.Generator,
    found: ShapeModel,
    truth: BodyTruth,
    truth_mesh: MeshSurface,
    seen: np.ndarray,
    mean_over_gsd: float,
) -> dict[str, float]:
    """Errors of normals and albedos at the mesh's vertices on the well seen ground around points (n, 3)."""
    from scipy.spatial import KDTree

    if len(seen) == 0:
        return {}
    chosen = _thinned(rng, np.arange(len(found.vertices)))
    at = found.vertices[chosen]
    foot, _ = truth_mesh(at)
    spacing = np.sqrt(surface_area(truth.surface.vertices, truth.surface.faces) / _SAMPLES)
    near = np.linalg.norm(foot - at, axis=1) <= FOUND_WITHIN_GSD * truth.gsd
    near &= KDTree(seen).query(foot)[0] <= max(truth.gsd, 1.5 * spacing)
    if not near.any():
        return {}
    rows = chosen[near]
    place, normal, albedo = mean_around(truth, truth_mesh, foot[near], mean_over_gsd * truth.gsd)
    own = normals_of(found)[rows]
    errors = {"height": np.sum((at[near] - place) * own, -1), "normal": tangent_error(own, normal)}
    figures = spread(np.degrees(angle_between(own, normal)), "normal", "deg")
    known = None if found.albedo is None else np.asarray(found.albedo, float)[rows] / albedo
    if known is not None and np.isfinite(known).any():
        errors["albedo"] = known / np.nanmedian(known) - 1.0
        ratio = known[np.isfinite(known)]  # where nothing was mapped no albedo is known
        figures |= spread(100.0 * (ratio / np.median(ratio) - 1.0), "albedo", "percent")
    for name, stated in found.sigma.items():
        if name in errors:
            sigma = np.asarray(stated, float)[rows] / (np.sqrt(2.0) if name == "normal" else 1.0)  # of each axis
            figures |= calibration(errors[name], sigma, f"{name}_sigma")
    return figures


def mean_around(
    truth: BodyTruth, truth_mesh: MeshSurface, points: np.ndarray, width: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The truth's place (n, 3), normal (n, 3) and albedo (n,) around points (n, 3) of its surface.

    Gaussian means of `width` [m].

    Ground that faces away from the nearest vertex takes no part, such as the other side of a thin edge.
    """
    surface = truth.surface
    area_of_vertex = surface_area(surface.vertices, surface.faces) / len(surface.vertices)
    within = np.pi * (_REACH * width) ** 2 / area_of_vertex
    distance, near = truth_mesh.tree.query(points, int(np.clip(np.ceil(within), 2, len(surface.vertices))))
    normals = surface.normals[near]
    weight = np.exp(-0.5 * (distance / width) ** 2) if width > 0 else np.zeros(distance.shape)
    weight[:, 0] = np.maximum(weight[:, 0], _NEAREST_WEIGHT)
    weight *= np.sum(normals * normals[:, :1], -1) > 0
    weight /= weight.sum(-1, keepdims=True)
    place = np.einsum("nk,nkd->nd", weight, surface.vertices[near])
    albedo = np.sum(weight * surface.albedo[near], -1)
    return place, unit(np.einsum("nk,nkd->nd", weight, normals)), albedo


def normals_of(shape: ShapeModel) -> np.ndarray:
    """(V, 3) outward unit normals: its own, or those of the faces."""
    return vertex_normals(np.asarray(shape.vertices, float), shape.faces) if shape.normals is None else shape.normals


def _distance(points: np.ndarray, mesh: MeshSurface) -> np.ndarray:
    return np.linalg.norm(points - mesh(points)[0], axis=1)


def _thinned(rng: np.random.Generator, rows: np.ndarray) -> np.ndarray:
    """At most _SAMPLES rows of an array, in their order."""
    if len(rows) <= _SAMPLES:
        return rows
    return rows[np.sort(rng.choice(len(rows), _SAMPLES, replace=False))]
