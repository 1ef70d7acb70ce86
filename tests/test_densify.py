"""Landmarks from matches: exact matches give exact points; wrong ones are found out."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.matching import Matches
from photoclinometry.matching.densify import DensifyOptions, densify
from photoclinometry.matching.epipolar import fundamental_matrix, sampson_error
from photoclinometry.matching.triangulation import PinholeCameras, triangulate, triangulate_tracks
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.model.geometry import Rigid
from scenes import synthetic_scene

VIEWS, SIZE = 6, 20


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=SIZE, views=VIEWS)


def exact_matches(scene, noise_px=0.0, seed=0):
    rng = np.random.default_rng(seed)
    xy = scene.tracks.keypoint.reshape(SIZE, SIZE, VIEWS, 2)
    shape = (SIZE, SIZE)
    return {
        view: Matches(
            position=xy[:, :, view] + noise_px * rng.normal(size=(*shape, 2)),
            certainty=np.ones(shape, np.float32),
            sigma_px=np.full(shape, 0.1, np.float32),
            valid=np.ones(shape, bool),
        )
        for view in range(1, VIEWS)
    }


def run(scene, matches, **options):
    views = scene.views
    return densify(scene.region, 0, matches, views.cameras, views.body_from_cam, DensifyOptions(**options))


def test_exact_matches_give_the_surface(scene):
    dense = run(scene, exact_matches(scene))
    np.testing.assert_array_equal(dense.pixel, scene.landmarks.pixel)
    np.testing.assert_allclose(dense.position, scene.landmarks.position, atol=1e-5 * scene.gsd)
    np.testing.assert_array_equal(dense.start, scene.tracks.start)
    np.testing.assert_array_equal(dense.view, scene.tracks.view)
    np.testing.assert_allclose(dense.keypoint, scene.tracks.keypoint, atol=1e-9)


def test_error_of_points_is_that_of_matches_and_base(scene):
    """0.1 px of noise and rays up to 30 degrees apart: a few tenths of a pixel along the line of sight."""
    dense = run(scene, exact_matches(scene, 0.1))
    error = np.linalg.norm(dense.position - scene.landmarks.position, axis=-1) / scene.gsd
    assert 0.02 < np.median(error) < 0.3


def test_matches_off_their_epipolar_line_are_dropped(scene):
    matches = exact_matches(scene)
    pose, camera = scene.views.body_from_cam, scene.views.cameras
    fundamental = fundamental_matrix(camera[0], pose[0], camera[3], pose[3])
    centers = scene.region.pixel_centers()
    line = np.concatenate([centers, np.ones_like(centers[..., :1])], -1) @ fundamental.T
    across = line[..., :2] / np.linalg.norm(line[..., :2], axis=-1, keepdims=True)
    matches[3].position[:10] += 3.0 * across[:10]
    dense = run(scene, matches, min_views=5)
    views = np.diff(dense.start).reshape(SIZE, SIZE)
    assert (views[:10] == VIEWS - 1).all()
    assert (views[10:] == VIEWS).all()
    np.testing.assert_allclose(dense.position, scene.landmarks.position, atol=1e-5 * scene.gsd)


def test_matches_astray_along_their_line_are_dropped_by_reprojection(scene):
    """The epipolar check cannot see them; the other views outvote them."""
    matches = exact_matches(scene)
    pose, camera = scene.views.body_from_cam, scene.views.cameras
    rays = camera[0].ray_in_cam(scene.region.pixel_centers())
    wrong = pose[0](rays * (scene.gsd * 10_000 * 1.01))  # 100 pixels too deep
    matches[2].position[:] = camera[2].pixel_from_cam(pose[2].inverse()(wrong))
    dense = run(scene, matches, min_views=4)
    assert (dense.view != 2).all()
    np.testing.assert_allclose(dense.position, scene.landmarks.position, atol=1e-5 * scene.gsd)


def test_pixels_that_too_few_views_see_make_no_landmark(scene):
    matches = exact_matches(scene)
    matches[1].valid[:, :7] = False
    matches[2].certainty[:, :3] = 0.0
    assert len(run(scene, matches, min_views=6).position) == SIZE * (SIZE - 7)
    assert len(run(scene, matches, min_views=5).position) == SIZE * (SIZE - 3)
    with pytest.raises(ReconstructionError, match="lower min_views"):
        run(scene, matches, min_views=7)


def test_rays_too_parallel_make_no_landmark(scene):
    with pytest.raises(ReconstructionError):
        run(scene, exact_matches(scene), min_triangulation_deg=80.0)


def test_the_reference_observes_its_pixel_centre(scene):
    dense = run(scene, exact_matches(scene, 0.1))
    own = dense.keypoint[dense.view == 0]
    np.testing.assert_array_equal(own, dense.pixel[:, ::-1] + 0.5)


def test_true_correspondences_satisfy_the_epipolar_constraint(scene):
    pose, camera = scene.views.body_from_cam, scene.views.cameras
    xy = scene.tracks.keypoint.reshape(-1, VIEWS, 2)
    for view in range(1, VIEWS):
        fundamental = fundamental_matrix(camera[0], pose[0], camera[view], pose[view])
        assert sampson_error(fundamental, xy[:, 0], xy[:, view]).max() < 1e-12


def test_sampson_error_of_a_rectified_pair_is_half_the_squared_row_difference():
    """Two equal cameras side by side: the epipolar lines are the rows, each image takes half the correction."""
    camera = synthetic_scene(size=4).views.cameras[0]
    left = Rigid(np.eye(3), np.zeros(3))
    right = Rigid(np.eye(3), np.array([1.0, 0.0, 0.0]))
    fundamental = fundamental_matrix(camera, left, camera, right)
    error = sampson_error(fundamental, np.array([[10.0, 20.0]]), np.array([[14.0, 20.6]]))
    np.testing.assert_allclose(error, 0.6**2 / 2)


def test_triangulation_agrees_with_the_textbook_transform(scene):
    """The compiled solution against the singular vector of the stacked homogeneous system."""
    cam_from_body = scene.views.body_from_cam.inverse()
    noisy = scene.tracks.keypoint.reshape(-1, VIEWS, 2) + np.random.default_rng(0).normal(
        scale=0.05, size=(SIZE * SIZE, VIEWS, 2)
    )
    intrinsics, pose = scene.views.intrinsics, scene.views.body_from_cam
    cameras = PinholeCameras(np.ascontiguousarray(pose.rotation), pose.translation, intrinsics)
    for xy in noisy[::37]:
        point = np.zeros(3)
        used = np.ones(VIEWS, bool)
        assert triangulate(xy, np.ones(VIEWS), used, cameras, point)
        rows = []
        for k in range(VIEWS):
            matrix = np.column_stack([cam_from_body.rotation[k], cam_from_body.translation[k] / scene.gsd])
            x, y = (xy[k] - intrinsics[k, 2:]) / intrinsics[k, :2]
            rows += [x * matrix[2] - matrix[0], y * matrix[2] - matrix[1]]
        solution = np.linalg.svd(np.array(rows))[2][-1]
        expected = scene.gsd * solution[:3] / solution[3]
        assert np.linalg.norm(point - expected) < 0.05 * scene.gsd


def test_exact_tracks_are_triangulated_exactly():
    true = synthetic_scene(size=10)
    found = triangulate_tracks(true.tracks, true.views)
    np.testing.assert_allclose(found, true.landmarks.position, atol=1e-6 * np.abs(true.landmarks.position).max())


def test_a_point_seen_once_has_no_place():
    true = synthetic_scene(size=4)
    once = replace(true.tracks, start=np.arange(len(true.tracks) + 1))
    assert np.isnan(triangulate_tracks(once, true.views)).all()
