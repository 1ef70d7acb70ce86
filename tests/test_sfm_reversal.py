"""Depth and rotations reversed: two models that nearly parallel rays hardly tell apart."""

import numpy as np
import pytest

from photoclinometry.model.warning import collected_warnings
from photoclinometry.sfm import mapping, reversal
from photoclinometry.sfm.mapping import from_colmap
from photoclinometry.sfm.reconstruct import reconstruct_sparse
from test_sfm import CAMERA, OPTIONS, rotation_errors_deg, site


@pytest.fixture(scope="module")
def one_site():
    return site()


@pytest.fixture(scope="module")
def models(one_site, tmp_path_factory):
    """COLMAP's model and what became of it, where structure from motion had ended in the reversed one."""
    kept = []

    def from_the_wrong_side(model, adjust):
        wrong = reversal.reversed_model(model)
        kept.extend([model, wrong, reversal.right_way_round(wrong, adjust)])
        return kept[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapping, "right_way_round", from_the_wrong_side)
        sparse = reconstruct_sparse(one_site[0], [CAMERA] * 5, tmp_path_factory.mktemp("reversed"), OPTIONS)
    return (*kept, sparse)


def projections(model):
    """Of all points in all registered views: pixels (n, 2) and depths (n,), by view."""
    found = from_colmap(model, 5)
    local = [found.body_from_cam[k].inverse()(found.points) for k in range(5)]
    return [CAMERA.pixel_from_cam(points) for points in local], [points[:, 2] for points in local]


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
    np.testing.assert_allclose(np.linalg.det(from_colmap(there, 5).body_from_cam.rotation), 1.0)


def test_reversed_twice_is_as_before(models):
    model, *_ = models
    twice = reversal.reversed_model(reversal.reversed_model(model))
    for before, after in zip(projections(model)[0], projections(twice)[0], strict=True):
        np.testing.assert_allclose(after, before, atol=1e-6)


def test_the_given_model_is_not_changed(models):
    model, wrong, right = models[:3]
    assert right is not model
    assert right is not wrong
    before = from_colmap(model, 5).points
    reversal.reversed_model(model)
    np.testing.assert_array_equal(from_colmap(model, 5).points, before)


def test_where_both_explain_the_keypoints_alike_it_is_warned(models, monkeypatch):
    def of(model):
        with collected_warnings() as warned:
            reversal.right_way_round(model, lambda _: None)
        return [each.code for each in warned]

    assert of(models[2]) == []
    monkeypatch.setattr(reversal, "ALIKE", 100.0)
    assert of(models[2]) == ["reversal-undecided"]
