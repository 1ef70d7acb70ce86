from dataclasses import replace

import numpy as np
import pytest

import photoclinometry as pcm
from photoclinometry.evaluate.body import align_body, compare_body
from photoclinometry.io.meshes.obj import write_obj
from photoclinometry.io.meshes.shape_ply import write_shape_ply
from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity, so3_exp, unit
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.registration.alignment import transform_poses
from photoclinometry.simulate.bodies.orbits import draw_mission
from photoclinometry.simulate.bodies.surface import BodySurface
from photoclinometry.simulate.bodies.truth import BodyTruth
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.photometry import named_photometry
from photoclinometry.simulate.views import measured_views
from photoclinometry.surface.closed_mesh import icosahedron, refine, signed_volume, vertex_normals

pytest.importorskip("embreex")

RADIUS, GSD = 100.0, 12.0


def truth_of(vertices, faces, gsd=GSD):
    albedo = 0.2 + 0.02 * np.sin(vertices[:, 0] / 20.0)
    poses, suns = draw_mission(np.random.default_rng(0), 40, gsd, 500.0, vertices, 0.0)
    camera = Camera("PINHOLE", 64, 64, (500.0, 500.0, 32.0, 32.0))
    return BodyTruth(
        name="ball",
        body="vesta",
        views=measured_views(SimulationOptions(), camera, poses, suns),
        psf_sigma_px=0.5,
        brightness="iof",
        photometry=named_photometry("lunar-lambert", "vesta"),
        surface=BodySurface(vertices, faces, vertex_normals(vertices, faces), albedo, 0.5 * gsd),
        gsd=gsd,
    )


def ball_of(gsd):
    vertices, faces = refine(*icosahedron(), 0.5 * gsd / RADIUS, unit)
    return truth_of(RADIUS * vertices, faces, gsd)


@pytest.fixture(scope="module")
def ball():
    return ball_of(GSD)


@pytest.fixture(scope="module")
def fine_ball():
    """Of half the ground sample distance, for what its facets cut off and what lies at its edges."""
    return ball_of(0.5 * GSD)


@pytest.fixture(scope="module")
def egg():
    """Without symmetry, so that a surface alone determines its frame."""
    direction, faces = refine(*icosahedron(), 0.5 * GSD / RADIUS, unit)
    x, y, z = direction.T
    radius = RADIUS * (1.0 + 0.25 * x + 0.15 * x * y + 0.1 * z * z + 0.05 * np.sin(5 * y) * z)
    return truth_of(radius[:, None] * direction, faces)


def same(truth):
    surface = truth.surface
    return ShapeModel(surface.vertices, surface.faces, surface.normals, surface.albedo)


def test_the_truth_against_itself_has_no_errors(ball):
    figures = compare_body(same(ball), ball, mean_over_gsd=0.0)
    for name in ("distance", "distance_back"):
        assert figures[f"{name}_mean_gsd"] < 1e-9
    assert figures["completeness_percent"] == 100.0
    assert figures["seen_percent"] > 90.0
    assert figures["normal_mean_deg"] < 1e-4
    assert figures["albedo_mean_percent"] < 1e-9
    assert figures["volume_percent"] == pytest.approx(0.0, abs=1e-9)


def test_a_swollen_ball_is_off_by_what_it_was_moved(ball):
    off = 0.7 * GSD
    found = replace(same(ball), vertices=ball.surface.vertices * (1.0 + off / RADIUS))
    figures = compare_body(found, ball)
    for name in ("distance", "distance_back"):
        assert figures[f"{name}_mean_gsd"] == pytest.approx(0.7, rel=0.01)
        assert figures[f"{name}_p90_gsd"] == pytest.approx(0.7, rel=0.01)
    assert figures["completeness_percent"] == 100.0
    assert figures["volume_percent"] == pytest.approx(100 * ((1 + off / RADIUS) ** 3 - 1), rel=1e-6)
    away = replace(same(ball), vertices=ball.surface.vertices * (1.0 + 2.0 * GSD / RADIUS))
    figures = compare_body(away, ball)
    assert figures["completeness_percent"] == 0.0
    assert "normal_mean_deg" not in figures  # no vertex near the truth


def test_half_a_ball_is_half_complete(fine_ball):
    """What is missing shows in the distance from the truth to the mesh, not in that from the mesh to the truth."""
    vertices, faces = fine_ball.surface.vertices, fine_ball.surface.faces
    figures = compare_body(replace(same(fine_ball), faces=faces[vertices[faces].mean(1)[:, 2] > 0]), fine_ball)
    assert figures["completeness_percent"] == pytest.approx(50.0, abs=4.0)
    assert figures["distance_p90_gsd"] < 1e-6
    assert figures["distance_back_p90_gsd"] > 10.0


def test_normals_and_albedos_are_off_by_what_they_were_changed(ball):
    """Normals turned by 3 degrees about random axes; albedos times a common factor and 2 % noise."""
    rng = np.random.default_rng(0)
    normals = ball.surface.normals
    axis = unit(np.cross(normals, rng.standard_normal(normals.shape)))
    turned = np.einsum("nij,nj->ni", so3_exp(np.radians(3.0) * axis), normals)
    albedo = 1.7 * ball.surface.albedo * (1.0 + 0.02 * rng.standard_normal(len(normals)))
    figures = compare_body(replace(same(ball), normals=turned, albedo=albedo), ball, mean_over_gsd=0.0)
    assert figures["normal_mean_deg"] == pytest.approx(3.0, rel=0.01)
    assert figures["albedo_rms_percent"] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("psf_px", [0.0, 0.5])
def test_normals_and_albedos_are_compared_at_the_resolution_of_the_images(fine_ball, psf_px):
    """Waves of albedo that pixels and optics show with exp(-2 (pi s / wavelength)^2) of their height are right so."""
    wavelength, surface = 6.0 * fine_ball.gsd, fine_ball.surface
    from_pole = RADIUS * np.arccos(np.clip(surface.vertices[:, 2] / RADIUS, -1.0, 1.0))
    wave = np.sin(2.0 * np.pi * from_pole / wavelength)
    truth = replace(fine_ball, psf_sigma_px=psf_px, surface=replace(surface, albedo=1.0 + 0.2 * wave))
    sigma = fine_ball.gsd * np.sqrt(psf_px**2 + np.var(np.linspace(-0.5, 0.5, 10001)))
    height = 0.2 * np.exp(-2.0 * (np.pi * sigma / wavelength) ** 2)
    shown, true = (
        compare_body(replace(same(fine_ball), albedo=1.0 + h * wave), truth)["albedo_rms_percent"]
        for h in (height, 0.2)
    )
    assert true == pytest.approx(100.0 * (0.2 - height) / np.sqrt(2.0), rel=0.25)
    assert shown < 0.3 * true


def test_the_volume_of_a_ball_is_that_of_a_sphere(fine_ball):
    assert signed_volume(fine_ball.surface.vertices, fine_ball.surface.faces) == pytest.approx(
        4 / 3 * np.pi * RADIUS**3, rel=0.001
    )


def test_a_mesh_in_another_frame_is_brought_back_by_its_poses(egg):
    moved = Similarity(0.013, so3_exp(np.array([1.0, -2.0, 0.4])), np.array([3.0, -8.0, 1.0]))
    poses = transform_poses(moved, egg.views.body_from_cam)
    back = align_body(same(egg).moved(moved), egg, poses[:10], egg.views.name[:10])
    again = same(egg).moved(back @ moved)
    np.testing.assert_allclose(again.vertices, egg.surface.vertices, atol=1e-6)
    np.testing.assert_allclose(again.normals, egg.surface.normals, atol=1e-9)


def test_a_mesh_near_its_place_is_aligned_by_its_surface(egg):
    moved = Similarity(1.01, so3_exp(np.array([0.01, -0.02, 0.01])), np.array([1.0, -2.0, 1.0]))
    back = align_body(same(egg).moved(moved), egg)
    np.testing.assert_allclose((back @ moved)(egg.surface.vertices), egg.surface.vertices, atol=0.05 * GSD)


def test_what_cannot_be_compared_is_refused(ball):
    with pytest.raises(InputError, match="no faces"):
        compare_body(replace(same(ball), faces=np.empty((0, 3), int)), ball)
    with pytest.raises(InputError, match="name of a view each"):
        align_body(same(ball), ball, ball.views.body_from_cam)
    with pytest.raises(InputError, match="no view 'x'"):
        align_body(same(ball), ball, ball.views.body_from_cam[:1], ("x",))


def test_vertices_without_albedo_do_not_count(ball):
    found = same(ball)
    albedo = 1.1 * found.albedo
    albedo[::3] = np.nan
    figures = compare_body(replace(found, albedo=albedo), ball)
    assert figures["albedo_mean_percent"] == pytest.approx(0.0, abs=0.5)
    assert "albedo_mean_percent" not in compare_body(replace(found, albedo=np.full(len(albedo), np.nan)), ball)


@pytest.mark.parametrize(("over_true", "within"), [(1.0, 68.3), (0.5, 38.3)])
def test_stated_sigmas_are_judged_by_the_errors(ball, over_true, within):
    rng, found = np.random.default_rng(0), same(ball)
    count, height, albedo = len(found.vertices), 0.1 * GSD, 0.05
    sigma = {"height": np.full(count, over_true * height), "albedo": np.full(count, over_true * albedo)}
    noisy = replace(
        found,
        vertices=found.vertices + height * rng.normal(size=(count, 1)) * found.normals,
        albedo=found.albedo * (1.0 + albedo * rng.normal(size=count)),
        sigma=sigma,
    )
    figures = compare_body(noisy, ball, mean_over_gsd=0.0)
    for name in sigma:
        assert figures[f"{name}_sigma_within_68_percent"] == pytest.approx(within, abs=3.0)
        assert figures[f"{name}_sigma_nees"] == pytest.approx(over_true**-2, rel=0.1)


@pytest.mark.parametrize("other", ["cameras", "site"])
def test_what_a_body_is_not_compared_with_is_refused(tmp_path, other):
    (tmp_path / "body.ply").write_text("")
    with pytest.raises(InputError, match="cameras, a site and the map of a place say nothing of it"):
        pcm.evaluate(tmp_path, truth=tmp_path / "truth.h5", **{other: tmp_path})


@pytest.mark.parametrize("given", [{}, {"truth": "truth.h5", "reference": "shape.obj"}])
def test_a_body_is_compared_with_one_thing(tmp_path, given):
    (tmp_path / "body.ply").write_text("")
    with pytest.raises(InputError, match=r"give --truth \(truth.h5 of its simulation\) or --reference \(a mesh\)"):
        pcm.evaluate(tmp_path, **given)


def test_a_body_beside_a_published_shape_in_kilometres(tmp_path, egg):
    """The figures are those by which the shape was changed: moved, turned, and with a wave of 2 m along its normals."""
    shape = same(egg)
    move = Similarity(1.0, so3_exp(np.array([0.0, 0.01, 0.0])), np.array([1.0, -0.5, 0.3]))
    wave = 2.0 * np.sin(shape.vertices[:, :1] / 4.0)
    changed = replace(shape, vertices=shape.vertices + wave * shape.normals, unit="m").moved(move, "m")
    write_shape_ply(tmp_path / "body.ply", changed)
    write_obj(tmp_path / "shape.obj", 1e-3 * shape.vertices, shape.faces, normal=shape.normals)
    found = pcm.evaluate(tmp_path, reference=tmp_path / "shape.obj", unit="km").metrics
    assert found["distance_rms_km"] == pytest.approx(2e-3 / np.sqrt(2.0), rel=0.15)
    assert found["distance_back_rms_km"] == pytest.approx(2e-3 / np.sqrt(2.0), rel=0.15)
    assert found["rotation_deg"] == pytest.approx(np.degrees(0.01), rel=0.2)
    assert found["shift_km"] == pytest.approx(1e-3 * np.linalg.norm([1.0, 0.5, 0.3]), rel=0.3)
    assert abs(found["scale_percent"]) < 0.1
    assert abs(found["volume_percent"]) < 0.5


def test_a_shape_in_the_frame_of_its_images_is_not_compared_with_a_published_one(tmp_path, egg):
    write_shape_ply(tmp_path / "body.ply", same(egg))
    write_obj(tmp_path / "shape.obj", egg.surface.vertices, egg.surface.faces, normal=egg.surface.normals)
    with pytest.raises(InputError, match="frame of its images alone"):
        pcm.evaluate(tmp_path, reference=tmp_path / "shape.obj")
