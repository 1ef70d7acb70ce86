"""Metrics by hand, alignment that recovers known similarities, and comparisons that report what was disturbed."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from photoclinometry.evaluate.compare import (
    compare_with_truth,
    evaluate_against_map,
    evaluate_against_truth,
    frame_metrics,
)
from photoclinometry.evaluate.evaluate import (
    completeness,
    evaluate_scene,
    keypoint_residual_px,
    landmark_photometric_error,
    view_table,
)
from photoclinometry.evaluate.metrics import (
    albedo_error,
    landmark_error,
    normal_error,
    photometric_error,
    psnr,
    spread,
)
from photoclinometry.evaluate.tables import markdown, metric_rows
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, so3_log, tangent_basis, unit
from photoclinometry.model.mesh import grid_faces
from photoclinometry.model.reflectance import published
from photoclinometry.model.scene import Landmarks, Region, Scene
from photoclinometry.registration.alignment import align_poses, refine_on_surface, transform_poses, transform_scene
from photoclinometry.registration.closest_points import CloudSurface, MeshSurface
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.truth import truth_maps
from photoclinometry.simulate.truth_file import read_truth
from scenes import BumpySurface, bumpy_surface, synthetic_images, synthetic_scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return synthetic_scene(size=30)


OTHER_FRAME = Similarity(0.002, so3_exp(np.array([0.4, -1.1, 0.7])), np.array([3.0, -2.0, 5.0]))


def on_bumps(surface: BumpySurface):
    """Nearest points of an analytic height field, by Newton steps along its gradient."""

    def closest(points):
        foot = points.copy()
        for _ in range(20):
            xy = foot[:, :2]
            normal = surface.normal(xy)
            above = points - np.concatenate([xy, surface.height(xy)[:, None]], -1)
            slide = above - np.sum(above * normal, -1, keepdims=True) * normal
            foot = foot + slide
        foot[:, 2] = surface.height(foot[:, :2])
        return foot, np.ones(len(points), bool)

    return closest


@dataclass
class TrueMaps:
    """What `simulate.truth.truth_maps` gives, for the analytic site."""

    position: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    hit: np.ndarray
    normal_mean: np.ndarray
    albedo_mean: np.ndarray


def truth_of(scene: Scene) -> TrueMaps:
    marks = scene.landmarks
    normal, albedo = scene.grid(marks.normal), scene.grid(marks.albedo)
    hit = np.isfinite(albedo)
    return TrueMaps(scene.grid(marks.position), normal, albedo, hit, normal, albedo)


def compare(found: Scene, true: Scene):
    return compare_with_truth(found, true.views, truth_of(true), on_bumps(bumpy_surface())).metrics


def test_photometric_error_by_hand():
    """Residuals 3 and 4 around a mean of 10: sqrt(25 / 2) / 10; one landmark has no observation."""
    error = photometric_error(np.array([11.0, 17.0, 5.0]), np.array([8.0, 12.0 + 1.0, 5.0]), np.array([0, 0, 2]), 3)
    assert error[0] == pytest.approx(np.sqrt(12.5) / 10.5)
    assert np.isnan(error[1])
    assert error[2] == 0.0


def test_psnr_by_hand():
    """Of a peak of 4, errors 0.4 and 0 on two pixels: MSE = 0.01 / 2, 23.01 dB; the masked pixel is ignored."""
    image, rendered = np.array([[4.0, 2.0, 1.0]]), np.array([[3.6, 2.0, 9.0]])
    mask = np.array([[True, True, False]])
    assert psnr(image, rendered, mask, 4.0) == pytest.approx(10 * np.log10(200.0))
    assert psnr(image, image, mask, 4.0) == np.inf
    assert np.isnan(psnr(image, image, ~mask & mask, 4.0))


def test_normal_and_albedo_errors_by_hand():
    normal = np.array([0.0, np.sin(1e-9), np.cos(1e-9)])
    assert normal_error(normal, np.array([0.0, 0.0, 5.0])) == pytest.approx(1e-9)  # arccos would give 0
    assert albedo_error(np.array(0.33), np.array(0.30)) == pytest.approx(0.1)


def test_landmark_error_by_hand():
    """The nearest of two points, 3-4-5; and the surface between them is nearer than either."""
    reference = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
    assert landmark_error(np.array([[3.0, 4.0, 0.0], [9.0, 0.0, 0.0]]), reference) == pytest.approx([5.0, 1.0])


def test_spread_ignores_gaps_and_signs():
    found = spread(np.array([3.0, -4.0, np.nan]), "error", "m")
    assert found == pytest.approx(
        {"error_mean_m": 3.5, "error_median_m": 3.5, "error_rms_m": np.sqrt(12.5), "error_p90_m": 3.9}
    )
    assert spread(np.array([np.nan]), "error", "m") == {}


@pytest.mark.parametrize("layout", ["spread", "coplanar", "collinear"])
def test_pose_alignment_recovers_a_similarity_also_from_degenerate_centres(layout):
    rng = np.random.default_rng(1)
    centers = rng.normal(size=(6, 3)) * {"spread": (9, 9, 9), "coplanar": (9, 9, 0), "collinear": (9, 0, 0)}[layout]
    poses = Rigid(so3_exp(rng.normal(size=(6, 3))), centers)
    found = align_poses(poses, transform_poses(OTHER_FRAME, poses), distance=30.0)
    assert found.scale == pytest.approx(OTHER_FRAME.scale, rel=1e-12)
    np.testing.assert_allclose(found.rotation, OTHER_FRAME.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, OTHER_FRAME.translation, atol=1e-12)


def test_pose_alignment_of_noisy_collinear_centres_keeps_the_orientation():
    """Centres on a line say nothing about turning around it; axes good to 1 mrad do."""
    rng = np.random.default_rng(2)
    centers = np.stack([np.linspace(0, 100, 8), *(0.01 * rng.normal(size=(2, 8)))], -1)
    poses = Rigid(so3_exp(rng.normal(size=(8, 3))), centers)
    true = transform_poses(OTHER_FRAME, poses)
    turned = so3_exp(1e-3 * rng.normal(size=(8, 3)))
    true = Rigid(true.rotation @ turned, true.translation + 2e-5 * rng.normal(size=(8, 3)))
    found = align_poses(poses, true, distance=500.0)
    assert np.linalg.norm(so3_log(found.rotation @ OTHER_FRAME.rotation.T)) < 2e-3


def test_pose_alignment_refuses_cameras_at_one_place():
    poses = Rigid(np.stack([np.eye(3)] * 3), np.ones((3, 3)))
    with pytest.raises(InputError, match="one place"):
        align_poses(poses, poses, distance=1.0)


def test_a_transformed_scene_predicts_the_same_images(scene):
    moved = transform_scene(OTHER_FRAME, scene)
    np.testing.assert_allclose(keypoint_residual_px(moved), 0.0, atol=1e-7)
    np.testing.assert_allclose(landmark_photometric_error(moved), 0.0, atol=1e-9)
    assert moved.gsd == pytest.approx(scene.gsd * OTHER_FRAME.scale)


def test_surface_refinement_repairs_scale_and_tilt(scene):
    wrong = Similarity(1.003, so3_exp(np.array([2e-3, -3e-3, 2e-3])), np.array([20.0, -30.0, 40.0]))
    marks = transform_scene(wrong, scene).landmarks
    fit = refine_on_surface(
        marks.position, marks.normal, on_bumps(bumpy_surface()), Similarity(1.0, np.eye(3), np.zeros(3))
    )
    assert fit.determined == 7
    back = fit.similarity @ wrong
    assert back.scale == pytest.approx(1.0, abs=1e-6)
    assert np.abs(fit.distance).max() < 1e-3


def test_surface_refinement_leaves_alone_what_a_plane_cannot_tell():
    """On a plane, height and two tilts are determined; sliding, turning about the normal and scale are not."""
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(-1, 1, (400, 2)), np.full((400, 1), 0.2)], -1)
    normals = np.tile([0.0, 0.0, 1.0], (400, 1))

    def plane(p):
        return p * [1.0, 1.0, 0.0], np.ones(len(p), bool)

    fit = refine_on_surface(points, normals, plane, Similarity(1.5, np.eye(3), np.zeros(3)))
    assert fit.determined == 3
    assert fit.similarity.scale == pytest.approx(1.5)
    np.testing.assert_allclose(fit.similarity.translation[:2], 0.0, atol=1e-9)
    np.testing.assert_allclose(fit.distance, 0.0, atol=1e-9)


def test_nearest_point_of_a_mesh_is_that_of_all_its_triangles(scene):
    position = scene.grid(scene.landmarks.position)
    faces = grid_faces(position, np.ones(position.shape[:2], bool))
    mesh = MeshSurface(scene.landmarks.position, faces)
    points = scene.landmarks.position[::37] + np.random.default_rng(4).normal(size=(25, 3)) * 20.0
    foot, inside = mesh(points)
    # a fine barycentric sampling of every triangle is never nearer, and nearly as near
    weights = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12
    samples = np.einsum("wk,fkd->fwd", weights, mesh.vertices[faces]).reshape(-1, 3)
    sampled = np.array([np.linalg.norm(samples - p, axis=-1).min() for p in points])
    exact = np.linalg.norm(points - foot, axis=-1)
    assert (exact <= sampled + 1e-9).all()
    assert (sampled**2 - exact**2 < 5.0**2).all()
    assert inside.mean() > 0.7
    _, inside = mesh(np.array([[1e4, 1e4, 0.0], [0.0, 0.0, 10.0]]))
    assert inside.tolist() == [False, True]


def test_an_exact_scene_in_another_frame_has_no_error(scene):
    metrics = compare(transform_scene(OTHER_FRAME.inverse(), scene), scene)
    for key in (
        "surface_distance_rms_m",
        "landmark_error_rms_m",
        "position_error_rms_m",
        "normal_error_mean_deg",
        "camera_position_error_rms_m",
        "camera_relative_rotation_error_max_deg",
        "sun_error_mean_deg",
        "keypoint_error_mean_px",
        "albedo_error_mean_percent",
        "albedo_error_absolute_mean_percent",
        "scale_error_mean_percent",
    ):
        assert metrics[key] == pytest.approx(0.0, abs=2e-3), key


def test_disturbances_are_reported_at_their_size(scene):
    """Normals turned by 2 degrees, albedos 5 % up and down, keypoints 0.3 px, one Sun by 1 degree."""
    rng = np.random.default_rng(5)
    marks = scene.landmarks
    axis = np.einsum("jik,jk->ji", tangent_basis(marks.normal), unit(rng.normal(size=(len(marks), 2))))
    sign = np.where(np.arange(len(marks)) % 2, 1.05, 0.95)
    sun = scene.views.sun.copy()
    sun[1] = so3_exp(np.deg2rad(1.0) * unit(np.cross(sun[1], [1.0, 0, 0]))) @ sun[1]
    disturbed = replace(
        scene,
        landmarks=replace(
            marks,
            normal=np.einsum("jab,jb->ja", so3_exp(np.deg2rad(2.0) * axis), marks.normal),
            albedo=marks.albedo * sign,
        ),
        tracks=replace(scene.tracks, keypoint=scene.tracks.keypoint + np.array([0.3, 0.0])),
        views=replace(scene.views, sun=sun),
    )
    metrics = compare(disturbed, scene)
    assert metrics["normal_error_mean_deg"] == pytest.approx(2.0, abs=0.01)
    assert metrics["normal_error_p90_deg"] == pytest.approx(2.0, abs=0.01)
    assert metrics["albedo_error_absolute_mean_percent"] == pytest.approx(5.0, abs=1e-6)
    assert metrics["keypoint_error_median_px"] == pytest.approx(0.3, abs=1e-4)
    assert metrics["sun_error_mean_deg"] == pytest.approx(1.0 / 6, abs=1e-3)
    assert metrics["surface_distance_mean_m"] < 0.5


def test_relative_albedo_is_compared_after_one_common_factor():
    scene = synthetic_scene(size=20, reflectance=published("mcewen"))
    doubled = replace(
        scene,
        landmarks=replace(scene.landmarks, albedo=2.0 * scene.landmarks.albedo),
        views=replace(scene.views, scale=scene.views.scale / 2.0),
    )
    metrics = compare(doubled, scene)
    assert metrics["albedo_factor"] == pytest.approx(0.5)
    assert metrics["albedo_error_mean_percent"] == pytest.approx(0.0, abs=1e-9)
    assert metrics["scale_error_mean_percent"] == pytest.approx(0.0, abs=1e-9)
    assert "albedo_error_absolute_mean_percent" not in metrics


def test_noise_on_heights_is_the_distance_to_the_surface(scene):
    """Along the normal by 6 m RMS: point-to-surface 6 m and 0.1 GSD."""
    rng = np.random.default_rng(6)
    marks = scene.landmarks
    noisy = marks.position + 6.0 * rng.normal(size=(len(marks), 1)) * marks.normal
    metrics = compare(replace(scene, landmarks=replace(marks, position=noisy)), scene)
    assert metrics["surface_distance_rms_m"] == pytest.approx(6.0, rel=0.05)
    assert metrics["surface_distance_rms_gsd"] == pytest.approx(0.1, rel=0.05)
    assert metrics["surface_distance_rms_gsd"] <= metrics["landmark_error_rms_gsd"] <= metrics["position_error_rms_gsd"]


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_comparison_with_a_map_by_published_poses(scene, kind):
    """A map in another frame and unit, cameras named by file name alone."""
    theirs = transform_scene(OTHER_FRAME, scene)
    faces = None
    if kind == "mesh":
        position = scene.grid(scene.landmarks.position)
        faces = grid_faces(position, np.ones(position.shape[:2], bool))
    reference = SimpleNamespace(
        position=theirs.landmarks.position,
        normal=theirs.landmarks.normal,
        albedo=theirs.landmarks.albedo,
        faces=faces,
    )
    names = [name.rsplit("/")[-1] for name in scene.views.name]
    order = [3, 1, 0, 4, 5]
    metrics = evaluate_against_map(
        scene,
        reference,
        names=[names[k] for k in order],
        body_from_cam=theirs.views.body_from_cam[order],
        unit="km",
    ).metrics
    assert metrics["overlap_percent"] > 80
    assert metrics["surface_distance_rms_gsd"] < 1e-4
    assert metrics["landmark_error_rms_km"] < 1e-5
    assert metrics["normal_error_rms_deg"] < 1e-3
    assert metrics["albedo_error_mean_percent"] < 1e-6
    assert metrics["camera_position_error_rms_km"] < 1e-6


def test_cloud_normals_come_from_neighbours(scene):
    cloud = CloudSurface(scene.landmarks.position, None)
    cosine = np.abs(np.sum(cloud.normals * scene.landmarks.normal, -1))
    assert np.degrees(np.arccos(np.median(cosine))) < 3.0


def test_poses_of_other_views_are_refused(scene):
    reference = SimpleNamespace(position=scene.landmarks.position, normal=None, albedo=None, faces=None)
    with pytest.raises(InputError, match="2 are needed"):
        evaluate_against_map(scene, reference, names=["other.png"], body_from_cam=scene.views.body_from_cam[:1])


def test_an_exact_scene_explains_its_images(scene):
    """PSNR above 50 dB is the mesh's interpolation error; everything else is zero."""
    images = synthetic_images(scene)
    metrics = evaluate_scene(scene, images[::-1])
    assert metrics["photometric_error_mean_percent"] == pytest.approx(0.0, abs=1e-9)
    assert metrics["keypoint_residual_rms_px"] == pytest.approx(0.0, abs=1e-7)
    assert metrics["completeness_percent"] == 100.0
    assert metrics["psnr_min_db"] > 50.0
    rows = view_table(scene, images)
    assert [row["name"] for row in rows] == list(scene.views.name)
    assert rows[1]["keypoints"] == 900


def test_photometric_error_finds_brightness_noise_with_and_without_bias():
    scene = synthetic_scene(size=20, reflectance=published("mcewen"), brightness_noise=0.02)
    metrics = evaluate_scene(scene)
    assert metrics["photometric_error_mean_percent"] == pytest.approx(2.0, rel=0.1)
    without = metrics["photometric_error_without_scale_and_bias_mean_percent"]
    assert metrics["photometric_error_mean_percent"] < without < 4.0
    assert "psnr_mean_db" not in metrics


def test_completeness_counts_lit_pixels_only(scene):
    lit = np.zeros((30, 30), bool)
    lit[:, :15] = True
    keep = scene.landmarks.pixel[:, 0] < scene.region.row + 15
    marks = scene.landmarks
    half = replace(
        scene,
        landmarks=replace(marks, **{k: getattr(marks, k)[keep] for k in ("position", "normal", "albedo", "pixel")}),
    )
    assert completeness(half, lit) == 0.5


def test_a_scene_made_of_a_simulations_own_truth_has_no_error(tmp_path):
    """The whole way through truth.h5, in another frame: what is left is rounding and the surface's fit."""
    path = simulate_site(SimulationOptions(views=3, image_size=128, region_size=48), tmp_path / "site")
    truth = read_truth(path.with_name("truth.h5"))
    region = Region(row=40, col=40, height=48, width=48)
    maps = truth_maps(truth, truth.views.name[0], region)
    assert maps.hit.all()
    example = synthetic_scene(size=48, views=3)
    position = maps.position.reshape(-1, 3)
    keypoint = np.stack([truth.views.project(k, position) for k in range(3)], 1).reshape(-1, 2)
    found = replace(
        example,
        views=truth.views,
        region=region,
        landmarks=Landmarks(
            position=position,
            normal=maps.normal_mean.reshape(-1, 3),
            albedo=maps.albedo_mean.ravel(),
            pixel=example.landmarks.pixel - example.landmarks.pixel[0] + np.int32(40),
        ),
        tracks=replace(example.tracks, keypoint=keypoint),
    )
    metrics = evaluate_against_truth(transform_scene(OTHER_FRAME, found), truth).metrics
    assert metrics["surface_distance_rms_gsd"] < 1e-3
    assert metrics["position_error_rms_gsd"] < 1e-3
    assert metrics["normal_error_mean_deg"] < 0.01
    assert metrics["albedo_error_mean_percent"] < 1e-6
    assert metrics["keypoint_error_mean_px"] < 1e-6
    assert metrics["camera_position_error_rms_m"] < 1e-2
    assert metrics["normal_error_at_point_mean_deg"] > 0.5  # relief below a pixel
    assert metrics["completeness_truly_lit_percent"] == 100.0


def test_a_frame_that_is_off_is_told_by_hand():
    """Scale 1 % too small, turned by 0.1 rad, and moved by 5 m: of three landmarks, one of which has no truth."""
    true_from_found = Similarity(1.01, so3_exp(np.array([0.0, 0.1, 0.0])), np.zeros(3))
    position = np.array([[3.0, 4.0, 0.0], [3.0, 4.0, 1.0], [9.0, 9.0, 9.0]])
    true = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [np.nan] * 3])
    found = frame_metrics(true_from_found, position, true)
    assert found["frame_offset_m"] == pytest.approx(5.0)
    assert found["frame_turn_deg"] == pytest.approx(np.degrees(0.1))
    assert found["frame_scale_error_percent"] == pytest.approx(100.0 / 1.01 - 100.0)


def test_geometry_alone_is_evaluated_without_photometry():
    scene = synthetic_scene(size=12, reflectance=None)
    metrics = evaluate_scene(scene, synthetic_images(scene))
    assert not any(key.startswith(("photometric", "psnr")) for key in metrics)
    assert "completeness_percent" in metrics


def test_an_image_of_another_size_is_refused(scene):
    image = synthetic_images(scene)[0]
    with pytest.raises(InputError, match="another site"):
        evaluate_scene(scene, [replace(image, brightness=image.brightness[:-1], valid=image.valid[:-1])])


def test_tables_read_units_from_keys():
    metrics = {**spread(np.array([1.0, 2.0]), "normal_error", "deg"), "psnr_mean_db": 40.25, "views": 29}
    spreads, singles = metric_rows(metrics)
    assert spreads == [("normal error", "°", "1.5", "1.5", "1.581", "1.9")]
    assert singles == [("PSNR mean", "40.25 dB"), ("views", "29")]
    assert "| normal error | ° | 1.5 |" in markdown(metrics, "Site")
