"""The body-fixed frame from pose priors: exact from exact priors, with the right covariance, robust to a wrong one."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Rigid, Similarity, so3_exp, so3_log
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import BODY_FIXED, OWN
from photoclinometry.registration.alignment import transform_poses
from photoclinometry.registration.georeference import (
    _inverse_left_jacobian,
    _linearized,
    _moved,
    fit_to_priors,
    georeferenced,
)
from scenes import synthetic_scene

TRUTH = Similarity(3.7, so3_exp(np.array([0.4, -1.1, 2.0])), np.array([250.0, -90.0, 40.0]))


def poses(rng, count=8, distance=100.0):
    """Cameras scattered by some tenths of their distance, looking roughly down."""
    centers = np.array([0.0, 0.0, distance]) + rng.normal(size=(count, 3)) * 0.3 * distance
    flip = np.diag([1.0, -1.0, -1.0])
    return Rigid(so3_exp(rng.normal(size=(count, 3)) * 0.2) @ flip, centers)


def priors_of(body_from_cam, rng, noise=0.0, position_sigma=2.0, rotation_sigma=0.01):
    """The true metric poses with errors of `noise` sigmas."""
    true = transform_poses(TRUTH, body_from_cam)
    count = len(body_from_cam)
    turn = so3_exp(noise * rotation_sigma * rng.normal(size=(count, 3)))
    shift = noise * position_sigma * rng.normal(size=(count, 3))
    noisy = Rigid(turn @ true.rotation, true.translation + shift)
    return [PosePrior(noisy[k].inverse(), rotation_sigma, position_sigma) for k in range(count)]


def error(similarity, middle):
    """(7,) the step of `_moved` about `middle` from the truth to a similarity."""
    at = TRUTH.inverse()(middle[None])[0]
    turn = so3_log(similarity.rotation @ TRUTH.rotation.T)
    return np.concatenate([turn, similarity(at[None])[0] - middle, [np.log(similarity.scale / TRUTH.scale)]])


def test_exact_priors_give_the_frame_exactly():
    rng = np.random.default_rng(0)
    body_from_cam = poses(rng)
    fit = fit_to_priors(body_from_cam, priors_of(body_from_cam, rng), 100.0)
    assert fit.similarity.scale == pytest.approx(TRUTH.scale, rel=1e-12)
    np.testing.assert_allclose(fit.similarity.rotation, TRUTH.rotation, atol=1e-12)
    np.testing.assert_allclose(fit.similarity.translation, TRUTH.translation, atol=1e-9)
    assert fit.rms_position < 1e-9
    assert fit.rms_rotation < 1e-12


def test_cameras_on_a_line_determine_the_frame_by_their_attitudes():
    rng = np.random.default_rng(1)
    line = Rigid(poses(rng, 5).rotation, np.linspace(0, 60, 5)[:, None] * np.array([1.0, 0.2, -0.1]))
    fit = fit_to_priors(line, priors_of(line, rng), 100.0)
    np.testing.assert_allclose(fit.similarity.rotation, TRUTH.rotation, atol=1e-12)


def test_the_stated_covariance_is_that_of_the_errors():
    """Over 300 draws the normalised squared error averages its 7 degrees of freedom; residuals likewise."""
    rng = np.random.default_rng(2)
    body_from_cam = poses(rng)
    middle = TRUTH(body_from_cam.translation).mean(0)
    squared, deviations = [], []
    for _ in range(300):
        fit = fit_to_priors(body_from_cam, priors_of(body_from_cam, rng, noise=1.0), 100.0)
        e = error(fit.similarity, middle)
        squared.append(e @ np.linalg.solve(fit.covariance, e))
        deviations.append(np.mean(fit.deviation**2))
    assert np.mean(squared) == pytest.approx(7.0, rel=0.1)
    assert np.mean(deviations) == pytest.approx(1.0 - 7.0 / 48.0, rel=0.05)


def test_each_prior_counts_by_its_own_sigma():
    """With half of the priors good, the frame is as good as from those alone, not as from the mean of all."""
    rng = np.random.default_rng(3)
    body_from_cam = poses(rng)
    middle = TRUTH(body_from_cam.translation).mean(0)
    good = priors_of(body_from_cam, rng, 1.0, position_sigma=0.01, rotation_sigma=1e-5)
    bad = priors_of(body_from_cam, rng, 1.0, position_sigma=20.0, rotation_sigma=0.05)
    mixed = fit_to_priors(body_from_cam, good[:4] + bad[4:], 100.0)
    assert np.linalg.norm(error(mixed.similarity, middle)[3:6]) < 0.1


def test_one_wrong_prior_has_a_large_deviation_and_hardly_moves_the_frame():
    rng = np.random.default_rng(4)
    body_from_cam = poses(rng, 12)
    middle = TRUTH(body_from_cam.translation).mean(0)
    priors = priors_of(body_from_cam, rng, 1.0)
    before = fit_to_priors(body_from_cam, priors, 100.0)
    pose = priors[5].cam_from_body
    priors[5] = replace(priors[5], cam_from_body=Rigid(pose.rotation, pose.translation + 400.0))
    after = fit_to_priors(body_from_cam, priors, 100.0)
    assert after.deviation.argmax() == 5
    assert after.deviation[5] > 50
    shift = error(after.similarity, middle) - error(before.similarity, middle)
    assert np.abs(shift / np.sqrt(np.diag(before.covariance))).max() < 3.0


def known(scene, noise=1.0, **sigmas):
    priors = priors_of(scene.views.body_from_cam, np.random.default_rng(10), noise, **sigmas)
    return dict(zip(scene.views.name, priors, strict=True))


@pytest.mark.parametrize("degrees", [1.0, 170.0])
def test_a_prior_that_contradicts_the_images_is_left_out_and_named(degrees, caplog):
    """With it the frame is that of the others, to the last digit."""
    scene = synthetic_scene(size=8, views=7)
    priors = known(scene, rotation_sigma=1e-3)
    name = scene.views.name[4]
    pose, turn = priors[name].cam_from_body, so3_exp(np.array([0.0, np.radians(degrees), 0.0]))
    spoilt = priors | {name: replace(priors[name], cam_from_body=Rigid(turn @ pose.rotation, turn @ pose.translation))}
    moved, fit = georeferenced(scene, spoilt)
    assert np.flatnonzero(~fit.used).tolist() == [4]
    assert f"{name} is off by" in caplog.text
    assert f"{degrees:.2g}"[0] in caplog.text
    others, _ = georeferenced(scene, {n: p for n, p in priors.items() if n != name})
    np.testing.assert_allclose(moved.landmarks.position, others.landmarks.position, rtol=1e-6)
    assert (moved.frame, scene.frame) == (BODY_FIXED, OWN)


def test_priors_within_their_sigmas_are_all_used(caplog):
    """Also where the scene's poses are off by ten sigmas: that is the scene's error, not a prior's."""
    scene = synthetic_scene(size=8, views=7)
    for noise in (1.0, 10.0):
        _, fit = georeferenced(scene, known(scene, noise, rotation_sigma=1e-3))
        assert fit.used.all()
    assert not caplog.records


def test_priors_that_all_disagree_are_refused():
    scene = synthetic_scene(size=8, views=7)
    rng, priors = np.random.default_rng(11), known(scene)
    for name, prior in priors.items():
        turn = so3_exp(rng.uniform(0.5, 2.0, 3) * rng.choice([-1, 1], 3))
        pose = prior.cam_from_body
        priors[name] = replace(prior, cam_from_body=Rigid(turn @ pose.rotation, turn @ pose.translation))
    with pytest.raises(InputError, match=r"pose priors agree with the images|contradict their orientations"):
        georeferenced(scene, priors)


def test_the_fit_is_a_minimum():
    """Derivatives against differences, at a place away from the minimum."""
    rng = np.random.default_rng(5)
    body_from_cam = poses(rng)
    priors = priors_of(body_from_cam, rng, 3.0, rotation_sigma=0.1)
    true = [p.cam_from_body.inverse() for p in priors]
    known = Rigid(np.array([p.rotation for p in true]), np.array([p.translation for p in true]))
    sigma = np.array([[2.0, 0.1]] * 8)
    _, jacobian = _linearized(TRUTH, body_from_cam, known, sigma)
    middle = TRUTH(body_from_cam.translation).mean(0)
    for k in range(7):
        step = 1e-6 * np.eye(7)[k]
        ahead, _ = _linearized(_moved(TRUTH, middle, step), body_from_cam, known, sigma)
        behind, _ = _linearized(_moved(TRUTH, middle, -step), body_from_cam, known, sigma)
        np.testing.assert_allclose(jacobian[..., k], (ahead - behind) / 2e-6, atol=1e-5)


def test_the_left_jacobian_is_finite_at_zero():
    np.testing.assert_allclose(_inverse_left_jacobian(np.zeros((1, 3)))[0], np.eye(3))


def test_a_scene_in_the_metric_frame_predicts_what_it_did_before():
    scene = synthetic_scene(size=8)
    rng = np.random.default_rng(6)
    names = scene.views.name
    priors = dict(zip(names, priors_of(scene.views.body_from_cam, rng), strict=True))
    moved, fit = georeferenced(scene, priors)
    assert fit.names == names
    np.testing.assert_allclose(moved.landmarks.position, TRUTH(scene.landmarks.position), rtol=1e-9)
    assert moved.gsd == pytest.approx(TRUTH.scale * scene.gsd)
    for k in range(len(names)):
        before = scene.views.project(k, scene.landmarks.position)
        np.testing.assert_allclose(moved.views.project(k, moved.landmarks.position), before, atol=1e-6)


def test_views_without_priors_are_transformed_too_and_two_priors_are_too_few():
    scene = synthetic_scene(size=8)
    priors = priors_of(scene.views.body_from_cam, np.random.default_rng(7))
    some = dict(list(zip(scene.views.name, priors, strict=True))[:3])
    moved, fit = georeferenced(scene, some)
    assert len(fit.names) == 3
    np.testing.assert_allclose(moved.views.sun, scene.views.sun @ TRUTH.rotation.T, atol=1e-9)
    some.popitem()
    with pytest.raises(InputError, match=r"2 of the \d+ views have a pose prior, at least 3"):
        georeferenced(scene, some)


def test_cameras_at_one_place_are_refused():
    body_from_cam = Rigid(np.stack([np.eye(3)] * 4), np.zeros((4, 3)))
    priors = priors_of(body_from_cam, np.random.default_rng(8))
    with pytest.raises(InputError, match="at one place"):
        fit_to_priors(body_from_cam, priors, 100.0)
