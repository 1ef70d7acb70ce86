"""Landmarks from matches: exact matches give exact points; wrong ones are dropped."""

import numpy as np
import pytest

from photoclinometry.matching import Matches
from photoclinometry.matching.densify import DensifyOptions, densify
from photoclinometry.matching.epipolar import fundamental_matrix
from photoclinometry.model.errors import ReconstructionError
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
    """Such matches pass the epipolar check; the other views' rays contradict them."""
    matches = exact_matches(scene)
    pose, camera = scene.views.body_from_cam, scene.views.cameras
    rays = camera[0].ray_in_cam(scene.region.pixel_centers())
    wrong = pose[0](rays * (scene.gsd * 10_000 * 1.01))  # 100 pixels too deep
    matches[2].position[:] = camera[2].pixel_from_cam(pose[2].inverse()(wrong))
    dense = run(scene, matches, min_views=4)
    assert (dense.view != 2).all()
    np.testing.assert_allclose(dense.position, scene.landmarks.position, atol=1e-5 * scene.gsd)


@pytest.mark.parametrize(("views", "needed"), [(2, 3), (3, 3), (4, 3), (6, 3), (7, 4), (9, 5), (11, 6), (40, 6)])
def test_half_of_the_views_must_agree(views, needed):
    assert DensifyOptions().views_needed(views) == needed
    assert DensifyOptions(min_views=8).views_needed(views) == 8


def test_pixels_that_too_few_views_see_make_no_landmark(scene):
    matches = exact_matches(scene)
    matches[1].valid[:, :7] = False
    matches[2].certainty[:, :3] = 0.0
    assert len(run(scene, matches, min_views=6).position) == SIZE * (SIZE - 7)
    assert len(run(scene, matches, min_views=5).position) == SIZE * (SIZE - 3)
    with pytest.raises(
        ReconstructionError,
        match=r"in 7 views or more \(there are 6\); ask for .* \(--densify\.min-views 3, or --pre",
    ):
        run(scene, matches, min_views=7)


def test_rays_too_parallel_make_no_landmark(scene):
    with pytest.raises(ReconstructionError):
        run(scene, exact_matches(scene), min_triangulation_deg=80.0)


def test_the_reference_observes_its_pixel_centre(scene):
    dense = run(scene, exact_matches(scene, 0.1))
    own = dense.keypoint[dense.view == 0]
    np.testing.assert_array_equal(own, dense.pixel[:, ::-1] + 0.5)
