"""Depth and rotations reversed, of a model or of one view's pose: nearly parallel rays hardly tell the two apart."""

import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from photoclinometry.model.image import Image
from photoclinometry.model.progress import no_progress
from photoclinometry.model.warning import collected_warnings
from photoclinometry.photometry.relief_shading import ReliefShading
from photoclinometry.sfm import mapping, reconstruct, reversal
from photoclinometry.sfm.adjustment import RobustAdjustment, keypoints_with_points
from photoclinometry.sfm.database import first_pairs
from photoclinometry.sfm.mapping import from_colmap
from photoclinometry.sfm.reconstruct import reconstruct_sparse
from sparse_views import CAMERA, OPTIONS, painted_site, rotation_errors_deg, views_around

ADJUSTMENT = RobustAdjustment(threads=2)

RIGHT, MIXED = ReliefShading(0.76, -0.67, 100.0), ReliefShading(-0.17, 0.05, 100.0)
"""How a right model, and one of right and reversed views, go with the images."""


@pytest.fixture(scope="module")
def one_site():
    return painted_site()


@pytest.fixture(scope="module")
def models(one_site, tmp_path_factory):
    """COLMAP's model and what became of it, where structure from motion had ended in the reversed one."""
    kept = []

    def from_the_wrong_side(model, adjustment, shading_of):
        wrong = reversal.reversed_model(model)
        found = reversal.resolve_depth_reversal(wrong, adjustment, shading_of)
        kept.extend([model, wrong, found.model])
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapping, "resolve_depth_reversal", from_the_wrong_side)
        sparse = reconstruct_sparse(one_site[0], [CAMERA] * 5, tmp_path_factory.mktemp("reversed"), OPTIONS)
    return (*kept, sparse)


def projections(model):
    """Of all points in all registered views: pixels (n, 2) and depths (n,), by view."""
    found = from_colmap(model, [CAMERA] * 5)
    local = [found.body_from_cam[k].inverse()(found.points) for k in range(5)]
    return [CAMERA.pixel_from_cam(points) for points in local], [points[:, 2] for points in local]


def test_of_two_keypoints_of_one_image_in_a_track_the_nearer_counts(models):
    import pycolmap

    model = copy.deepcopy(models[0])
    before = from_colmap(model, [CAMERA] * 5)
    point = next(i for i in sorted(model.point3D_ids()) if len(model.points3D[i].track.elements) >= 3)
    image = model.images[model.points3D[point].track.elements[1].image_id]
    free = next(n for n, each in enumerate(image.points2D) if not each.has_point3D())
    model.add_observation(point, pycolmap.TrackElement(image.image_id, free))
    assert model.compute_num_observations() == models[0].compute_num_observations() + 1
    after = from_colmap(model, [CAMERA] * 5)
    np.testing.assert_array_equal(after.point_view, before.point_view)
    np.testing.assert_array_equal(after.point_xy, before.point_xy)
    assert len(np.unique(5 * after.point_of_observation + after.point_view)) == len(after.point_view)


def test_a_reversed_model_is_recognised_and_turned_round(models, one_site):
    *_, sparse = models
    assert sparse.registered.all()
    assert sparse.mean_reprojection_px < 0.3
    assert rotation_errors_deg(sparse.body_from_cam, one_site[1]).max() < 0.3


def test_depth_from_the_middle_changes_its_sign_and_pixels_stay_to_perspective(models):
    model, *_ = models
    there = reversal.reversed_model(model)
    for before, after, depth, reverse in zip(
        *(projections(each)[n] for n in (0, 1) for each in (model, there)), strict=True
    ):
        middle = depth.mean()
        np.testing.assert_allclose(reverse - middle, middle - depth, atol=1e-6 * middle)
        relief = np.abs(depth - middle)[:, None] / middle
        from_axis = np.abs(before - [CAMERA.width / 2, CAMERA.height / 2])
        assert np.all(np.abs(after - before) <= 2.5 * relief * from_axis + 1e-3)
    np.testing.assert_allclose(np.linalg.det(from_colmap(there, [CAMERA] * 5).body_from_cam.rotation), 1.0)


def test_reversed_twice_is_as_before(models):
    model, *_ = models
    twice = reversal.reversed_model(reversal.reversed_model(model))
    for before, after in zip(projections(model)[0], projections(twice)[0], strict=True):
        np.testing.assert_allclose(after, before, atol=1e-6)


def test_the_given_model_is_not_changed(models):
    model, wrong, right = models[:3]
    assert right is not model
    assert right is not wrong
    before = from_colmap(model, [CAMERA] * 5).points
    reversal.reversed_model(model)
    np.testing.assert_array_equal(from_colmap(model, [CAMERA] * 5).points, before)


@pytest.mark.parametrize(
    ("reverse_px", "doubtful", "undecided"), [(0.201, True, (0.2, 0.201)), (0.25, True, None), (0.3, False, None)]
)
def test_where_both_explain_the_keypoints_alike_it_is_doubtful_or_undecided(reverse_px, doubtful, undecided):
    found = reversal.Oriented(None, 0.2, reverse_px)
    assert found.undecided == undecided
    assert found.is_doubtful == doubtful
    assert replace(found, shading=RIGHT).undecided is None


def test_a_model_that_only_shading_prefers_is_overruled():
    assert reversal.Oriented(None, 0.21, 0.2, RIGHT).overruled == (0.21, 0.2)
    assert reversal.Oriented(None, 0.2, 0.21, RIGHT).overruled is None
    assert reversal.Oriented(None, 0.2, 0.2, RIGHT).overruled is None
    assert reversal.Oriented(None, 0.21, 0.2).overruled is None


class Known:
    """A reconstruction of a known reprojection error, which adjustment leaves as it is."""

    def __init__(self, error_px):
        self.error_px = error_px

    def compute_mean_reprojection_error(self):
        return self.error_px


def test_suns_that_lie_opposite_turn_the_relief_against_the_keypoints(monkeypatch):
    """Where keypoints tell a model from its reverse by little, shading under such Suns is followed."""
    right, reverse = Known(0.17), Known(0.2)
    shading = {right: ReliefShading(-0.6, 0.8, 100.0), reverse: ReliefShading(0.8, -0.6, 100.0)}
    monkeypatch.setattr(reversal, "reversed_model", lambda model: reverse)
    unchanged = SimpleNamespace(of_model=lambda model: None)
    found = reversal._better_of_both(right, unchanged, shading.__getitem__)
    assert found.model is reverse
    assert found.overruled == (0.2, 0.17)


@pytest.mark.parametrize(
    ("undecided", "overruled", "codes"),
    [
        (None, None, []),
        ((0.2, 0.201), None, ["reversal-undecided"]),
        (None, (0.2, 0.201), ["relief-by-shading"]),
    ],
)
def test_only_the_model_that_is_kept_is_warned_of(undecided, overruled, codes, one_site, models, tmp_path, monkeypatch):
    """Views matched by brightness alone make an undecided model of three; with the relief, all make another."""
    model = from_colmap(models[2], [CAMERA] * 5)
    few = replace(model, registered=np.arange(5) < 3)
    inliers = np.full((5, 5), 100)
    first = reconstruct._Attempt([], np.zeros((5, 5), int), [few], [reconstruct._Doubts((0.3, 0.301), (0.31, 0.3))])
    second = reconstruct._Attempt([], inliers, [model], [reconstruct._Doubts(undecided, overruled)])
    monkeypatch.setattr(reconstruct, "_by_brightness", lambda given: first)
    monkeypatch.setattr(reconstruct, "_by_relief_too", lambda given, sun, plain: second)
    monkeypatch.setattr(reconstruct._Given, "shading_of", lambda given, sparse: RIGHT)
    images = [Image(str(k), np.zeros((8, 8)), np.ones((8, 8), bool)) for k in range(5)]
    with collected_warnings() as collected:
        reconstruct.reconstruct_sparse(images, [CAMERA] * 5, tmp_path, OPTIONS, sun_in_cam=np.eye(3)[[2] * 5])
    assert [each.code for each in collected] == codes
    assert all("0.200 px, and to 0.201 px" in each.words for each in collected)


def test_the_errors_of_a_model_and_its_reverse_are_stated(models):
    found = reversal.resolve_depth_reversal(copy.deepcopy(models[1]), ADJUSTMENT)
    assert found.error_px == pytest.approx(found.model.compute_mean_reprojection_error(), rel=1e-3)
    assert found.error_px < 0.3 < found.reverse_px
    assert not found.is_doubtful


def oriented(views, error_px, reverse_px, shading=None):
    class Model:
        def num_reg_images(self):
            return views

    return [reversal.Oriented(Model(), error_px, reverse_px, shading)]


WORSE = [oriented(5, 0.3 + 0.1 * k, 0.5) for k in range(3)]
MIXTURE, TRUTH = oriented(5, 0.24, 0.25, MIXED), oriented(5, 0.25, 0.26, RIGHT)


@pytest.mark.parametrize(
    ("found", "kept", "trials"),
    [
        ([oriented(5, 0.2, 0.5)], 0, 1),  # decided at once
        ([oriented(5, 0.30, 0.31), oriented(5, 0.2, 0.23), oriented(5, 0.2, 0.23)], 1, 3),  # the best found twice
        ([oriented(5, 0.2, 0.23), oriented(5, 0.30, 0.31), oriented(5, 0.201, 0.23)], 0, 3),
        ([oriented(4, 0.2, 0.23), oriented(5, 0.25, 0.5)], 1, 2),  # more views, and decided
        (
            [oriented(5, 0.2, 0.23), [], oriented(4, 0.1, 0.2), *WORSE],
            0,
            6,
        ),
        ([MIXTURE, MIXTURE, MIXTURE, TRUTH, MIXTURE, TRUTH], 3, 6),  # the images show it, whatever is found more often
        ([TRUTH, TRUTH], 0, 2),
        ([MIXTURE] * 18, 0, 18),
        ([*[MIXTURE] * 8, TRUTH], 8, 9),  # a seed whose model the images show, at last
        ([[]], None, 1),
    ],
)
def test_views_are_mapped_again_until_the_best_is_found_twice(found, kept, trials, monkeypatch):
    seeds = []

    def mapped(_cameras, _work_dir, options, *_):
        seeds.append(options.seed)
        return found[len(seeds) - 1]

    monkeypatch.setattr(mapping, "_mapped", mapped)
    assert mapping.map_views([CAMERA] * 5, None, OPTIONS, no_progress) == ([] if kept is None else found[kept])
    assert seeds == [OPTIONS.seed + k for k in range(trials)]


def test_many_views_that_no_seed_maps_as_the_images_show_are_mapped_six_times(monkeypatch):
    found = [MIXTURE] * 6
    trials = iter(found)
    monkeypatch.setattr(mapping, "_mapped", lambda *_: next(trials))
    assert mapping.map_views([CAMERA] * 31, None, OPTIONS, no_progress) == MIXTURE
    assert next(trials, None) is None


def test_later_trials_begin_with_the_pairs_of_most_matches(one_site, tmp_path, monkeypatch):
    """Each begins elsewhere, and finds the poses as well."""
    reconstruct_sparse(one_site[0], [CAMERA] * 5, tmp_path, OPTIONS)
    pairs, begun = first_pairs(5, tmp_path), []
    inliers = reconstruct.match_views(5, [], tmp_path, OPTIONS, "", no_progress)
    made = mapping._incremental_options

    def noted(cameras, options, pair):
        begun.append(pair)
        return made(cameras, options, pair)

    monkeypatch.setattr(mapping, "_incremental_options", noted)
    for rank in (0, 3):
        (found,) = mapping._mapped([CAMERA] * 5, tmp_path, OPTIONS, no_progress, None, rank)
        assert rotation_errors_deg(from_colmap(found.model, [CAMERA] * 5).body_from_cam, one_site[1]).max() < 0.3
    assert begun == [pairs[0], pairs[3]]
    assert len(pairs) == np.count_nonzero(np.triu(inliers, 1))


def test_all_trials_are_made_if_that_is_asked_for(monkeypatch):
    """Though the second model is found twice, and is beyond doubt."""
    found = [oriented(5, error_px, 2.0) for error_px in (0.40, 0.34, 0.34, 0.34, 0.30, 0.34)]
    trials = iter(found)
    monkeypatch.setattr(mapping, "_mapped", lambda *_: next(trials))
    assert mapping.map_views([CAMERA] * 5, None, OPTIONS, no_progress, all_trials=True) == found[4]
    assert next(trials, None) is None


def with_reversed_views(model, *views):
    found = copy.deepcopy(model)
    for image_id in found.reg_image_ids():
        image = found.images[image_id]
        if int(image.name[:5]) in views:
            points = np.array([found.points3D[p.point3D_id].xyz for p in keypoints_with_points(image)])
            pose = reversal.reversed_pose(image.cam_from_world(), points)
            found.frames[image.frame_id].rig_from_world = pose
    return found


def worst_rotation_deg(model, site):
    return rotation_errors_deg(from_colmap(model, [CAMERA] * 5).body_from_cam, site[1]).max()


@pytest.mark.parametrize("views", [(4,), (3, 4)])
def test_a_view_that_adjustment_leaves_reversed_is_turned_round(models, one_site, views):
    wrong = with_reversed_views(models[2], *views)
    ADJUSTMENT.of_model(wrong)
    assert worst_rotation_deg(wrong, one_site) > 5.0
    found = reversal.resolve_pose_reversals(wrong, ADJUSTMENT)
    assert worst_rotation_deg(found, one_site) < 0.3


def test_where_no_view_is_reversed_the_model_stays_as_it_is(models):
    model = copy.deepcopy(models[2])
    before = from_colmap(model, [CAMERA] * 5)
    assert reversal.resolve_pose_reversals(model, ADJUSTMENT) is model
    after = from_colmap(model, [CAMERA] * 5)
    np.testing.assert_array_equal(after.points, before.points)
    np.testing.assert_array_equal(after.body_from_cam.rotation, before.body_from_cam.rotation)


def test_points_of_a_plane_stay_where_they_are_in_a_reversed_view():
    """Up to perspective: a share of their depth over their distance."""
    import pycolmap

    rng = np.random.default_rng(0)
    points = np.column_stack((rng.uniform(-50.0, 50.0, (200, 2)), np.full(200, 7.0)))
    body_from_cam = views_around(5)[4]
    rotation, translation = body_from_cam.rotation.T, -body_from_cam.rotation.T @ body_from_cam.translation
    pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), translation)
    there = reversal.reversed_pose(pose, points)
    local, other = ((each.rotation.matrix() @ points.T).T + each.translation for each in (pose, there))
    np.testing.assert_allclose(other[:, :2], local[:, :2], atol=1e-9)
    np.testing.assert_allclose(other[:, 2] - other[:, 2].mean(), local[:, 2].mean() - local[:, 2], atol=1e-9)
    back = reversal.reversed_pose(there, points)
    np.testing.assert_allclose(back.rotation.matrix(), rotation, atol=1e-9)
