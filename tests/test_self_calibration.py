"""Distortion told by keypoints: recovery of known lenses, derivatives, and honest sigmas."""

import numpy as np
import pytest

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.lens import NO_DISTORTION, Lens, displacement_terms
from photoclinometry.model.sparse import SparseModel
from photoclinometry.sfm.self_calibration import SIGNIFICANT, LensEstimate, _Adjustment, _patches, estimate_lenses

CAMERA = Camera("PINHOLE", 512, 512, (5000.0, 5000.0, 256.0, 256.0))
WIDE = Camera("PINHOLE", 400, 300, (600.0, 600.0, 200.0, 150.0))
NOISE_PX = 0.2


def look_at(center, target):
    """Poses (K,) of cameras at centres (K, 3) that look at targets (K, 3), x to the right."""
    z = (target - center) / np.linalg.norm(target - center, axis=-1, keepdims=True)
    x = np.cross(np.broadcast_to([0.0, 1.0, 0.0], z.shape), z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return Rigid(np.stack([x, np.cross(z, x), z], -1), center)


def model_of(lenses, cameras=(CAMERA,), points=600, views=8, seed=0, noise_px=NOISE_PX, shift=None):
    """A sparse model whose observed pixels are distorted: poses and points are true, as found without noise.

    shift: (P, 2) that the pixels of a point are displaced by in half of the views, as by shading.
    """
    rng = np.random.default_rng(seed)
    ground = np.column_stack([rng.uniform(-220, 220, (points, 2)), rng.normal(0, 30, points)])
    angle = np.linspace(0, 2 * np.pi, views, endpoint=False)
    distance = np.array([cameras[k % len(cameras)].focal_px[0] for k in range(views)])
    tilt = 0.2 + 0.4 * (np.arange(views) % 3) / 2
    towards = np.column_stack([tilt * np.cos(angle), tilt * np.sin(angle), np.ones(views)])
    target = np.column_stack([rng.uniform(-80, 80, (views, 2)), np.zeros(views)])
    poses = look_at(towards / np.linalg.norm(towards, axis=-1, keepdims=True) * distance[:, None], target)
    point, view, pixel = [], [], []
    for k in range(views):
        camera, lens = cameras[k % len(cameras)], lenses[k % len(cameras)]
        ideal = camera.pixel_from_cam(poses[k].inverse()(ground))
        seen = ideal + lens.displacement(ideal, camera) + rng.normal(0, noise_px, ideal.shape)
        if shift is not None and k % 2:
            seen = seen + shift
        inside = ((seen >= 0) & (seen <= (camera.width, camera.height))).all(-1)
        point += np.flatnonzero(inside).tolist()
        view += [k] * int(inside.sum())
        pixel += seen[inside].tolist()
    order = np.argsort(point, kind="stable")
    count = np.bincount(point, minlength=points)
    return SparseModel(
        registered=np.ones(views, bool),
        body_from_cam=poses,
        points=ground,
        point_start=np.concatenate([[0], np.cumsum(count)]),
        point_view=np.array(view, np.int32)[order],
        point_xy=np.array(pixel)[order],
        mean_reprojection_px=0.3,
    )


def estimated(model, cameras=(CAMERA,)):
    of_view = np.arange(len(model.registered)) % len(cameras)
    return estimate_lenses(model, list(cameras), of_view)


@pytest.mark.parametrize("corner_px", [(-2.0, 0.0, 0.0, 0.0), (3.0, -1.5, 0.0, 0.0), (0.0, 0.0, 0.2, -0.15)])
def test_a_known_lens_is_found_again(corner_px):
    (found,) = estimated(model_of([Lens.of_corner_px(np.array(corner_px), CAMERA)]))
    off = found.corner_px - corner_px
    assert off @ np.linalg.solve(found.covariance, off) < 13.3  # chi-squared of four, 1 %
    assert np.abs(off[:2].sum()) < 0.2
    np.testing.assert_allclose(found.lens.corner_px(CAMERA), found.corner_px)


def test_without_distortion_none_is_clear():
    (found,) = estimated(model_of([NO_DISTORTION]))
    assert found.shift_px < SIGNIFICANT * found.shift_sigma_px
    assert not found.is_clear


def test_each_camera_has_its_own_lens():
    lenses = [Lens.of_corner_px(np.array([2.0, 0, 0, 0]), CAMERA), Lens.of_corner_px(np.array([-3.0, 0, 0, 0]), WIDE)]
    first, second = estimated(model_of(lenses, (CAMERA, WIDE)), (CAMERA, WIDE))
    assert first.corner_px[:2].sum() == pytest.approx(2.0, abs=0.3)
    assert second.corner_px[:2].sum() == pytest.approx(-3.0, abs=0.3)
    assert first.is_clear
    assert second.is_clear


def test_a_camera_of_which_no_view_is_registered_has_what_is_known_beforehand():
    model = model_of([NO_DISTORTION])
    first, second = estimate_lenses(model, [CAMERA, WIDE], np.zeros(8, int))
    assert not first.is_clear
    assert second.shift_px == 0.0
    assert second.shift_sigma_px == pytest.approx(
        np.sqrt(2) * 0.02 * 250.0, rel=0.3
    )  # two coefficients of 5 px, x alone
    assert not second.is_clear


def test_keypoints_without_errors_are_no_division_by_zero():
    (found,) = estimated(model_of([NO_DISTORTION], noise_px=0.0))
    assert found.shift_px == pytest.approx(0.0, abs=1e-6)
    assert not found.is_clear


def test_the_sigma_is_that_of_repeated_draws():
    """Thirty draws of noise: displacements of the corner scatter as stated, to a third."""
    corner = displacement_terms(np.array([512.0, 512.0]), CAMERA)[0]
    found = [estimated(model_of([NO_DISTORTION], points=300, seed=seed))[0] for seed in range(30)]
    drawn = np.array([corner @ e.corner_px for e in found])
    stated = np.sqrt([corner @ e.covariance @ corner for e in found])
    assert np.sqrt(np.mean(drawn**2)) == pytest.approx(np.sqrt(np.mean(stated**2)), rel=0.35)


def test_errors_that_neighbours_share_widen_the_sigma():
    """Waves over the ground shift the pixels of half of the views by 0.3 px: many keypoints, few independent errors."""
    rng = np.random.default_rng(3)
    ground = model_of([NO_DISTORTION], points=2000).points
    wave = np.stack([np.sin(ground[:, :2] @ rng.normal(0, 0.02, 2) + k) for k in range(2)], -1)
    (without,) = estimated(model_of([NO_DISTORTION], points=2000))
    (shifted,) = estimated(model_of([NO_DISTORTION], points=2000, shift=0.3 * wave))
    assert (np.diag(shifted.covariance)[:2] > 4 * np.diag(without.covariance)[:2]).all()


def test_derivatives_equal_differences():
    model = model_of([Lens.of_corner_px(np.array([2.0, 1.0, 0.1, 0.2]), CAMERA)], points=80, views=4)
    problem = _Adjustment(model, [CAMERA], np.zeros(4, int))
    state = problem.start._replace(lens=np.zeros((1, 4)))
    residuals = problem._residuals(state)
    normal = problem._normal(state, residuals)
    weight = np.asarray(normal.residual).reshape(-1, 2)[:, :1] / residuals.error[:, :1]
    rows = normal.rows.toarray()
    for column in (0, 4, 9, 14, 24, 25, 26, 27):
        step = np.zeros(rows.shape[1])
        step[column] = 1e-5
        after = problem._residuals(problem._moved(state, step, np.zeros((80, 3)))).error
        before = problem._residuals(problem._moved(state, -step, np.zeros((80, 3)))).error
        expected = (weight * (after - before) / 2e-5).ravel()
        np.testing.assert_allclose(rows[:, column], expected, atol=1e-4 * max(np.abs(expected).max(), 1e-3))


def test_too_few_keypoints_tell_nothing():
    assert estimated(model_of([NO_DISTORTION], points=12, views=3)) == []


def test_large_models_are_thinned_and_say_the_same():
    lens = Lens.of_corner_px(np.array([2.0, 0.0, 0.0, 0.0]), CAMERA)
    (found,) = estimated(model_of([lens], points=6000, views=8))
    assert found.corner_px[:2].sum() == pytest.approx(2.0, abs=0.05)


def test_patches_hold_equally_many_points():
    patch = _patches(np.random.default_rng(0).normal(size=(6400, 3)))
    np.testing.assert_array_equal(np.bincount(patch), np.full(64, 100))


def test_half_a_pixel_or_five_sigmas_is_not_clear():
    def of(shift_px, sigma_px):
        return LensEstimate(
            camera=CAMERA, corner_px=np.zeros(4), covariance=np.eye(4), shift_px=shift_px, shift_sigma_px=sigma_px
        )

    assert of(0.6, 0.1).is_clear
    assert not of(0.4, 0.01).is_clear
    assert not of(2.0, 0.5).is_clear
