"""A comparison reports what was disturbed, at its size; an exact scene in another frame has no error."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from photoclinometry.evaluate.compare import (
    compare_with_truth,
    evaluate_against_map,
    evaluate_against_truth,
    frame_metrics,
)
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity, so3_exp, tangent_basis, unit
from photoclinometry.model.mesh import grid_faces
from photoclinometry.model.reflectance import published
from photoclinometry.model.region import Region
from photoclinometry.model.scene import Landmarks, Scene
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.registration.closest_points import CloudSurface
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.truth import truth_maps
from photoclinometry.simulate.truth_file import read_truth
from scenes import bumpy_surface, synthetic_scene
from truths import OTHER_FRAME, on_bumps, truth_of


@pytest.fixture(scope="module")
def scene() -> Scene:
    return synthetic_scene(size=30)


def compare(found: Scene, true: Scene):
    return compare_with_truth(found, true.views, truth_of(true), on_bumps(bumpy_surface())).metrics


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


def test_position_errors_are_told_apart_by_direction(scene):
    """Squares of the two parts add up to that of the whole; of noise alike in all directions, one and two thirds."""
    rng = np.random.default_rng(6)
    marks = scene.landmarks
    moved = replace(marks, position=marks.position + 0.2 * scene.gsd * rng.normal(size=marks.position.shape))
    metrics = compare(scene.with_estimate(scene.views, moved), scene)
    whole, along, sideways = (metrics[f"position_error{part}_rms_gsd"] for part in ("", "_along_normal", "_sideways"))
    assert whole**2 == pytest.approx(along**2 + sideways**2)
    assert along**2 / whole**2 == pytest.approx(1 / 3, abs=0.05)


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


def test_a_map_that_its_cameras_put_far_off_is_compared_with_its_ground(scene):
    """All cameras 30 GSD beside and 60 above where the landmarks would have them; all else is exact."""
    views = scene.views
    away = views.body_from_cam.translation + scene.gsd * np.array([30.0, 0.0, 60.0])
    moved = replace(scene, views=replace(views, body_from_cam=replace(views.body_from_cam, translation=away)))
    metrics = compare(moved, scene)
    assert metrics["surface_distance_mean_gsd"] < 1e-3
    assert metrics["normal_error_mean_deg"] < 0.05
    near = replace(views.body_from_cam, translation=away - scene.gsd * np.array([29.0, 0.0, 59.5]))
    assert compare(replace(scene, views=replace(views, body_from_cam=near)), scene)["surface_distance_mean_gsd"] < 1e-3
