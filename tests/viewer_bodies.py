"""Bodies for the tests of the viewer and the report: known exactly, in four views, with pictures of them by rays."""

import numpy as np

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.image import Image
from photoclinometry.model.reflectance import starting_model
from photoclinometry.model.scene import Views
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.viewer import ViewedBody
from photoclinometry.photometry.shape_rendering import ShadedSurface, rendered_shape
from photoclinometry.surface.closed_mesh import icosahedron, refine, vertex_normals
from photoclinometry.surface.mesh_rays import MeshRays
from scenes import look_at_origin

RADIUS = 200.0
DIRECTIONS = ((1.0, 0.2, 0.3), (-0.4, 1.0, -0.2), (0.3, -0.5, 1.0), (-0.6, -0.6, -0.8))
"""From the body to its cameras."""


def round_one(points):
    """A sphere."""
    return RADIUS * points / np.linalg.norm(points, axis=-1, keepdims=True)


def dented(points):
    """A sphere with a deep hollow, whose rim casts shadows into it, and with low waves."""
    way = points / np.linalg.norm(points, axis=-1, keepdims=True)
    hollow = np.exp(-0.5 * ((1.0 - way @ (0.8, 0.0, 0.6)) / 0.05) ** 2)
    waves = 0.02 * np.sin(6.0 * way[:, 0]) * np.cos(5.0 * way[:, 1])
    return RADIUS * way * (1.0 + waves - 0.35 * hollow)[:, None]


def body_of(form=dented, model="lunar-lambert", spacing=4.0):
    """A body with all that a map of it has, in four views; nothing is known of its south pole."""
    corners, faces = icosahedron()
    vertices, faces = refine(form(corners), faces, spacing, form)
    albedo = 0.3 + 0.05 * np.sin(vertices[:, 2] / 30.0)
    known = vertices[:, 2] > -0.9 * RADIUS
    stated = {"height": 0.5, "normal": np.radians(1.5), "albedo": 0.02}
    shape = ShapeModel(
        vertices=vertices,
        faces=faces,
        normals=vertex_normals(vertices, faces),
        albedo=np.where(known, albedo, np.nan),
        sigma={name: np.where(known, value, np.nan) for name, value in stated.items()},
        views=np.where(known, 4, 0),
        tile=np.where(known, (vertices[:, 0] > 0).astype(int), -1),
        unit="m",
    )
    ways = np.array(DIRECTIONS) / np.linalg.norm(DIRECTIONS, axis=-1, keepdims=True)
    suns = ways + 0.8 * np.roll(ways, 1, axis=-1)
    suns /= np.linalg.norm(suns, axis=-1, keepdims=True)
    poses = [look_at_origin(3000.0 * way, 0.3) for way in ways]
    views = Views(
        name=("a", "b", "c", "d"),
        cameras=(Camera(model="PINHOLE", width=150, height=140, params=(900.0, 900.0, 74.0, 71.0)),) * 4,
        body_from_cam=Rigid(np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])),
        sun=suns,
        scale=np.array([1.0, 2.0, 1.0, 1.0]),
        bias=np.zeros(4),
        dark_level=np.zeros(4),
        sun_measured=suns,
        sun_sigma=np.zeros(4),
        sun_common_sigma=np.zeros(4),
        arc=np.zeros(4, int),
    )
    return ViewedBody(
        name="dented",
        body="vesta",
        shape=shape,
        views=views,
        reflectance=starting_model(model, "vesta"),
        gsd=10.0 / 3.0,
        brightness="iof",
        body_fixed=True,
    )


def by_rays(body, view, sun):
    """A view's picture under a Sun, with its scale: brightness (height, width), NaN beside the body."""
    shape, views = body.shape, body.views
    albedo = np.where(np.isfinite(shape.albedo), shape.albedo, np.nanmedian(shape.albedo))
    rays = MeshRays(shape.vertices, shape.faces, 4.0)
    surface = ShadedSurface(rays=rays, normals=shape.normals, albedo=albedo, reflectance=body.reflectance)
    return views.scale[view] * rendered_shape(surface, views.cameras[view], views.body_from_cam[view], np.asarray(sun))


def images_of(body):
    """Its four images, without noise."""
    found = []
    for k, name in enumerate(body.views.name):
        picture = by_rays(body, k, body.views.sun[k])
        found.append(Image(name, np.nan_to_num(picture).astype(np.float32), np.ones(picture.shape, bool)))
    return found
