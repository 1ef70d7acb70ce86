from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.model.reflectance import photometric_angles, published
from photoclinometry.model.region import Region
from photoclinometry.simulate.hapke import published_hapke
from photoclinometry.simulate.observe import cast, radiance, sample_points
from photoclinometry.simulate.photometry import as_dict, from_dict, named_photometry, radiance_factor
from photoclinometry.simulate.presets import PRESETS, build_surface
from photoclinometry.simulate.raycast import Raycaster
from photoclinometry.simulate.surface import Surface, sphere_drop
from photoclinometry.simulate.trajectory import looking_at
from rough_ground import rough_surface

CAMERA = Camera("PINHOLE", 48, 40, (2000.0, 2000.0, 24.0, 20.0))
FRAME = Region.of_image(40, 48)
SUN = unit([0.5, -0.3, 0.7])
MODELS = {
    "hapke": published_hapke("vesta"),
    **{name: published(name, "vesta") for name in ("lunar-lambert", "akimov", "akimov+", "mcewen", "minnaert")},
}


def view(center=(300.0, -200.0, 2000.0), roll=0.4):
    return looking_at(np.array(center), np.zeros(3), roll)


def angles(position, normal, center):
    """mu0, mu, phase by arccos, the plain way."""
    to_camera = unit(center - position)
    return normal @ SUN, np.sum(normal * to_camera, -1), np.arccos(to_camera @ SUN)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_a_tilted_plane_has_the_brightness_of_the_closed_form(model):
    axis = np.arange(-60.0, 61.0)
    x, y = np.meshgrid(axis, axis)
    plane = Surface(0.2 * x - 0.1 * y, np.full(x.shape, 0.3), 1.0, (-60.0, -60.0))
    normal = unit([-0.2, 0.1, 1.0])
    pose = view()
    image, complete = radiance(Raycaster(plane), CAMERA, pose, SUN, model, 1, 0)
    pixels = sample_points(FRAME, 1, 0)
    rays = CAMERA.ray_in_cam(pixels) @ pose.rotation.T
    position = pose.translation - (pose.translation @ normal) / (rays @ normal)[..., None] * rays
    expected = radiance_factor(model, np.full((40, 48), 0.3), *angles(position, normal, pose.translation))
    assert complete
    np.testing.assert_allclose(image, expected, rtol=2e-6)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_a_sphere_has_the_brightness_of_the_closed_form(model):
    """Rays meet x^2 + y^2 + (z + R)^2 = R^2 exactly; the grid's interpolation is all that differs."""
    radius, axis = 200.0, np.arange(-60.0, 60.5, 0.5)
    x, y = np.meshgrid(axis, axis)
    cap = Surface(sphere_drop(x, y, radius), np.full(x.shape, 0.3), 0.5, (-60.0, -60.0))
    pose = view()
    image, complete = radiance(Raycaster(cap), CAMERA, pose, SUN, model, 1, 0)
    pixels = sample_points(FRAME, 1, 0)
    rays = unit(CAMERA.ray_in_cam(pixels) @ pose.rotation.T)
    middle = np.array([0.0, 0.0, -radius])
    b = rays @ (pose.translation - middle)
    c = np.sum((pose.translation - middle) ** 2) - radius**2
    position = pose.translation + (-b - np.sqrt(b * b - c))[..., None] * rays
    where = angles(position, unit(position - middle), pose.translation)
    expected = radiance_factor(model, np.full((40, 48), 0.3), *where)
    assert complete
    np.testing.assert_allclose(image, expected, rtol=1e-5)


def image_by_embree(surface, finer, pose, sun, model):
    """I/F (h, w) of the surface as flat facets, `finer` to a sample, through the Embree ray tracer; and lit (h, w)."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    x0, x1, y0, y1 = surface.extent
    n = (surface.height.shape[0] - 1) * finer + 1
    grid = np.stack(np.meshgrid(np.linspace(x0, x1, n), np.linspace(y0, y1, n)), -1)
    vertex = np.concatenate([grid, surface.height_at(grid)[..., None]], -1).reshape(-1, 3)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()[:, None]
    triangle = vertex[np.concatenate([corner + [0, 1, n], corner + [1, n + 1, n]])]
    scene = EmbreeScene()
    TriangleMesh(scene, triangle.astype(np.float32))
    facet = unit(np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]))

    pixels = sample_points(FRAME, 1, 0).reshape(-1, 2)
    ray = unit(CAMERA.ray_in_cam(pixels) @ pose.rotation.T)
    start = pose.translation + 0.95 * np.linalg.norm(pose.translation) * ray  # single precision wants short ways
    hit = scene.run(start.astype(np.float32), ray.astype(np.float32), output=True)
    position, normal = start + hit["tfar"][:, None] * ray, facet[hit["primID"]]
    above = (position + 1e-3 * surface.spacing * normal).astype(np.float32)
    lit = scene.run(above, np.tile(sun, (len(ray), 1)).astype(np.float32)) < 0
    lit &= normal @ sun > 0
    out = surface.albedo_at(position[:, :2]) * model(*photometric_angles(sun, pose.translation, position, normal)) * lit
    return out.reshape(CAMERA.height, CAMERA.width), lit.reshape(CAMERA.height, CAMERA.width)


def test_a_crater_is_the_same_through_a_mesh_ray_tracer():
    """Embree sees flat facets, this renderer the smooth surface. What they differ by in the light is the facets' slope
    error, which halves with their size; where only one of them sees shadow, its edge passes through the pixel."""
    pytest.importorskip("embreex")
    surface = build_surface(PRESETS["demo"], 2700.0, 3)
    model, sun = MODELS["lunar-lambert"], unit([0.8, 0.3, 0.45])
    pose = looking_at(np.array([20e3, -13e3, 87e3]), np.array([1200.0, 0.0, 0.0]), 0.4)
    image, complete = radiance(Raycaster(surface), CAMERA, pose, sun, model, 1, 0)
    assert complete
    off = []
    for finer in (2, 4):
        by_mesh, lit = image_by_embree(surface, finer, pose, sun, model)
        both = lit & (image > 0)
        off.append(np.median(np.abs(by_mesh - image)[both] / image[both]))
        only_one = lit ^ (image > 0)
    assert 0.05 < np.mean(image == 0) < 0.6
    assert off[1] < 0.006
    assert off[1] == pytest.approx(off[0] / 2, rel=0.25)
    assert only_one.mean() < 0.01
    fine = cast(Raycaster(surface), CAMERA, pose, sun, sample_points(FRAME, 8, 0)).lit
    share = fine.reshape(40, 8, 48, 8).mean((1, 3))[only_one]
    assert ((share > 0) & (share < 1)).all()


def test_shading_is_brighter_on_the_side_that_faces_the_sun():
    x, y = np.meshgrid(np.arange(-60.0, 61.0), np.arange(-60.0, 61.0))
    bowl = Surface(0.01 * (x * x + y * y), np.full(x.shape, 0.3), 1.0, (-60.0, -60.0))
    caster, model = Raycaster(bowl), MODELS["lunar-lambert"]
    pose = looking_at(np.array([0.0, 0.0, 2000.0]), np.zeros(3), 0.0)  # north up, east right
    image, _ = radiance(caster, CAMERA, pose, unit([0.5, 0.0, 1.0]), model, 1, 0)  # the Sun is in the east
    assert image[:, :10].mean() > 1.05 * image[:, -10:].mean()  # the western wall faces it


def test_rays_off_the_surface_are_dark_and_reported():
    small = Surface(np.zeros((8, 8)), np.full((8, 8), 0.3), 1.0, (-4.0, -4.0))
    image, complete = radiance(Raycaster(small), CAMERA, view(), SUN, MODELS["akimov"], 1, 0)
    assert not complete
    assert image[0, 0] == 0
    assert image[20, 24] > 0


def test_phase_angles_beyond_a_published_fit_are_refused():
    """Lunar-Lambert with the coefficients of Ceres turns negative beyond 113 degrees."""
    flat = Surface(np.zeros((121, 121)), np.full((121, 121), 0.1), 1.0, (-60.0, -60.0))
    low_sun, low_camera = unit([-1.0, 0.0, 0.05]), view(center=(1500.0, 0.0, 900.0))
    with pytest.raises(InputError, match=r"negative.*hapke"):
        radiance(Raycaster(flat), CAMERA, low_camera, low_sun, published("lunar-lambert", "ceres"), 1, 0)
    image, _ = radiance(Raycaster(flat), CAMERA, low_camera, low_sun, published_hapke("ceres"), 1, 0)
    assert image.min() >= 0


def test_cast_goes_through_the_pixels():
    surface = replace(rough_surface(size=60, spacing=2.0), origin=(-60.0, -60.0))
    pose = view(center=(100.0, 40.0, 900.0))
    region = Region(row=5, col=7, height=20, width=30)
    samples = cast(Raycaster(surface), CAMERA, pose, SUN, region.pixel_centers())
    assert samples.hit.any()
    back = CAMERA.pixel_from_cam(pose.inverse()(samples.position))
    np.testing.assert_allclose(back[samples.hit], region.pixel_centers()[samples.hit], atol=1e-9)


def test_sample_points_are_spread_evenly_over_pixels():
    points = sample_points(Region(row=3, col=5, height=2, width=4), 2, 1)
    assert points.shape == (8, 12, 2)
    np.testing.assert_allclose(points[2, 2], [5.25, 3.25])
    np.testing.assert_allclose(points[2:4, 2:4].mean((0, 1)), [5.5, 3.5])


@pytest.mark.parametrize("name", ["hapke", "minnaert"])
def test_photometry_survives_being_written_as_plain_values(name):
    import json

    model = named_photometry(name, "ceres")
    assert from_dict(json.loads(json.dumps(as_dict(model)))) == model
