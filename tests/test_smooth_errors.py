"""Smooth errors of brightness: they are measured, are told from slopes, and bend neither normals nor surface."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions, ImageGradients, adjust, tie_points
from photoclinometry.adjust.graph.smoothness import Smoothness, bend_between, build_neighbours
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.model.geometry import align_similarity, angle_between, so3_exp, unit
from photoclinometry.model.reflectance import published
from photoclinometry.photometry.albedo import with_model
from photoclinometry.photometry.predict import observation_brightness
from photoclinometry.photometry.smooth_errors import normals_along_surface, smooth_errors
from photoclinometry.pipeline import direct_refinement
from photoclinometry.pipeline.direct_refinement import ROUGH_PASSES, image_gradients, refine_directly
from photoclinometry.pipeline.folder.stage import digest
from photoclinometry.pipeline.joint_estimate import JointEstimate
from scenes import synthetic_images, synthetic_scene

QUICK = AdjustOptions(uncertainty=False)


@pytest.fixture(scope="module")
def true():
    return synthetic_scene(size=40, views=10)


@pytest.fixture(scope="module")
def images(true):
    return synthetic_images(true)


def normal_error(scene, true):
    """Mean [deg], maps aligned by their landmarks."""
    true_from_found = align_similarity(scene.landmarks.position, true.landmarks.position)
    normal = scene.landmarks.normal @ true_from_found.rotation.T
    return float(np.degrees(np.mean(angle_between(normal, true.landmarks.normal))))


def converged_estimate(start, step):
    """Of a rough step, too, to the end."""
    return JointEstimate(options=QUICK)(start, replace(step, rough=False))


def tilted(scene, angle_deg, noise_gsd=0.0, seed=0):
    """The scene with all normals turned about x, and noise of the heights."""
    turn = so3_exp(np.radians([angle_deg, 0.0, 0.0]))
    landmarks = scene.landmarks
    noise = noise_gsd * scene.gsd * np.random.default_rng(seed).normal(size=(len(landmarks), 1)) * [0.0, 0.0, 1.0]
    return replace(
        scene, landmarks=replace(landmarks, normal=landmarks.normal @ turn.T, position=landmarks.position + noise)
    )


def everywhere(scene):
    return np.ones(len(scene.landmarks), bool)


def test_on_a_sphere_neighbours_bend_by_half_the_angle_between_them():
    """The chord between two points of a sphere lies half of their angle below either tangent plane."""
    step = 0.01
    normal = unit(np.array([[0.0, 0.0, 1.0], [np.sin(step), 0.0, np.cos(step)]]))
    pairs = build_neighbours(np.array([[1], [0]]), np.ones((2, 1), bool))
    np.testing.assert_allclose(bend_between(pairs, 7.0 * normal, normal), -step / 2, rtol=1e-9)


def test_a_tilt_that_all_normals_share_is_no_bend():
    normal = unit(np.array([[0.1, 0.0, 1.0], [0.1, 0.0, 1.0]]))
    pairs = build_neighbours(np.array([[1], [0]]), np.ones((2, 1), bool))
    position = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(bend_between(pairs, position, normal), [0.0, 0.0], atol=0.1**3)


@pytest.mark.parametrize("angle_deg", [1.0, 3.0])
def test_normals_get_the_long_waves_of_the_surface(true, angle_deg):
    """A common tilt goes, but for what noise of the heights leaves; relief finer than the average stays."""
    found = normals_along_surface(tilted(true, angle_deg, noise_gsd=0.02), everywhere(true))
    assert np.degrees(np.mean(found.tilt)) == pytest.approx(angle_deg, rel=0.15)
    turned = replace(true, landmarks=replace(true.landmarks, normal=found.normal))
    assert normal_error(turned, true) < 0.25 * angle_deg


def test_noisier_heights_need_a_wider_average(true):
    """Four times the noise, about twice the width: its variance falls by the fourth power of that."""
    sigmas = [normals_along_surface(tilted(true, 3.0, noise), everywhere(true)).sigma for noise in (0.03, 0.12)]
    assert 1.4 * sigmas[0] < sigmas[1] < 2.4 * sigmas[0]


def test_noise_of_the_heights_alone_turns_no_normal(true):
    assert normals_along_surface(tilted(true, 0.0, noise_gsd=0.1), everywhere(true)) is None


def test_landmarks_that_are_not_trusted_do_not_count(true):
    """Heights of every seventh landmark are off by a pixel."""
    wrong = np.arange(len(true.landmarks)) % 7 == 0
    start = tilted(true, 3.0, noise_gsd=0.02)
    landmarks = start.landmarks
    away = np.where(wrong[:, None], [0.0, 0.0, true.gsd], 0.0)
    spoilt = replace(start, landmarks=replace(landmarks, position=landmarks.position + away))
    clean, without = (normals_along_surface(scene, ~wrong) for scene in (start, spoilt))
    np.testing.assert_allclose(without.normal, clean.normal, rtol=0, atol=1e-9)


def test_a_wave_of_brightness_is_found_as_large_as_the_average_leaves_it(true):
    """A Gaussian average of standard deviation s leaves exp(-2 (pi s / length)^2) of a wave."""
    length, sigma, size = 20.0, 2.0, 0.03
    tracks, (row, _) = true.tracks, true.cells
    wave = size * np.sin(2 * np.pi * row / length)[tracks.landmark] * (tracks.view == 3)
    measured = replace(true, tracks=replace(tracks, brightness=observation_brightness(true) / (1.0 + wave)))
    found = smooth_errors(measured, tracks.lit, sigma)
    inner = ((row > 8) & (row < row.max() - 8))[tracks.landmark]
    expected = wave * np.exp(-2.0 * (np.pi * sigma / length) ** 2)
    np.testing.assert_allclose(found[inner], expected[inner], atol=0.02 * size)


def test_an_estimate_counts_brightness_times_the_factor_and_returns_it_as_measured(true, images):
    """Half the brightness with a factor of two is the whole brightness with one of one."""
    start, gradients = image_gradients(true, images)
    ones = np.ones(len(start.tracks))
    whole = adjust(start, QUICK, gradients=gradients._replace(factor=ones)).scene
    halved = replace(start, tracks=replace(start.tracks, brightness=start.tracks.brightness / 2.0))
    halves = ImageGradients(gradients.at, gradients.gradient / 2.0, 2.0 * ones)
    half = adjust(halved, QUICK, gradients=halves).scene
    np.testing.assert_allclose(half.landmarks.position, whole.landmarks.position, rtol=1e-12)
    np.testing.assert_allclose(half.landmarks.albedo, whole.landmarks.albedo, rtol=1e-12)
    np.testing.assert_allclose(half.tracks.brightness, whole.tracks.brightness / 2.0, rtol=1e-12)


def test_without_smooth_errors_their_share_in_the_noise_before_does_not_count(true, images):
    """Else an estimate that begins with brightness alike over wide ground would leave smooth errors in it."""
    start, gradients = image_gradients(true, images)
    before = adjust(start, QUICK, gradients=gradients).noise
    wide = replace(before, brightness_sigma=3.0 * before.brightness_sigma, brightness_correlation_px=20.0)
    given = gradients._replace(factor=np.ones(len(start.tracks)), smooth_over=2.0)
    one, other = (adjust(start, QUICK, gradients=given, noise=noise).noise for noise in (before, wide))
    assert other.brightness_correlation_px == pytest.approx(one.brightness_correlation_px, rel=1e-6)
    assert other.brightness_sigma == pytest.approx(one.brightness_sigma, rel=1e-6)


@pytest.mark.parametrize("model", ["akimov", "mcewen", "minnaert"])
def test_another_reflectance_than_the_grounds_bends_the_normals_less(true, images, model, monkeypatch):
    """The ground is Lunar-Lambert. Where brightness alone holds the poses, normals by another model are off the
    surface; without smooth errors, less so. Estimates start as those of a run do (`with_model`)."""
    monkeypatch.setattr(tie_points, "POSE_ONLY_STEP", 10**6)
    wrong, made = with_model(true, published(model, "vesta")), {}

    def made_once(start, step):
        """Up to the smooth errors, both maps have the same estimates."""
        key = digest((start, step))
        if key not in made:
            made[key] = converged_estimate(start, step)
        return made[key]

    found = refine_directly(wrong, images, made_once).scene
    monkeypatch.setattr(direct_refinement, "normals_along_surface", lambda *_: None)
    before = refine_directly(wrong, images, made_once).scene
    assert len(made) == ROUGH_PASSES + 3
    assert normal_error(found, true) < 0.6 * normal_error(before, true)


def test_smooth_errors_are_not_sought_where_the_estimate_has_not_converged(true, images, monkeypatch):
    """A map that still moves has tilts of its own."""

    def unfinished(start, step):
        return replace(converged_estimate(start, step), converged=not step.rough)

    wrong = replace(true, reflectance=published("minnaert", "vesta"))
    monkeypatch.setattr(direct_refinement, "normals_along_surface", lambda *_: pytest.fail("sought"))
    assert refine_directly(wrong, images, unfinished).converged


def test_no_landmark_to_trust_leaves_the_normals_as_they_are(true):
    assert normals_along_surface(tilted(true, 3.0), ~everywhere(true)) is None


def test_a_bend_is_subtracted_from_the_angle_and_changes_no_derivative(true):
    row, col = true.cells
    index = np.arange(len(row)).reshape(row.max() + 1, col.max() + 1)
    right = np.roll(index, -1, axis=1).ravel()[:, None]
    pairs = build_neighbours(right, (col < col.max())[:, None])
    landmarks, sigma = true.landmarks, 0.02
    estimate = Estimate(true.views, landmarks, landmarks.position.mean(0))
    bend = bend_between(pairs, landmarks.position, landmarks.normal)
    flat, bent = (Smoothness(pairs, sigma, of).linearize(estimate) for of in (None, bend))
    np.testing.assert_allclose(bent.residual, flat.residual - bend / sigma, atol=1e-9)
    np.testing.assert_array_equal(bent.rows, flat.rows)
    assert np.sqrt(bent.cost) < 0.2 * np.sqrt(flat.cost)


def test_smooth_errors_that_are_taken_out_are_no_less_uncertain(true, images):
    """They are known as well as the surface is. So sigmas, those of the reflectance parameters among them, are about
    those of an estimate that has the errors; by the noise that is left, normals would seem three times as good."""
    start, gradients = image_gradients(true, images)
    row, col = true.cells
    wave = 0.02 * np.sin(2 * np.pi * (row + col) / 14.0)[true.tracks.landmark] * np.sign(true.tracks.view % 2 - 0.5)
    spoilt = replace(start, tracks=replace(start.tracks, brightness=start.tracks.brightness / (1.0 + wave)))
    with_errors = adjust(spoilt, gradients=gradients)
    without = adjust(spoilt, gradients=gradients._replace(factor=1.0 + wave))

    def sigma(found):
        return np.sqrt(np.median(np.trace(found.scene.uncertainty["normal"], axis1=1, axis2=2)))

    assert without.noise.brightness_sigma < 0.5 * with_errors.noise.brightness_sigma
    assert sigma(without) == pytest.approx(sigma(with_errors), rel=0.3)
    np.testing.assert_allclose(without.parameter_sigma, with_errors.parameter_sigma, rtol=0.5)
