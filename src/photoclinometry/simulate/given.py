"""Ground from a file instead of a preset: a mesh or a terrain model, as heights over a tangent plane.

Frame B of the simulated site has its origin on the ground that the cameras look at, z along the mean normal around it,
and y as far north as possible: along the file's z axis, or along its y axis if the file's z is near B's.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photoclinometry.io.ground import Mesh, read_ground
from photoclinometry.io.rasters.geotiff import Dtm
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import METRES, Similarity, unit
from photoclinometry.model.sampling import filled_from_nearest
from photoclinometry.model.warning import warn
from photoclinometry.simulate.surface import sphere_drop
from photoclinometry.simulate.terrain import Grid
from photoclinometry.surface.closed_mesh import signed_volume
from photoclinometry.surface.rasterise import draw_triangles

log = logging.getLogger(__name__)

MAX_FACET_GSD = 3.0
"""Largest facets or pixels of given ground [ground samples]; larger ones would be visible in the images."""
_MAX_OVERLAP = 0.02
"""Largest share of ground that lies under other ground, such as overhanging boulders. The upper ground is used."""
_OVERLAP_GSD = 0.1
"""Difference of heights from which ground counts as lying under other ground [ground samples]."""
_LEAST_FACING = 0.3
"""Size of the sum of the faces' normals over the sum of their sizes: below this, ground faces all ways."""
_NEAR_ORIGIN = 0.25
"""An origin nearer to the site than this share of the mesh's extent is not the centre of a body."""
_DOWNWARD = -0.5
"""z of a normal that certainly points down."""
_HINT_GSD = 0.95
"""Share of the largest possible ground sample distance that an error suggests."""
_HINT_SHARE = 0.05
"""Ground that covers less than this share of the images is probably in kilometres."""


@dataclass(frozen=True)
class Relief:
    """Given ground on a grid of the tangent plane."""

    height: np.ndarray
    """(n, n) float32, z in B [m], curvature included."""
    albedo: np.ndarray | None
    """(n, n) float32 normal albedo; None if the file has none."""
    body_from_file: Similarity
    """From the file's coordinates to B; of a map, from (easting, northing, height) [m], without the curvature."""


def given_relief(path: Path, grid: Grid, gsd: float, unit_name: str, center: tuple[float, ...] | None) -> Relief:
    """The ground of a file over a grid that covers all views; gsd: the views' finest ground sample distance [m].

    unit_name: "m" or "km", the unit of a mesh's coordinates and of a map's heights; center: a point of the surface,
    (x, y, z) in the mesh's coordinates or (easting, northing) [m] on the map; by default the middle. Raises InputError.
    """
    ground = read_ground(path)
    scale = METRES[unit_name]
    dimensions = 2 if isinstance(ground, Dtm) else 3
    if center is not None and len(center) != dimensions:
        raise InputError(
            f"{path}: --surface-center takes {dimensions} numbers for this kind of file, got {len(center)}"
        )
    if isinstance(ground, Dtm):
        relief, missing = _from_map(path, ground, scale, center, grid, gsd)
    else:
        relief, missing = _from_mesh(path, ground, scale, center, grid, gsd)
    _check_cover(path, missing, grid, gsd, unit_name)
    return relief


def _from_map(
    path: Path, dtm: Dtm, scale: float, center: tuple[float, ...] | None, grid: Grid, gsd: float
) -> tuple[Relief, np.ndarray]:
    """Heights of a map above its sphere, with the curvature, and (n, n) True where they are missing."""
    from scipy.ndimage import map_coordinates

    _check_fine(path, math.sqrt(dtm.pixel[0] * dtm.pixel[1]), "pixels", gsd)
    rows, cols = dtm.height.shape
    if center is None:
        center = (dtm.corner[0] + 0.5 * cols * dtm.pixel[0], dtm.corner[1] - 0.5 * rows * dtm.pixel[1])
    col = (center[0] + grid.axis - dtm.corner[0]) / dtm.pixel[0] - 0.5
    row = (dtm.corner[1] - center[1] - grid.axis) / dtm.pixel[1] - 0.5
    at = np.stack(np.meshgrid(row, col, indexing="ij"))
    missing = map_coordinates((~dtm.valid).astype(np.float32), at, order=1, mode="constant", cval=1.0) > 0.0
    # A spline depends on samples beyond the nearest ones: gaps are filled with their nearest neighbours.
    height = scale * map_coordinates(filled_from_nearest(dtm.height, dtm.valid), at, order=3, mode="nearest")
    middle = float(height[grid.half, grid.half])
    height -= middle
    if dtm.radius is not None:
        height += sphere_drop(grid.axis, grid.axis[:, None], dtm.radius)
    origin = np.array([center[0], center[1], middle])
    return Relief(height.astype(np.float32), None, Similarity(1.0, np.eye(3), -origin)), missing


def _from_mesh(
    path: Path, mesh: Mesh, scale: float, center: tuple[float, ...] | None, grid: Grid, gsd: float
) -> tuple[Relief, np.ndarray]:
    """Heights of a mesh over the tangent plane at `center`, and (n, n) True where they are missing."""
    vertices, faces = scale * mesh.vertices, mesh.faces
    reach = math.sqrt(2.0) * grid.half_extent
    closed = _is_closed(faces)
    if closed and signed_volume(vertices, faces) < 0:
        faces = faces[:, ::-1]
    if closed and center is None:
        raise InputError(f"{path}: is a closed shape; choose a place on it with --surface-center X Y Z")
    origin = _middle(path, vertices, faces, None if center is None else scale * np.array(center), reach)
    _check_fine(path, _facet_size(vertices, _faces_within(vertices, faces, origin, reach)), "facets", gsd)
    body_from_file = Similarity(scale, *_upright(path, vertices, faces, origin, reach))
    local = body_from_file(mesh.vertices)
    faces = _faces_seen_from_above(local, faces, grid)
    pixel = local[:, :2] / grid.spacing + grid.half + 0.5
    order = np.argsort(-local[faces, 2].mean(1), kind="stable")
    top, drawn = _draw(pixel, local[:, 2], faces[order], grid)
    bottom, _ = _draw(pixel, local[:, 2], faces[order[::-1]], grid)
    _check_single(path, top - bottom > _OVERLAP_GSD * gsd, drawn)
    albedo = None
    if mesh.albedo is not None:
        _check_albedo(path, mesh.albedo)
        albedo = _draw(pixel, mesh.albedo, faces[order], grid)[0].astype(np.float32)
    return Relief(top.astype(np.float32), albedo, body_from_file), ~drawn


def _draw(pixel: np.ndarray, value: np.ndarray, faces: np.ndarray, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """`value` (V,) interpolated on the first face over each sample of the grid (n, n), and (n, n) True where one is."""
    return draw_triangles(pixel, np.ones(len(pixel)), value, faces, grid.shape)


def _is_closed(faces: np.ndarray) -> bool:
    """Whether every edge has faces on both sides."""
    first, second = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).T
    _, count = np.unique(first * (faces.max() + 1) + second, return_counts=True)
    return bool((count > 1).all())


def _middle(path: Path, vertices: np.ndarray, faces: np.ndarray, center: np.ndarray | None, reach: float) -> np.ndarray:
    """The vertex (3,) nearest to `center` [m], or to the middle of the mesh."""
    if center is None:
        used = vertices[np.unique(faces)]
        center = 0.5 * (used.min(0) + used.max(0))
        return used[np.argmin(np.linalg.norm(used - center, axis=1))]
    distance = np.linalg.norm(vertices - center, axis=1)
    nearest = int(np.argmin(distance))
    if distance[nearest] > reach:
        raise InputError(
            f"{path}: the surface is {distance[nearest]:.4g} m from --surface-center at the nearest, more than the "
            f"{reach:.4g} m that the views see; check the point and --surface-unit"
        )
    return vertices[nearest]


def _faces_within(vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, reach: float) -> np.ndarray:
    """The faces (F', 3) with a corner within `reach` of `origin`."""
    near = np.linalg.norm(vertices - origin, axis=1) < reach
    return faces[near[faces].any(1)]


def _facet_size(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Median length of the faces' edges."""
    corner = vertices[faces]
    return float(np.median(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=-1)))


def _upright(
    path: Path, vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and translation (3,) from the file's axes [m] to B."""
    corner = vertices[_faces_within(vertices, faces, origin, reach)]
    area = 0.5 * np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total, size = area.sum(0), np.linalg.norm(area, axis=1).sum()
    if np.linalg.norm(total) < _LEAST_FACING * size:
        raise InputError(
            f"{path}: faces all ways within {reach:.4g} m of the site, so it is not a height field; choose a "
            "smaller --gsd or --image-size, or check --surface-unit"
        )
    up = unit(total)
    _check_outward(path, vertices, origin, up)
    north = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < math.sqrt(0.5) else np.array([0.0, 1.0, 0.0])
    east = unit(np.cross(north, up))
    rotation = np.stack([east, np.cross(up, east), up])
    return rotation, -rotation @ origin


def _check_outward(path: Path, vertices: np.ndarray, origin: np.ndarray, up: np.ndarray) -> None:
    """Raises InputError if `up` points into the body, or against z in a frame whose origin is near the site."""
    quarter = _NEAR_ORIGIN * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if up @ origin < -quarter or (up @ origin <= quarter and up[2] < _DOWNWARD):
        raise InputError(f"{path}: its faces look downwards or into the body; reverse the order of their corners")


def _faces_seen_from_above(local: np.ndarray, faces: np.ndarray, grid: Grid) -> np.ndarray:
    """The faces (F', 3) over the grid whose outside faces up."""
    corner = local[faces]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    upwards = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0.0
    edge = grid.half_extent + grid.spacing
    over = (corner[..., :2].min(1) < edge).all(-1) & (corner[..., :2].max(1) > -edge).all(-1)
    return faces[upwards & over]


def _check_fine(path: Path, size: float, what: str, gsd: float) -> None:
    if size > MAX_FACET_GSD * gsd:
        raise InputError(
            f"{path}: is too coarse: its {what} are {size:.4g} m wide, images of {gsd:.4g} m per pixel would show "
            f"them; choose --gsd {size / MAX_FACET_GSD:.3g} or more, give a finer surface, or check --surface-unit"
        )


def _check_single(path: Path, double: np.ndarray, drawn: np.ndarray) -> None:
    share = double.sum() / max(drawn.sum(), 1)
    if 0 < share <= _MAX_OVERLAP:
        warn(
            log,
            "ground-overlaps",
            "%s: %.2g %% of the ground lies under other ground and is left out",
            path,
            100 * share,
        )
    if share > _MAX_OVERLAP:
        raise InputError(
            f"{path}: is not a height field: {100 * share:.2g} % of the ground lies under other ground; choose another "
            "--surface-center, or cut overhangs and other parts of the body away"
        )


def _check_albedo(path: Path, albedo: np.ndarray) -> None:
    if not (np.isfinite(albedo).all() and albedo.min() > 0 and albedo.max() <= 1):
        raise InputError(
            f"{path}: albedo from {albedo.min():.4g} to {albedo.max():.4g}; give normal albedo (I/F) above 0, up to 1, "
            "or leave the property out"
        )


def _check_cover(path: Path, missing: np.ndarray, grid: Grid, gsd: float, unit_name: str) -> None:
    if not missing.any():
        return
    if missing[grid.half, grid.half]:
        raise InputError(f"{path}: has no ground at the site itself; choose another --surface-center")
    from_center = np.maximum(np.abs(grid.axis), np.abs(grid.axis)[:, None])
    whole = float(from_center[missing].min())
    unit_hint = ""
    if unit_name == "m" and whole < _HINT_SHARE * grid.half_extent:
        unit_hint = "if it is in kilometres, pass --surface-unit km; or "
    raise InputError(
        f"{path}: has ground without gaps only within {whole:.4g} m of the site, in x and y, and images of {gsd:.4g} "
        f"m per pixel need {grid.half_extent:.4g} m; {unit_hint}choose --gsd "
        f"{_HINT_GSD * gsd * whole / grid.half_extent:.2g}, smaller images (--image-size) or another --surface-center, "
        "or fill the gaps"
    )
