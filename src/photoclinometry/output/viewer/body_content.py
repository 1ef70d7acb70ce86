"""The viewer's data of a whole body: its surface, views and reflectance, in the frame of the body.

The page lays vertices out in rows of a grid, as landmarks of a region are, so that both take the same ways; the grid's
neighbours have no meaning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from photoclinometry.model.geometry import Rigid, angle_between
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance import Reflectance
from photoclinometry.model.scene import Views
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.viewer.arrays import packed, share_of_peak, three_digits
from photoclinometry.output.viewer.content import ALBEDO_LEVELS, FORMAT, NORMAL_STEP, POSITION_STEP_GSD, Content
from photoclinometry.output.viewer.pictures import pictures
from photoclinometry.output.viewer.views import reflectance_content, views_content
from photoclinometry.registration.coarser_shape import coarser
from photoclinometry.surface.closed_mesh import centroid, vertex_normals
from photoclinometry.surface.decimate import decimate

MOST_FACETS = 400_000
"""Of a page: some 6 MB, and half a second for a frame that is drawn without a graphics processor. Finer surfaces are
made coarser, and their page says so."""
MOVING_FACETS = 40_000
"""Of the level of detail that is drawn while the body turns, where the finest takes too long."""
_COLUMNS = 1024
"""Of the grid; graphics processors take 2048 columns and rows at least."""
_EVERY = 50
"""One of this many vertices is used to decide whether a view contains the whole body."""
_MORTON_BITS = 20
"""Of each coordinate in the order of vertices, which puts neighbours beside each other: arrays become smaller."""


@dataclass(frozen=True, kw_only=True)
class ViewedBody:
    """A finished body, for its page."""

    name: str
    body: str | None
    shape: ShapeModel
    """Closed; its normals and albedos may be missing."""
    views: Views
    reflectance: Reflectance | None
    gsd: float
    """Ground sample distance of the map, in the unit of the shape."""
    brightness: str
    """Of the images: "iof" or "dn"."""
    body_fixed: bool
    """Whether longitudes and latitudes are those of the body."""
    pose_priors: Mapping[str, PosePrior] = field(default_factory=dict)
    """By name of view; they count where the body is in their frame."""


def body_content(body: ViewedBody, images: Sequence[Image] = ()) -> Content:
    """The body for the page. images: of its views, in any order; without them the page compares with none."""
    shape, frame = in_neighbours_order(coarser(body.shape, MOST_FACETS)), _frame(body)
    length = 1.0 / body.gsd if shape.from_images_alone else 1.0
    count = len(shape.vertices)
    return {
        "format": FORMAT,
        "kind": "body",
        "name": body.name,
        "body": body.body,
        "brightness": body.brightness,
        "unit": shape.unit or "GSD",
        "gsd": body.gsd * length,
        "spacing": body.gsd * length,
        "grid": {"rows": -(-count // _COLUMNS), "cols": _COLUMNS, "row": 0, "col": 0, "stride": 1},
        "reference": first_view(body, frame.translation),
        "views": views_content(
            body.views, frame, length, [0.0] * len(body.views), body.pose_priors if body.body_fixed else None
        ),
        "reflectance": reflectance_content(body.reflectance if shape.albedo is not None else None),
        "place": {
            "body_fixed": body.body_fixed,
            "body_from_local": frame.rotation.tolist(),
            "origin": (frame.translation * length).tolist(),
        },
        "landmarks": _vertices(shape, frame, body.gsd, length),
        "facets": len(body.shape.faces),
        "faces": packed(shape.faces, 1.0),
        "coarse_faces": packed(level_on(shape, MOVING_FACETS), 1.0) if len(shape.faces) > MOVING_FACETS else None,
        "surroundings": None,
        "pictures": pictures(body.views, shape.vertices, images),
    }


def _frame(body: ViewedBody) -> Rigid:
    """The page's frame in B: B itself where it is body-fixed, else about the body's centre."""
    middle = np.zeros(3) if body.body_fixed else centroid(body.shape.vertices, body.shape.faces)
    return Rigid(np.eye(3), middle)


def first_view(body: ViewedBody, middle: np.ndarray) -> int:
    """The view whose light shows relief best: of those that hold the whole body, that of a phase nearest to 45 degrees.

    middle: (3,) of the body.
    """
    views = body.views
    off = np.abs(np.degrees(angle_between(views.body_from_cam.translation - middle, views.sun)) - 45.0)
    size = np.array([(camera.width, camera.height) for camera in views.cameras])
    pixel = np.stack([views.project(k, body.shape.vertices[::_EVERY]) for k in range(len(views))])
    whole = ((pixel > 0) & (pixel < size[:, None])).all((1, 2))
    return int(np.argmin(np.where(whole | ~whole.any(), off, np.inf)))


def _vertices(shape: ShapeModel, frame: Rigid, gsd: float, length: float) -> Content:
    """Arrays of the vertices; NaN where nothing was mapped."""
    normals = vertex_normals(shape.vertices, shape.faces) if shape.normals is None else shape.normals
    found = {
        "cell": packed(np.arange(len(shape.vertices)), 1.0),
        "position": packed(frame.inverse()(shape.vertices) * length, POSITION_STEP_GSD * gsd * length),
        "normal": packed(normals, NORMAL_STEP),
    }
    in_units = {"height": length, "normal": np.degrees(1.0), "albedo": 100.0}
    for name, values in shape.sigma.items():
        found[f"sigma_{name}"] = packed(values * in_units[name], three_digits(values * in_units[name]))
    if shape.albedo is not None:
        found["albedo"] = packed(shape.albedo, share_of_peak(shape.albedo, ALBEDO_LEVELS))
    if shape.views is not None:
        found["views"] = packed(shape.views, 1.0)
    if shape.tile is not None:
        found["tile"] = packed(np.where(shape.tile < 0, np.nan, shape.tile), 1.0)
    return found


def in_neighbours_order(shape: ShapeModel) -> ShapeModel:
    """The same model with vertices along a curve that fills space (Morton 1966), and faces by their first vertex."""
    low, high = shape.vertices.min(0), shape.vertices.max(0)
    whole = ((shape.vertices - low) / max(float((high - low).max()), 1e-300) * (2**_MORTON_BITS - 1)).astype(np.uint64)
    key = np.zeros(len(whole), np.uint64)
    for bit in range(_MORTON_BITS):
        for axis in range(3):
            key |= ((whole[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    order = np.argsort(key, kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    faces = place[shape.faces]
    first = faces.argmin(1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, 1)
    faces = faces[np.lexsort((faces[:, 1], faces[:, 0]))]
    return shape.of_vertices(order, faces)


def level_on(shape: ShapeModel, facets: int) -> np.ndarray:
    """(F, 3) about `facets` triangles of the model's own vertices: a coarser level that needs no vertices of its
    own."""
    from scipy.spatial import KDTree

    vertices, faces = decimate(shape.vertices, shape.faces, facets)
    faces = np.asarray(KDTree(shape.vertices).query(vertices)[1])[faces]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(1)
    return faces[distinct]
