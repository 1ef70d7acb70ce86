"""Models joined by matches between them, and completed: similarities and poses of simulated truth, and no others."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.camera import Camera
from photoclinometry.model.compressed_rows import row_starts
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, so3_log
from photoclinometry.model.sparse import SparseModel, transformed
from photoclinometry.sfm import SfmOptions
from photoclinometry.sfm.completion import epipolar_inliers, epipolar_px, with_resected_views
from photoclinometry.sfm.database import DescriptorMatches
from photoclinometry.sfm.joining import joined_models, locate_keypoints, merged_model, ransac_similarity
from scenes import from_zenith, look_at_origin

FOCAL_PX = 3000.0
CAMERA = Camera("PINHOLE", 256, 256, (FOCAL_PX, FOCAL_PX, 128.0, 128.0))
CAMERAS = [CAMERA] * 7
GROUND, KEYPOINTS = 60, 40
"""Points of a model, and further keypoints of each view, which no point of a model belongs to."""
OTHER_FRAME = Similarity(1.7, so3_exp([0.4, -1.2, 0.3]), np.array([50.0, -20.0, 10.0]))


def heights(xy):
    return 6.0 * np.sin(xy[..., 0] / 25.0) + 5.0 * np.cos(xy[..., 1] / 20.0)


def on_ground(rng, count):
    xy = rng.uniform(-80, 80, (count, 2))
    return np.column_stack([xy, heights(xy)])


@pytest.fixture(scope="module")
def poses():
    """Views 0 to 2 from one side, 3 to 5 from another, 6 between them."""
    angle, azimuth = np.radians([8, 14, 20, 9, 15, 21, 2]), np.radians([0, 10, -10, 75, 90, 80, 40])
    each = [look_at_origin(FOCAL_PX * center, 0.1 * k) for k, center in enumerate(from_zenith(angle, azimuth))]
    return Rigid(np.stack([p.rotation for p in each]), np.stack([p.translation for p in each]))


def seen(poses, view, points):
    return CAMERA.pixel_from_cam(poses[view].inverse()(points))


def model_of(poses, views, points):
    count = len(points)
    return SparseModel(
        registered=np.isin(np.arange(7), views),
        body_from_cam=poses,
        points=points,
        point_start=row_starts(np.full(count, len(views))),
        point_view=np.tile(views, count).astype(np.int32),
        point_xy=np.stack([seen(poses, view, points) for view in views], 1).reshape(-1, 2),
        mean_reprojection_px=0.2,
    )


@pytest.fixture(scope="module")
def models(poses):
    """The second in another frame."""
    rng = np.random.default_rng(0)
    first = model_of(poses, [0, 1, 2], on_ground(rng, GROUND))
    return first, transformed(model_of(poses, [3, 4, 5], on_ground(rng, GROUND)), OTHER_FRAME.inverse())


def matches_of(poses, pairs, right, seed=1, part=0.6):
    """Of the keypoints of two views, the first `right` ones show the same ground, and the others match by chance.

    part: of the ground's width, from which all keypoints are.
    """
    rng = np.random.default_rng(seed)
    ground = on_ground(rng, KEYPOINTS) * [part, part, 1.0]
    ground[:, 2] = heights(ground[:, :2])
    keypoints = [seen(poses, k, ground) + 0.2 * rng.standard_normal((KEYPOINTS, 2)) for k in range(7)]
    found = {}
    for pair in pairs:
        wrong = rng.permutation(np.arange(right, KEYPOINTS))
        index = np.column_stack([np.arange(KEYPOINTS), np.concatenate([np.arange(right), wrong])])
        found[pair] = index
    return DescriptorMatches(keypoints=keypoints, pairs=found)


def test_keypoints_lie_on_the_ground_between_a_models_points(models, poses):
    matches = matches_of(poses, [], 0)
    points = locate_keypoints(models[0], matches, CAMERAS).points[1]
    known = np.isfinite(points[:, 0])
    assert known.mean() > 0.8
    assert np.median(np.abs(points[known, 2] - heights(points[known, :2]))) < 1.5


@pytest.mark.parametrize("pairs", [[(3, 0)], [(0, 3)], [(3, 0), (4, 2), (5, 1)]])
def test_matches_of_few_pairs_give_the_similarity_of_two_models(models, poses, pairs):
    matches = matches_of(poses, pairs, 14)
    parts = [locate_keypoints(model, matches, CAMERAS) for model in models]
    join = ransac_similarity(*parts, matches, CAMERAS, np.random.default_rng(0))
    assert join.is_certain
    assert join.agreeing >= 0.7 * 14 * len(pairs)
    found = join.first_from_second
    turned = np.degrees(np.linalg.norm(so3_log(found.rotation @ OTHER_FRAME.rotation.T)))
    assert turned < 3.0
    assert found.scale == pytest.approx(OTHER_FRAME.scale, rel=0.03)
    points = models[1].points
    assert np.linalg.norm(found(points) - OTHER_FRAME(points), axis=-1).max() < 8.0


@pytest.mark.parametrize("part", [0.6, 0.2])
def test_the_sigma_of_a_join_is_as_large_as_its_errors(models, poses, part):
    """About the axis that matches determine least; depths between points are wrong together, hence the wide limits."""
    off = []
    for seed in range(8):
        matches = matches_of(poses, [(3, 0), (4, 2)], 12, seed, part)
        parts = [locate_keypoints(model, matches, CAMERAS) for model in models]
        join = ransac_similarity(*parts, matches, CAMERAS, np.random.default_rng(0))
        turned = so3_log(join.first_from_second.rotation @ OTHER_FRAME.rotation.T)
        off.append(np.linalg.norm(turned) / join.turn_sigma_rad)
    assert 0.4 < np.median(off) < 2.0
    assert np.max(off) < 5.0


@pytest.mark.parametrize("part", [0.1, 0.01])
def test_matches_of_a_small_patch_do_not_join(models, poses, part):
    """They agree, and leave open how the second model is turned: a bent body would result."""
    matches = matches_of(poses, [(3, 0), (4, 2)], 12, part=part)
    join = ransac_similarity(
        *(locate_keypoints(model, matches, CAMERAS) for model in models), matches, CAMERAS, np.random.default_rng(0)
    )
    assert join.agreeing >= 12
    assert join.turn_sigma_rad > np.radians(4.0)
    assert not join.is_certain
    assert len(joined_models(models, matches, CAMERAS, 0)) == 2


@pytest.mark.parametrize("seed", range(5))
def test_matches_by_chance_join_nothing(models, poses, seed):
    matches = matches_of(poses, [(a, b) for a in (3, 4, 5) for b in (0, 1, 2)], 0, seed)
    join = ransac_similarity(
        *(locate_keypoints(model, matches, CAMERAS) for model in models), matches, CAMERAS, np.random.default_rng(0)
    )
    assert not join.is_certain  # of 360, up to 10 agree, and 8 with another similarity
    assert len(joined_models(models, matches, CAMERAS, 0)) == 2


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("count", [3, 4, 6])
def test_a_handful_of_wrong_matches_joins_nothing(models, poses, count, seed):
    matches = matches_of(poses, [(3, 0), (4, 1)], 0, seed)
    few = replace(matches, pairs={pair: index[:count] for pair, index in matches.pairs.items()})
    assert len(joined_models(models, few, CAMERAS, 0)) == 2


def test_models_without_matches_stay_apart(models, poses):
    matches = matches_of(poses, [(1, 0), (4, 3)], 20)
    assert [model.registered.sum() for model in joined_models(models, matches, CAMERAS, 0)] == [3, 3]


def test_joined_models_have_the_views_and_points_of_both(models, poses):
    matches = matches_of(poses, [(3, 0), (4, 2), (5, 1)], 14)
    (one,) = joined_models(models, matches, CAMERAS, 0)
    assert one.registered.tolist() == [True] * 6 + [False]
    assert len(one.points) == 2 * GROUND
    turned = so3_log(one.body_from_cam.rotation[:6] @ poses.rotation[:6].transpose(0, 2, 1))
    assert np.degrees(np.linalg.norm(turned, axis=-1)).max() < 3.0
    index, xy = one.seen_by(4)
    np.testing.assert_allclose(CAMERA.pixel_from_cam(one.body_from_cam[4].inverse()(one.points[index])), xy, atol=1e-6)


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (2, 3, 0, 1), (0, 2, 1, 3)])
def test_two_couples_of_models_become_two_models(models, poses, order):
    """Two bodies of two models each; however these are numbered, no model is lost. Views 7 to 13 are of the second."""

    def shifted(model):
        empty = np.zeros(7, bool)
        twice = Rigid(np.tile(poses.rotation, (2, 1, 1)), np.tile(poses.translation, (2, 1)))
        registered = np.concatenate([empty, model.registered])
        rotation, center = twice.rotation.copy(), twice.translation.copy()
        rotation[7:], center[7:] = model.body_from_cam.rotation, model.body_from_cam.translation
        views = (model.point_view + 7).astype(np.int32)
        return replace(model, registered=registered, body_from_cam=Rigid(rotation, center), point_view=views)

    def padded(model):
        rotation = np.concatenate([model.body_from_cam.rotation, poses.rotation])
        center = np.concatenate([model.body_from_cam.translation, poses.translation])
        registered = np.concatenate([model.registered, np.zeros(7, bool)])
        return replace(model, registered=registered, body_from_cam=Rigid(rotation, center))

    one = matches_of(poses, [(3, 0), (4, 2), (5, 1)], 14)
    few = {pair: one.pairs[pair] for pair in ((3, 0), (4, 2))}  # so that the second body is joined first
    pairs = few | {(a + 7, b + 7): index for (a, b), index in one.pairs.items()}
    both = DescriptorMatches(keypoints=one.keypoints * 2, pairs=pairs)
    four = [padded(models[0]), padded(models[1]), shifted(models[0]), shifted(models[1])]
    found = joined_models([four[k] for k in order], both, CAMERAS * 2, 0)
    assert [len(model.points) for model in found] == [2 * GROUND] * 2
    seen_views = sorted(np.flatnonzero(model.registered).tolist() for model in found)
    assert seen_views == [[0, 1, 2, 3, 4, 5], [7, 8, 9, 10, 11, 12]]


def test_a_view_in_both_has_the_pose_of_the_model_that_has_more_points_of_it(models, poses):
    elsewhere = Rigid(poses.rotation[::-1], poses.translation[::-1])
    few = replace(model_of(poses, [2, 3, 4], models[0].points[:20]), body_from_cam=elsewhere)
    both = merged_model(models[0], few)
    assert both.registered.tolist() == [True] * 5 + [False] * 2
    np.testing.assert_array_equal(both.body_from_cam.rotation[2], poses.rotation[2])
    np.testing.assert_array_equal(both.body_from_cam.rotation[3], elsewhere.rotation[3])
    assert np.count_nonzero(both.point_view == 2) == GROUND
    assert np.count_nonzero(both.point_view == 3) == 20


def test_distances_from_epipolar_lines(poses):
    """Zero for what both see; a move across the line counts, one along it does not."""
    points = on_ground(np.random.default_rng(3), 10)
    one, other = poses[0], poses[4]
    there, here = seen(poses, 0, points), seen(poses, 4, points)
    np.testing.assert_allclose(epipolar_px(one, CAMERA, there, other, CAMERA, here), 0.0, atol=1e-6)
    local = other.inverse()(points + 1e-3 * (points - one.translation))
    along = CAMERA.pixel_from_cam(local) - here
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], -1)
    np.testing.assert_allclose(epipolar_px(one, CAMERA, there, other, CAMERA, here + 3.0 * along), 0.0, atol=1e-2)
    moved = epipolar_px(one, CAMERA, there, other, CAMERA, here + 3.0 * across)
    np.testing.assert_allclose(moved, 3.0, rtol=0.05)


def test_matches_that_fit_known_poses_are_kept(models, poses):
    matches = matches_of(poses, [(1, 0), (2, 1), (6, 0)], 25)
    found = epipolar_inliers(models[0], matches, CAMERAS, 1.5)
    assert set(found) == {(1, 0), (2, 1)}  # view 6 has no pose
    for index in found.values():
        assert np.count_nonzero(index[:, 0] == index[:, 1]) == 25
        assert len(index) < 30


def test_a_view_is_located_by_matches_with_ground(models, poses):
    matches = matches_of(poses, [(6, 0), (6, 2)], 14)
    found = with_resected_views(models[0], matches, CAMERAS, SfmOptions())
    assert found.registered.tolist() == [True] * 3 + [False] * 3 + [True]
    assert np.degrees(np.linalg.norm(so3_log(found.body_from_cam.rotation[6] @ poses.rotation[6].T))) < 3.0


def test_no_view_is_located_by_chance(models, poses):
    matches = matches_of(poses, [(6, 0), (6, 1), (6, 2)], 0)
    np.testing.assert_array_equal(
        with_resected_views(models[0], matches, CAMERAS, SfmOptions()).registered, models[0].registered
    )
