"""Shading tells a sparse model from its reverse: on shaded relief, and not on painted ground."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import Rigid
from photoclinometry.model.sparse import SparseModel, of_views
from photoclinometry.model.warning import collected_warnings
from photoclinometry.photometry.relief_shading import ReliefShading, relief_shading
from photoclinometry.photometry.sparse_planes import sparse_planes
from photoclinometry.sfm import mapping, reconstruct_sparse, reversal
from photoclinometry.sfm.adjustment import RobustAdjustment
from sparse_views import CAMERA, OPTIONS, lit_site, painted_site, rotation_errors_deg

CAMERAS = [CAMERA] * 5
MANY_KEYPOINTS = replace(OPTIONS, max_features=3000)
DEPTH = np.diag([1.0, 1.0, -1.0])
MIRRORED = np.array([-1.0, -1.0, 1.0])
"""Turns a direction in C half round the line of sight."""


@pytest.fixture(scope="module")
def site():
    """Images, Suns in C and true poses of shaded relief without paint."""
    return lit_site([20, 25, 30, 35, 40])


@pytest.fixture(scope="module")
def sparse(site, tmp_path_factory):
    found = reconstruct_sparse(site[0], CAMERAS, tmp_path_factory.mktemp("sfm"), MANY_KEYPOINTS, sun_in_cam=site[1])
    assert rotation_errors_deg(found.body_from_cam, site[2]).max() < 0.5
    return found


def reverse_of(sparse):
    """Points mirrored in depth and cameras that see them alike: rotations R of cam_from_body become D R D."""
    middle, cam_from_body = sparse.points.mean(0), sparse.body_from_cam.inverse()
    rotation = DEPTH @ cam_from_body.rotation @ DEPTH
    translation = cam_from_body.rotation @ middle + cam_from_body.translation - rotation @ middle
    poses = Rigid(rotation, translation).inverse()
    return replace(sparse, points=middle + (sparse.points - middle) @ DEPTH, body_from_cam=poses)


def test_the_images_show_the_model_and_not_its_reverse(sparse, site):
    found = relief_shading(sparse, site[0], CAMERAS, site[1])
    assert found.correlation > 0.6
    assert found.reverse < -0.3
    assert found.shows == "model"


def test_the_reverse_need_not_be_made(sparse, site):
    """Normals turned about the line of sight are those of the reversed model."""
    right, wrong = (relief_shading(model, site[0], CAMERAS, site[1]) for model in (sparse, reverse_of(sparse)))
    assert wrong.correlation == pytest.approx(right.reverse, abs=0.05)
    assert wrong.reverse == pytest.approx(right.correlation, abs=0.05)
    assert wrong.shows == "reverse"


def test_suns_turned_about_the_line_of_sight_show_the_reverse(sparse, site, tmp_path):
    assert relief_shading(sparse, site[0], CAMERAS, site[1] * MIRRORED).shows == "reverse"
    with collected_warnings() as warned:
        reconstruct_sparse(site[0], CAMERAS, tmp_path, MANY_KEYPOINTS, sun_in_cam=site[1] * MIRRORED)
    assert [each.code for each in warned] == ["relief-inverted"]
    assert "Check `sun`, or" in warned[0].words


def test_paint_shows_neither(tmp_path):
    images, _ = painted_site()
    sparse = reconstruct_sparse(images, CAMERAS, tmp_path, MANY_KEYPOINTS)
    for azimuth in np.radians([0, 90, 180, 270]):
        sun = np.tile([0.8 * np.cos(azimuth), 0.8 * np.sin(azimuth), -0.6], (5, 1))
        assert relief_shading(sparse, images, CAMERAS, sun).shows == "neither"


def test_few_points_say_nothing(sparse, site):
    few = replace(
        sparse,
        points=sparse.points[:10],
        point_start=sparse.point_start[:11],
        point_view=sparse.point_view[: sparse.point_start[10]],
        point_xy=sparse.point_xy[: sparse.point_start[10]],
    )
    assert relief_shading(few, site[0], CAMERAS, site[1]) == ReliefShading(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("correlation", "reverse", "patches", "shows"),
    [
        (0.5, -0.2, 100, "model"),
        (0.3, -0.2, 100, "neither"),
        (0.3, -0.2, 200, "model"),
        (-0.5, 0.5, 40, "reverse"),
        (-0.9, 1.0, 1, "neither"),
        (0.0, 0.0, 0, "neither"),
    ],
)
def test_three_standard_deviations_decide(correlation, reverse, patches, shows):
    """Of two correlations of n pairs that are opposite, 2 / sqrt(n)."""
    found = ReliefShading(correlation, reverse, patches)
    assert found.sigma == pytest.approx(2.0 / np.sqrt(max(patches, 1)))
    assert found.shows == shows


def test_normals_point_to_the_views_that_see_them():
    """Of a sphere seen from two sides, though the middle of all cameras is its own middle."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(600, 3))
    points *= 50.0 / np.linalg.norm(points, axis=-1, keepdims=True)
    points = points[np.abs(points[:, 2]) > 20.0]
    centers = np.array([[0, 0, 4000.0], [100.0, 0, 4000], [0, 0, -4000.0], [100.0, 0, -4000]])
    from_front = points[:, 2] > 0
    view = np.where(from_front[:, None], [0, 1], [2, 3]).ravel()
    sparse = model_seen_by_two(points, centers, view)
    normal, blur = sparse_planes(sparse)
    assert np.all(np.sum(normal * points, -1) > 0.9 * 50.0)
    assert 2.0 < blur < 15.0
    front = sparse_planes(of_views(sparse, np.array([0, 1])))[0]
    assert np.all(front[:, 2] > 0)


def model_seen_by_two(points, centers, view):
    return SparseModel(
        registered=np.ones(len(centers), bool),
        body_from_cam=Rigid(np.tile(np.eye(3), (len(centers), 1, 1)), centers),
        points=points,
        point_start=2 * np.arange(len(points) + 1),
        point_view=view.astype(np.int32),
        point_xy=np.zeros((len(view), 2)),
        mean_reprojection_px=0.0,
    )


@pytest.fixture(scope="module")
def wrong(site, tmp_path_factory):
    """A reconstruction that is the reverse."""
    kept = []

    def keeping(model, *rest):
        found = reversal.resolve_depth_reversal(model, *rest)
        kept.append(reversal.reversed_model(found.model))
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapping, "resolve_depth_reversal", keeping)
        reconstruct_sparse(site[0], CAMERAS, tmp_path_factory.mktemp("wrong"), MANY_KEYPOINTS)
    return kept[-1]


@pytest.mark.parametrize("is_lit", [False, True])
def test_shading_sees_a_reverse_that_keypoints_do_not_show_before_they_are_adjusted(wrong, site, is_lit, monkeypatch):
    monkeypatch.setattr(reversal, "HOPELESS", 0.0)

    def shading_of(model):
        return relief_shading(mapping.from_colmap(model, CAMERAS), site[0], CAMERAS, site[1])

    found = reversal.resolve_depth_reversal(copy.deepcopy(wrong), RobustAdjustment(2), shading_of if is_lit else None)
    off = rotation_errors_deg(mapping.from_colmap(found.model, CAMERAS).body_from_cam, site[2]).max()
    assert (off < 0.5) == is_lit
    assert (found.shading is not None) == is_lit


@pytest.mark.parametrize(("doubtful", "kept_right"), [(1.3, True), (100.0, False)])
def test_shading_decides_only_where_keypoints_hardly_do(wrong, site, doubtful, kept_right, monkeypatch):
    """Keypoints have the last word where the errors of the two differ: here against Suns that are wrong."""
    monkeypatch.setattr(reversal, "DOUBTFUL", doubtful)
    monkeypatch.setattr(reversal, "resolve_pose_reversals", lambda model, _adjustment: model)

    def by_wrong_suns(model):
        return relief_shading(mapping.from_colmap(model, CAMERAS), site[0], CAMERAS, site[1] * MIRRORED)

    right = reversal.reversed_model(wrong)
    found = reversal.resolve_depth_reversal(right, RobustAdjustment(2), by_wrong_suns)
    off = rotation_errors_deg(mapping.from_colmap(found.model, CAMERAS).body_from_cam, site[2]).max()
    assert (off < 0.5) == kept_right
