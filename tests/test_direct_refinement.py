"""Direct refinement: image gradients correct a map that its matches, found with it, confirm."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions
from photoclinometry.model.geometry import Similarity, angle_between, so3_exp, unit
from photoclinometry.model.image import Image
from photoclinometry.model.projection import keypoint_residuals
from photoclinometry.model.reflectance import published
from photoclinometry.model.sampling import sample_image, sample_with_gradient
from photoclinometry.pipeline import direct_refinement, joint_estimate
from photoclinometry.pipeline.direct_refinement import (
    MIN_LIT,
    ROUGH_PASSES,
    has_strayed,
    image_gradients,
    refine_directly,
    reset_landmarks,
)
from photoclinometry.pipeline.joint_estimate import EstimateSettings, JointEstimate
from photoclinometry.registration.alignment import transform_scene
from scenes import synthetic_images, synthetic_scene, thinned

QUICK = AdjustOptions(uncertainty=False)


def confirmed(true, size_gsd=0.2, seed=0):
    """A map whose relief is off by `size_gsd`, smooth over 3 px, along the reference's rays; and matches that agree."""
    from scipy.ndimage import gaussian_filter

    count = round(np.sqrt(len(true.landmarks)))
    wave = gaussian_filter(np.random.default_rng(seed).normal(size=(count, count)), 3.0).ravel()
    away = unit(true.landmarks.position - true.views.body_from_cam.translation[true.reference])
    position = true.landmarks.position + size_gsd * true.gsd * (wave / wave.std())[:, None] * away
    wrong = replace(true, landmarks=replace(true.landmarks, position=position))
    keypoint = wrong.tracks.keypoint + keypoint_residuals(wrong)
    return replace(wrong, tracks=replace(wrong.tracks, keypoint=keypoint))


def height_error(scene, true):
    """Standard deviation [GSD] along the reference's rays, but for what moves all alike or tilts the map."""
    away = unit(true.landmarks.position - true.views.body_from_cam.translation[true.reference])
    off = np.sum((scene.landmarks.position - true.landmarks.position) * away, -1) / true.gsd
    plane = np.column_stack([true.landmarks.pixel, np.ones(len(off))])
    return float(np.std(off - plane @ np.linalg.lstsq(plane, off, rcond=None)[0]))


def estimate(start, step):
    """Of a rough step, too, all iterations."""
    return JointEstimate(options=QUICK)(start, replace(step, rough=False))


@pytest.fixture(scope="module")
def true():
    return synthetic_scene(size=32, views=10)


@pytest.fixture(scope="module")
def images(true):
    return synthetic_images(true)


def test_images_correct_a_map_that_its_matches_confirm(true, images):
    """Relief off by 0.2 GSD: by matches it stays so, by images two thirds and more of the error go."""
    start = confirmed(true)
    matched = estimate(start, EstimateSettings()).scene
    found = refine_directly(start, images, estimate).scene
    assert height_error(start, true) == pytest.approx(0.2, rel=0.1)
    assert height_error(matched, true) > 0.15
    assert height_error(found, true) < 0.06
    assert np.degrees(np.median(angle_between(found.landmarks.normal, true.landmarks.normal))) < 0.5


def test_landmarks_stay_on_their_rays_and_brightness_goes_with_them(true, images):
    start, gradients = image_gradients(confirmed(true), images)
    found = estimate(start, EstimateSettings(gradients=gradients)).scene
    off = np.linalg.norm(keypoint_residuals(found), axis=-1)
    own = found.tracks.view == found.reference
    assert off[own].max() < 0.01
    assert np.median(off[~own]) > 0.02
    again = image_gradients(found, images)[0]
    np.testing.assert_allclose(found.tracks.brightness, again.tracks.brightness, rtol=0.01)
    np.testing.assert_array_equal(found.tracks.keypoint, start.tracks.keypoint)


def test_gradients_predict_the_images_nearby(true, images):
    """A fifth of a pixel away, brightness is that by the gradients to a tenth of the difference."""
    start, gradients = image_gradients(true, images)
    shift = np.array([0.12, -0.16])
    for k in (1, 4):
        mine = start.tracks.view == k
        there = sample_image(images[k], gradients.at[mine] + shift)[0]
        here = start.tracks.brightness[mine]
        left = there - here - gradients.gradient[mine] @ shift
        assert np.std(left) < 0.1 * np.std(there - here)


def test_gradients_of_a_ramp_are_the_ramps():
    rows, cols = np.indices((30, 40))
    image = Image("ramp", (0.3 + 0.02 * cols - 0.005 * rows).astype(np.float32), np.ones((30, 40), bool))
    xy = np.random.default_rng(0).uniform(10, 20, (50, 2))
    np.testing.assert_allclose(sample_with_gradient(image, xy)[1], np.tile([0.02, -0.005], (50, 1)), atol=1e-6)


def test_gradients_beside_invalid_pixels_and_the_border_are_those_of_the_ground():
    col, row = np.meshgrid(np.arange(40.0), np.arange(30.0))
    brightness, valid = 0.3 + 0.02 * col - 0.005 * row, np.ones((30, 40), bool)
    valid[10:12, 20:22], brightness[10:12, 20:22] = False, 99.0
    image = Image("ramp", brightness, valid)
    # Just right of these, the pixels around are invalid, or beyond the border.
    beside = np.array([[19.4, 11.0], [39.4, 15.0]])
    _, found, valid = sample_with_gradient(image, beside)
    assert valid.all()
    assert ((found[:, 0] > 0.0) & (found[:, 0] < 0.02)).all()  # they count as their nearest neighbours
    np.testing.assert_allclose(found[:, 1], -0.005, atol=5e-4)


def test_landmarks_in_few_lit_views_are_left_to_their_matches(true, images):
    """Half of the ground is masked in all but three views. There, matches are met as they are."""
    masked = [replace(image, valid=image.valid.copy()) for image in images]
    half = true.landmarks.position[:, 0] > np.median(true.landmarks.position[:, 0])
    for k in range(3, 10):
        xy = np.floor(true.views.project(k, true.landmarks.position[half])).astype(int)
        for right in (-1, 0, 1):
            for down in (-1, 0, 1):
                masked[k].valid[xy[:, 1] + down, xy[:, 0] + right] = False
    start, gradients = image_gradients(true, masked)
    lit = np.bincount(start.tracks.landmark[start.tracks.lit], minlength=len(true.landmarks))
    assert 0.4 < np.mean(lit < MIN_LIT) < 0.7
    np.testing.assert_array_equal(gradients.of_landmarks(start.tracks), lit >= MIN_LIT)
    found = estimate(start, EstimateSettings(gradients=gradients)).scene
    off = np.linalg.norm(keypoint_residuals(found), axis=-1)
    assert np.median(off[(lit < MIN_LIT)[found.tracks.landmark]]) < 0.02


def test_with_too_few_views_the_last_estimate_is_of_matches():
    few = synthetic_scene(size=16, views=MIN_LIT - 1)
    asked = []

    def record(start, step):
        asked.append(step)
        return estimate(start, step)

    found = refine_directly(confirmed(few), synthetic_images(few), record)
    refine_directly(confirmed(few), synthetic_images(few), record, found.noise)
    assert asked == [EstimateSettings(), EstimateSettings(least_keypoint_factor=found.noise.keypoint_factor)]


def test_between_two_estimates_by_the_images_one_of_the_photometry_alone_finds_the_smooth_errors(true, images):
    asked, noise = [], []

    def record(start, step):
        asked.append(step)
        found = estimate(start, step)
        noise.append(found.noise)
        return found

    wrong = replace(true, reflectance=published("minnaert", "vesta"))
    found = refine_directly(wrong, images, record)
    *rough, photometry, last = asked
    assert found.parameter_sigma.shape == wrong.reflectance.parameters.shape
    assert np.isnan(found.parameter_sigma).all()
    assert len(rough) == ROUGH_PASSES
    for step in rough:
        assert step.rough
        assert step.all_steps
        assert step.gradients.factor is None
    assert [step.noise for step in (*rough, last)] == [None, *noise[:ROUGH_PASSES]]
    assert photometry == EstimateSettings(rough=True, photometry_alone=True)
    assert not last.rough
    assert 0.001 < np.std(last.gradients.factor) < 0.1


@pytest.fixture(scope="module")
def noise(true):
    """As an estimate by matches finds it."""
    return estimate(true, EstimateSettings()).noise


@pytest.mark.parametrize(("poses_are_known", "reweighting"), [(False, 1), (True, None)])
def test_rough_estimates_by_the_images_weigh_as_matches_do_while_poses_are_free(
    true, images, noise, poses_are_known, reweighting
):
    asked = []

    def record(start, step):
        asked.append(step.reweighting)
        return estimate(start, step)

    refine_directly(true, images, record, noise, poses_are_known=poses_are_known)
    assert asked[:ROUGH_PASSES] == [reweighting] * ROUGH_PASSES


def test_a_rough_estimate_may_end_with_all_steps(true, monkeypatch):
    """What follows the first estimate by the images asks whether it has converged; eight steps are few for that."""
    solvers = []

    def recorded(start, options, **_):
        solvers.append(options.solver)
        raise KeyboardInterrupt

    monkeypatch.setattr(joint_estimate, "adjust", recorded)
    for step in (EstimateSettings(), EstimateSettings(rough=True), EstimateSettings(rough=True, all_steps=True)):
        with pytest.raises(KeyboardInterrupt):
            JointEstimate(options=QUICK)(true, step)
    whole, short, long = solvers
    assert whole == QUICK.solver
    assert short.max_steps < long.max_steps == whole.max_steps
    assert short == replace(long, max_steps=short.max_steps) == whole.roughly()


def pushed(scene, which, gsd=3.0):
    """Landmarks `which` moved along the reference's rays."""
    away = unit(scene.landmarks.position - scene.views.body_from_cam.translation[scene.reference])
    position = scene.landmarks.position + gsd * scene.gsd * which[:, None] * away
    return replace(scene, landmarks=replace(scene.landmarks, position=position))


def test_landmarks_that_stray_in_a_pass_are_put_back_and_left_to_their_matches(images, monkeypatch):
    """The first pass is made to leave 20 landmarks 3 GSD off: all others start without that, by their matches."""
    monkeypatch.setattr(direct_refinement, "normals_along_surface", lambda *_: None)
    noisy = synthetic_scene(size=32, views=10, keypoint_noise_px=0.03)
    off, starts = np.arange(1024) % 50 == 7, []

    def first_astray(start, step):
        found = estimate(start, step)
        if step.gradients is None:
            return found
        starts.append((start, step.gradients.of_landmarks(start.tracks)))
        return replace(found, scene=pushed(found.scene, off)) if len(starts) == 1 else found

    found = refine_directly(noisy, images, first_astray).scene
    (_, direct), *others = starts
    assert direct.all()
    assert len(others) == ROUGH_PASSES
    for again, rest in others:
        np.testing.assert_array_equal(rest, ~off)
        assert not has_strayed(again).any()
    again = others[0][0]
    of_reference = (scene.views.body_from_cam[scene.reference].rotation for scene in (again, noisy))
    put, before = (s.landmarks.normal[off] @ turn for s, turn in zip((again, noisy), of_reference, strict=True))
    np.testing.assert_allclose(put, before, atol=1e-9)
    left = np.linalg.norm(keypoint_residuals(found), axis=-1)[off[found.tracks.landmark]]
    assert np.median(left) < 0.06


def test_what_was_put_back_looks_as_it_did_to_the_reference_in_any_frame(true):
    other = Similarity(0.01, so3_exp(np.array([0.3, -0.2, 0.9])), np.array([5.0, 6.0, 7.0]))
    moved, which = transform_scene(other, true), np.arange(1024) < 100
    found = reset_landmarks(pushed(moved, which, 0.5), true, which)
    np.testing.assert_allclose(found.landmarks.position, moved.landmarks.position, atol=2e-3 * moved.gsd)
    np.testing.assert_allclose(found.landmarks.normal, moved.landmarks.normal, atol=1e-12)


def test_a_strided_map_is_corrected_too(true, images):
    start = thinned(confirmed(true), 2)
    found = refine_directly(start, images, estimate).scene
    kept = thinned(true, 2)
    assert height_error(found, kept) < 0.5 * height_error(start, kept)
