import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photoclinometry.io.images import read_image
from photoclinometry.io.meshes.obj import write_obj
from photoclinometry.io.meshes.ply import read_ply
from photoclinometry.io.site import read_site
from photoclinometry.io.site_images import load_images
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import angle_between, so3_log, unit
from photoclinometry.model.reflectance import photometric_angles
from photoclinometry.simulate.bodies.build import build_body, given_shape, preset_shape
from photoclinometry.simulate.bodies.landforms import VertexGrid, add_craters, crater_population
from photoclinometry.simulate.bodies.noise import fractal_noise
from photoclinometry.simulate.bodies.orbits import SUN_LATITUDE_DEG, draw_mission, images_at_stations, mission_of
from photoclinometry.simulate.bodies.presets import BODIES
from photoclinometry.simulate.bodies.surface import BodyRaycaster, BodySurface
from photoclinometry.simulate.bodies.truth import read_body_truth, views_of_triangles, write_body_truth
from photoclinometry.simulate.camera_model import Detector, pixel_average
from photoclinometry.simulate.observe import radiance
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.photometry import named_photometry, radiance_factor
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.truth_file import read_truth
from photoclinometry.simulate.views import measured_views, pose_priors
from photoclinometry.surface.closed_mesh import (
    LONGEST,
    icosahedron,
    is_watertight,
    refine,
    signed_volume,
    unique_edges,
    vertex_areas,
    vertex_normals,
)

pytest.importorskip("embreex")

SMALL = SimulationOptions(preset="bilobed", views=24, image_size=64, seed=5, pose_sigma=(0.1, 30.0))
SPHERE = refine(*icosahedron(), 0.1, unit)


@pytest.fixture(scope="module")
def coarse():
    """A contact binary of 3,000 vertices: its smaller lobe shades the larger one."""
    preset = BODIES["bilobed"]
    return build_body(preset_shape(preset), preset, 70.0, 2)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return simulate_site(SMALL, tmp_path_factory.mktemp("site") / "small")


@pytest.fixture(scope="module")
def truth(site):
    return read_body_truth(site.with_name("truth.h5"))


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("name", BODIES)
def test_presets_are_watertight_look_outwards_and_have_their_size(name):
    preset = BODIES[name]
    body = build_body(preset_shape(preset), preset, preset.radius / 20, 0)
    edges, index = unique_edges(body.faces)
    assert is_watertight(body.faces)
    assert (np.bincount(index.ravel()) == 2).all()
    assert len(body.vertices) - len(edges) + len(body.faces) == 2  # Euler: no handles
    assert signed_volume(body.vertices, body.faces) > 0
    assert body.mean_radius == pytest.approx(preset.radius, rel=0.05)
    assert np.sum(body.facet_normals * body.normals[body.faces].mean(1), -1).mean() > 0.9
    assert body.albedo.mean() == pytest.approx(preset.mean_albedo, rel=1e-3)


def test_a_refined_icosahedron_is_a_sphere_of_even_triangles():
    vertices, faces = SPHERE
    edges, _ = unique_edges(faces)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    assert length.max() <= LONGEST * 0.1
    assert length.mean() == pytest.approx(0.1, rel=0.25)
    assert length.min() > 0.4 * 0.1
    assert is_watertight(faces)
    assert signed_volume(vertices, faces) == pytest.approx(4 / 3 * np.pi, rel=0.005)
    assert vertex_areas(vertices, faces).sum() == pytest.approx(4 * np.pi, rel=0.005)
    assert np.degrees(angle_between(vertex_normals(vertices, faces), vertices).max()) < 2.5  # facets turn by 6


def test_a_given_coarse_sphere_is_refined_to_a_round_one():
    """New points lie on curves through the given ones, not on their facets."""
    coarse = refine(*icosahedron(), 0.4, unit)
    vertices, faces = refine(*coarse, 0.05)
    np.testing.assert_array_equal(vertices[: len(coarse[0])], coarse[0])
    assert is_watertight(faces)
    sunk = 1.0 - np.linalg.norm(0.5 * (coarse[0][coarse[1][:, 0]] + coarse[0][coarse[1][:, 1]]), axis=1).min()
    off = np.abs(np.linalg.norm(vertices, axis=1) - 1.0)
    assert off.max() < 0.5 * sunk
    assert off.mean() < 0.2 * sunk


def test_an_open_or_inconsistent_mesh_is_not_watertight():
    _, faces = icosahedron()
    assert not is_watertight(faces[1:])
    turned = faces.copy()
    turned[3] = turned[3, ::-1]
    assert not is_watertight(turned)


def test_noise_has_unit_variance_and_its_wavelengths():
    points = np.random.default_rng(0).uniform(0.0, 50.0, (20_000, 3))
    noise, near = (fractal_noise(points + d, np.random.default_rng(1), 0.9, 4.0, 0.5) for d in (0.0, [0.05, 0.0, 0.0]))
    far = fractal_noise(points + [40.0, 0.0, 0.0], np.random.default_rng(1), 0.9, 4.0, 0.5)
    assert noise.std() == pytest.approx(1.0)
    assert np.corrcoef(noise, near)[0, 1] > 0.95
    assert abs(np.corrcoef(noise, far)[0, 1]) < 0.1


def test_a_crater_has_its_depth_and_leaves_the_far_side():
    vertices, faces = refine(*icosahedron(), 0.03, unit)
    rng = np.random.default_rng(0)
    weight = np.zeros(len(vertices))
    weight[np.argmax(vertices[:, 2])] = 1.0
    craters = crater_population(rng, weight, density=1.0, smallest=0.35, largest=0.36, freshest=0.0, brightening=0.2)
    one = replace(craters, **{key: getattr(craters, key)[:1] for key in craters.__dataclass_fields__})
    one = replace(one, profile=np.array([1]), outline=np.zeros((1, 4)))
    height, tone = np.zeros(len(vertices)), np.zeros(len(vertices))
    add_craters(height, tone, vertices, vertex_normals(vertices, faces), VertexGrid(vertices, 0.03), one, 1.0)
    assert np.ptp(height) == pytest.approx(0.2 * 0.355, rel=0.15)  # depth over diameter of fresh craters
    assert (height[vertices[:, 2] < 0] == 0).all()


def first_hit(surface, origin, ray):
    """Triangle, distance and weights of the first triangle of all that a ray meets (Moeller & Trumbore 1997)."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    e, f = b - a, c - a
    p = np.cross(ray, f)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.sum(e * p, -1)
        s = origin - a
        u = inverse * np.sum(s * p, -1)
        q = np.cross(s, e)
        v, t = inverse * (q @ ray), inverse * np.sum(f * q, -1)
    t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    n = int(np.argmin(t))
    return n, t[n], np.array([1 - u[n] - v[n], u[n], v[n]])


def test_pixels_have_the_brightness_of_the_reflectance_at_the_true_hit(coarse):
    """One ray per pixel, followed in double precision through every triangle, twice: to the ground and to the Sun."""
    camera = Camera("PINHOLE", 24, 24, (1000.0, 1000.0, 12.0, 12.0))
    model = named_photometry("lunar-lambert", "vesta")
    poses, suns = draw_mission(np.random.default_rng(1), 14, 140.0, 1000.0, coarse.vertices, 0.0)
    tracer, compared, shaded, sky = BodyRaycaster(coarse), 0, 0, 0
    for k in (2, 6, 9):
        image, complete = radiance(tracer, camera, poses[k], suns[k], model, 1, 0)
        assert not complete
        center = poses[k].translation
        for row in range(24):
            for col in range(24):
                ray = unit(poses[k].rotation @ camera.ray_in_cam(np.array([col + 0.5, row + 0.5])))
                n, t, weight = first_hit(coarse, center, ray)
                if not np.isfinite(t):
                    assert image[row, col] == 0
                    sky += 1
                    continue
                corner = coarse.faces[n]
                normal, albedo = unit(weight @ coarse.normals[corner]), weight @ coarse.albedo[corner]
                if weight.min() < 1e-3 or normal @ ray >= 0:
                    continue
                point = center + t * ray
                start = point + 5e-3 * coarse.spacing * coarse.facet_normals[n]
                dark = normal @ suns[k] <= 0 or np.isfinite(first_hit(coarse, start, suns[k])[1])
                angles = photometric_angles(suns[k], center, point, normal)
                expected = 0.0 if dark else float(radiance_factor(model, np.array(albedo), *angles))
                shaded += dark and normal @ suns[k] > 0.1
                compared += 1
                assert image[row, col] == pytest.approx(expected, rel=1e-3, abs=1e-5)
    assert compared > 180
    assert shaded > 0  # cast shadows
    assert sky > 200


@pytest.mark.parametrize("sun", [(0.9, 0.2, 0.3), (-0.9, 0.1, -0.2), (0.3, 0.9, 0.1)])
def test_cast_shadows_are_those_of_a_search_through_all_triangles(coarse, sun):
    """From the middles of triangles that face a Sun along the axis of both lobes, or across it."""
    sun = unit(sun)
    facing = np.flatnonzero(coarse.facet_normals @ sun > 0.05)
    chosen = facing[:: len(facing) // 150]
    points = coarse.vertices[coarse.faces[chosen]].mean(1)
    blocked = BodyRaycaster(coarse).rays.blocked(chosen, points, np.tile(sun, (len(chosen), 1)))
    start = points + 5e-3 * coarse.spacing * coarse.facet_normals[chosen]
    expected = [np.isfinite(first_hit(coarse, point, sun)[1]) for point in start]
    np.testing.assert_array_equal(blocked, expected)
    assert 0.03 < np.mean(expected) < 0.6


def test_the_limb_is_lit_and_never_black_for_its_normals():
    """Facing the Sun, every pixel that looks at a sphere is lit, also where vertex normals face away."""
    vertices, faces = SPHERE
    surface = BodySurface(vertices, faces, vertex_normals(vertices, faces), np.full(len(vertices), 0.3), 0.1)
    grid = np.stack(np.meshgrid(*[np.linspace(-0.06, 0.06, 200)] * 2), -1).reshape(-1, 2)
    rays = np.column_stack([grid, -np.ones(len(grid))])
    origin = np.array([0.0, 0.0, 20.0])
    hits = BodyRaycaster(surface).trace(origin, rays, unit(origin))
    assert 0.5 < hits.hit.mean() < 0.8
    assert (np.sum(hits.normal * unit(rays), -1)[hits.hit] < 0).all()
    assert hits.lit[hits.hit].mean() > 0.98


def test_the_sun_stands_still_while_the_body_spins():
    """At a station the phase angle varies by the aim alone, and in the body's frame the Sun goes all round."""
    count = 120
    poses, suns = draw_mission(np.random.default_rng(0), count, 1.0, 3000.0, 300.0 * SPHERE[0], 0.0)
    station, towards = images_at_stations(count), unit(poses.translation)
    phase = np.degrees(angle_between(suns, towards))
    assert 10 < phase.min() < 25
    assert 65 < phase.max() < 80
    np.testing.assert_allclose(np.abs(np.degrees(np.arcsin(suns[:, 2]))), SUN_LATITUDE_DEG)
    for number in range(len(mission_of(count))):
        at = station == number
        assert np.ptp(phase[at]) < 1e-6
        assert np.ptp(suns[at, 2]) < 1e-12
        azimuth = np.sort(np.arctan2(suns[at, 1], suns[at, 0]))
        assert np.diff(np.r_[azimuth, azimuth[0] + 2 * np.pi]).max() < 3.2 * np.pi / at.sum()
    assert len({round(float(np.linalg.norm(t))) // 700 for t in poses.translation}) >= 3  # resolutions


@pytest.mark.parametrize("count", [3, 8, 40, 121])
def test_every_number_of_images_is_dealt_to_stations(count):
    assert len(images_at_stations(count)) == count
    poses, suns = draw_mission(np.random.default_rng(0), count, 1.0, 3000.0, 300.0 * SPHERE[0], 5.0)
    assert len(poses) == len(suns) == count


def test_the_site_reads_back_without_a_region_and_with_black_sky(site, truth):
    found = read_site(site)
    assert found.region is None
    assert found.body_radius_m == pytest.approx(truth.surface.mean_radius)
    assert [v.name for v in found.views] == list(truth.views.name)
    for k, image in enumerate(load_images(found)):
        assert image.valid.any()
        assert angle_between(truth.views.body_from_cam[k].rotation @ found.views[k].sun, truth.views.sun[k]) < 5e-3
        raw = read_image(site.parent / image.name)
        assert np.abs(np.median(raw.brightness[:4, :4])) < 0.1 * np.nanmax(raw.brightness) or k > 12  # close-ups
    mesh = read_ply(site.with_name("truth.ply"))
    np.testing.assert_array_equal(mesh.position, truth.surface.vertices)
    np.testing.assert_array_equal(mesh.faces, truth.surface.faces)
    np.testing.assert_array_equal(mesh.albedo, truth.surface.albedo)


def test_images_follow_from_the_truth_in_its_file(site, truth):
    """The mesh that was read draws the image again, but for noise."""
    quiet = replace(SMALL.detector, noise=False)
    tracer = BodyRaycaster(truth.surface)
    for k in (0, 10, 20):
        fine, _ = radiance(
            tracer,
            truth.views.cameras[k],
            truth.views.body_from_cam[k],
            truth.views.sun[k],
            truth.photometry,
            SMALL.supersampling,
            quiet.margin_px,
        )
        expected = pixel_average(fine, SMALL.supersampling, quiet.margin_px, truth.psf_sigma_px)
        image = read_image(site.parent / truth.views.name[k])
        off = (image.brightness - expected)[image.valid]
        assert np.abs(off).max() < 0.05 * expected.max()
        assert np.std(off) < 0.005 * expected.max()


def test_views_see_all_sides_lit(truth):
    """Nearly all ground is seen lit, at emission angles below 60 degrees, most by three views or more of 24."""
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(truth.surface.faces), 4000, replace=False)
    count = views_of_triangles(truth, chosen, 60.0)
    assert np.mean(count >= 1) > 0.95
    assert np.mean(count >= 3) > 0.7
    direction = unit(truth.surface.vertices[truth.surface.faces[chosen, 0]])
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        assert np.mean(count[direction @ axis > 0.8] >= 1) > 0.9


def test_triangles_seen_are_those_of_the_rays_of_their_views(coarse, truth):
    """A view's own hits count as seen by it, at any emission angle, unless they lie at a triangle's edge."""
    one = replace(truth, views=truth.views[[5]])
    pose, camera, sun = one.views.body_from_cam[0], one.views.cameras[0], one.views.sun[0]
    tracer = BodyRaycaster(truth.surface)
    pixel = np.stack(np.meshgrid(np.arange(4, 60.0), np.arange(4, 60.0)), -1).reshape(-1, 2)
    rays = unit(camera.ray_in_cam(pixel) @ pose.rotation.T)
    triangle, _ = tracer.rays.first_hit(np.broadcast_to(pose.translation, rays.shape), rays)
    lit = tracer.trace(pose.translation, rays, sun).lit
    hit = triangle >= 0
    seen = views_of_triangles(one, triangle[hit], 85.0, tracer.rays) > 0
    assert np.mean(seen[lit[hit]]) > 0.9
    assert np.mean(seen[~lit[hit]]) < 0.15


def test_pose_priors_scatter_by_what_they_state():
    options = replace(SMALL, views=600)
    poses, suns = draw_mission(np.random.default_rng(0), 600, 1.0, 3000.0, 300.0 * SPHERE[0], 5.0)
    camera = Camera("PINHOLE", 64, 64, (3000.0, 3000.0, 32.0, 32.0))
    true = measured_views(options, camera, poses, suns).body_from_cam
    found = [prior.cam_from_body.inverse() for prior in pose_priors(options, true)]
    turn = np.array([so3_log(true.rotation[k].T @ pose.rotation) for k, pose in enumerate(found)])
    shift = np.array([pose.translation - true.translation[k] for k, pose in enumerate(found)])
    errors = np.concatenate([turn / np.radians(0.1), shift / 30.0], 1)
    np.testing.assert_allclose(np.cov(errors.T), np.eye(6), atol=0.2)


@pytest.mark.parametrize("brightness", ["iof", "dn"])
def test_same_options_give_the_same_bytes(tmp_path, brightness):
    options = replace(SMALL, views=4, image_size=32, brightness=brightness, detector=Detector(smear_px=1.0))
    first, second = (simulate_site(options, tmp_path / name).parent for name in "ab")
    assert files(first) == files(second)


def test_truth_survives_its_file_and_is_not_taken_for_a_place(truth, tmp_path):
    write_body_truth(tmp_path / "copy.h5", truth)
    copy = read_body_truth(tmp_path / "copy.h5")
    for key in ("vertices", "faces", "normals", "albedo"):
        np.testing.assert_array_equal(getattr(copy.surface, key), getattr(truth.surface, key))
    np.testing.assert_array_equal(copy.views.sun, truth.views.sun)
    assert (copy.gsd, copy.surface.spacing, copy.photometry) == (truth.gsd, truth.surface.spacing, truth.photometry)
    with pytest.raises(InputError, match="is the truth of a whole body, where the truth of a place is wanted"):
        read_truth(tmp_path / "copy.h5")
    hole = replace(truth, surface=replace(truth.surface, faces=truth.surface.faces[1:]))
    write_body_truth(tmp_path / "hole.h5", hole)
    with pytest.raises(InputError, match="the mesh is not closed"):
        read_body_truth(tmp_path / "hole.h5")


def test_a_shape_from_a_file_keeps_its_form_and_frame(tmp_path):
    """An ellipsoid in km, its faces turned inwards: relief stays small against it, and its axes and origin are kept."""
    vertices, faces = refine(*icosahedron(), 0.12, unit)
    vertices = vertices * [0.30, 0.22, 0.18] + [0.02, 0.0, 0.01]
    write_obj(tmp_path / "a.obj", vertices, faces[:, ::-1], normal=unit(vertices))
    options = SimulationOptions(shape=tmp_path / "a.obj", surface_unit="km", views=4, image_size=48)
    truth = read_body_truth(simulate_site(options, tmp_path / "site").with_name("truth.h5"))
    body = truth.surface
    level = np.linalg.norm((body.vertices - [20.0, 0.0, 10.0]) / [300.0, 220.0, 180.0], axis=1)
    assert is_watertight(body.faces)
    assert signed_volume(body.vertices, body.faces) == pytest.approx(4 / 3 * np.pi * 300 * 220 * 180, rel=0.03)
    assert level.mean() == pytest.approx(1.0, abs=0.02)
    assert 0.002 < level.std() < 0.03
    assert len(body.vertices) > 4 * len(vertices)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v, f: (v, f[1:]), "not a closed mesh"),
        (lambda v, f: (v + [50.0, 0.0, 0.0], f), "its origin is 50 m from the middle"),
        (lambda v, f: (v, np.concatenate([f[:1, ::-1], f[1:]])), "not a closed mesh"),
    ],
)
def test_shapes_that_are_no_bodies_are_refused(tmp_path, change, message):
    vertices, faces = change(*icosahedron())
    write_obj(tmp_path / "a.obj", vertices, faces, normal=vertices)
    with pytest.raises(InputError, match=message):
        given_shape(tmp_path / "a.obj", 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"preset": "moon"}, "known: demo, cornelia, ahuna, ikapati, topshape, bilobed, potato"),
        ({"preset": "potato", "surface": Path("a.obj")}, "give --shape for a whole body"),
        ({"preset": "potato", "region_size": 20}, "choose a place"),
        ({"preset": "bilobed", "lighting": "harsh"}, "--lighting and --max-emission-deg are of places"),
        ({"preset": "bilobed", "max_emission_deg": 30.0}, "--lighting and --max-emission-deg are of places"),
        ({"preset": "ahuna", "shape": Path("a.obj")}, "--shape goes with --preset topshape or bilobed or potato"),
    ],
)
def test_options_that_do_not_fit_a_body_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        SimulationOptions(**change)


def test_too_fine_relief_is_refused_before_it_takes_all_memory(tmp_path):
    with pytest.raises(InputError, match="choose a larger --gsd"):
        simulate_site(replace(SMALL, gsd=0.01), tmp_path / "fine")
    assert not list(tmp_path.iterdir())


def test_without_embree_the_extra_is_named(coarse, monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    with pytest.raises(InputError, match=r"pip install photoclinometry\[body\]"):
        BodyRaycaster(coarse)
