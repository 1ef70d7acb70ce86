"""The joint estimate of a whole scene: truth recovered, noise measured, anchors used, bad starts refused."""

from dataclasses import replace

import numpy as np
import pytest

from convergence import DEFAULT as CONVERGENCE
from convergence import final_cost, random_start
from estimate_starts import INDEPENDENT, anchors_around, start_of
from matched import OPTIONS, Noise, matched_problem
from photoclinometry.adjust import AdjustOptions, PosePriors, ScenePriors, SolverOptions, adjust
from photoclinometry.model.errors import InputError, ReconstructionError
from photoclinometry.model.geometry import Rigid, align_similarity, angle_between, so3_log
from photoclinometry.model.reflectance import published
from scenes import synthetic_scene

MEASURED = replace(INDEPENDENT, uncertainty=False)
"""Of estimates whose standard deviations nothing asks for."""


def errors(found, true):
    """Mean position error [GSD], normal error [deg] and albedo error [%] after alignment of the maps."""
    true_from_found = align_similarity(found.landmarks.position, true.landmarks.position)
    offset = np.linalg.norm(true_from_found(found.landmarks.position) - true.landmarks.position, axis=1)
    turn = angle_between(found.landmarks.normal @ true_from_found.rotation.T, true.landmarks.normal)
    ratio = found.landmarks.albedo / true.landmarks.albedo
    return offset.mean() / true.gsd, np.degrees(turn).mean(), 100 * np.mean(abs(ratio / np.median(ratio) - 1))


@pytest.fixture(scope="module")
def noisy():
    return synthetic_scene(size=24, views=8, keypoint_noise_px=0.3, brightness_noise=0.01)


@pytest.fixture(scope="module")
def start(noisy):
    return start_of(noisy)


@pytest.fixture(scope="module")
def estimated(start):
    return adjust(start, MEASURED)


def test_photometry_recovers_what_keypoints_alone_cannot(noisy, start, estimated):
    """0.3 px and 1 % noise: normals to 1 degree and albedo to 0.5 %, positions better than by keypoints."""
    position, normal, albedo = errors(estimated.scene, noisy)
    assert estimated.converged
    assert position < 0.25
    assert normal < 1.0
    assert albedo < 0.5
    geometry_alone = adjust(replace(start, reflectance=None), MEASURED)
    assert errors(geometry_alone.scene, noisy)[0] > 1.2 * position
    np.testing.assert_array_equal(geometry_alone.scene.landmarks.albedo, start.landmarks.albedo)


def test_brightness_noise_is_measured(noisy, estimated):
    true = 0.01 * float(np.mean(noisy.tracks.brightness))
    assert estimated.noise.brightness_sigma == pytest.approx(true, rel=0.1)


def test_uncalibrated_brightness_gives_relative_albedo_and_scales():
    scene = synthetic_scene(
        size=20, views=8, reflectance=published("mcewen"), keypoint_noise_px=0.2, brightness_noise=0.005
    )
    gain = scene.views.scale[scene.reference]
    first = replace(
        scene,
        views=replace(scene.views, scale=scene.views.scale / gain, bias=np.zeros(8)),
        landmarks=replace(scene.landmarks, albedo=scene.landmarks.albedo * gain),
    )
    result = adjust(start_of(first, seed=2), MEASURED)
    assert errors(result.scene, scene)[2] < 1.5
    np.testing.assert_allclose(result.scene.views.scale, scene.views.scale / gain, rtol=0.03)


def test_anchors_hold_the_poses_and_leave_the_map_its_own_landmarks(noisy, start):
    def rotation_error(found):
        true_from_found = align_similarity(found.views.body_from_cam.translation, noisy.views.body_from_cam.translation)
        turned = true_from_found.rotation @ found.views.body_from_cam.rotation
        turn = so3_log(np.swapaxes(noisy.views.body_from_cam.rotation, 1, 2) @ turned)
        return np.linalg.norm(turn - turn.mean(0), axis=1).mean()

    options = AdjustOptions(uncertainty=False)
    without, held = adjust(start, options), adjust(start, options, tie_points=anchors_around(noisy))
    assert len(held.scene.landmarks) == len(noisy.landmarks)
    assert len(held.lit) == len(noisy.tracks)
    np.testing.assert_array_equal(held.scene.landmarks.pixel, noisy.landmarks.pixel)
    assert rotation_error(held.scene) < 0.5 * rotation_error(without.scene)


def test_outlier_keypoints_do_not_spoil_the_map(noisy, start, estimated):
    """A tenth of the keypoints wrong by 20 px, with the robust loss: within twice the error of clean ones."""
    rng = np.random.default_rng(6)
    wrong = rng.uniform(size=len(start.tracks)) < 0.1
    keypoint = start.tracks.keypoint + 20.0 * wrong[:, None] * rng.choice([-1.0, 1.0], (len(wrong), 2))
    spoiled = replace(start, tracks=replace(start.tracks, keypoint=keypoint))
    robust = adjust(spoiled, MEASURED).scene
    assert errors(robust, noisy)[0] < 2.0 * errors(estimated.scene, noisy)[0]


@pytest.mark.parametrize("seed", [0, 5, 7])
def test_a_far_start_and_the_truth_end_at_one_cost(seed):
    """Also of the two seeds that stalled before steps were limited against the map's common motion."""
    start, truth = random_start(seed)
    found = adjust(start, CONVERGENCE)
    assert found.converged
    assert final_cost(found) < (1.0 + 1e-4) * final_cost(adjust(truth, CONVERGENCE))


def test_too_little_to_estimate_is_refused(noisy):
    with pytest.raises(ReconstructionError, match="needs 10 landmarks and 3 views at least"):
        adjust(replace(noisy, views=noisy.views[:2]))
    dark = replace(noisy, tracks=replace(noisy.tracks, lit=np.zeros(len(noisy.tracks), bool)))
    with pytest.raises(ReconstructionError, match="towards the Sun"):
        adjust(dark)


def test_more_neighbours_than_there_are_landmarks_are_refused():
    scene = synthetic_scene(size=4, views=3)
    with pytest.raises(InputError, match=r"smooth-neighbours .*: 16 neighbours .*, and the map has 16 landmarks"):
        adjust(scene, AdjustOptions(smooth_neighbours=16))


@pytest.mark.parametrize(
    ("factor", "disk", "sigma"), [(1.2, "lunar-lambert", 0.5), (0.8, "minnaert", 0.5), (1.1, "hapke", 0.1)]
)
def test_reflectance_parameters_are_found_from_a_wrong_start(factor, disk, sigma):
    """All a fifth off (Hapke's a tenth), with a loose prior: within 3 of their standard deviations, and the map better.

    Hapke's opposition surge, which phase angles like these do not tell, stays where the prior holds it.
    """
    start, truth = matched_problem(24, 10, reflectance=published(disk, "vesta"))
    true = truth.reflectance.parameters
    start = replace(start, reflectance=truth.reflectance.with_parameters(factor * true))
    found = adjust(start, replace(OPTIONS, reflectance_sigma=sigma, uncertainty=True))
    assert found.converged
    assert np.all(np.abs(found.scene.reflectance.parameters - true) < 3 * found.parameter_sigma)
    assert np.all(found.parameter_sigma > 0)
    held = adjust(start, replace(OPTIONS, reflectance_sigma=0.0, uncertainty=False))
    assert held.scene.reflectance == start.reflectance

    def tilt(scene):
        return np.median(angle_between(scene.landmarks.normal, truth.landmarks.normal))

    assert tilt(found.scene) < 0.8 * tilt(held.scene)


@pytest.mark.parametrize("disk", ["lunar-lambert", "minnaert", "hapke"])
def test_reflectance_parameters_do_not_depend_on_whether_sigmas_are_stated(disk):
    start, truth = matched_problem(12, 8, reflectance=published(disk, "vesta"))
    loose = replace(OPTIONS, reflectance_sigma=0.1)
    stated, unstated = (adjust(start, replace(loose, uncertainty=sigmas)) for sigmas in (True, False))
    assert stated.scene.reflectance != start.reflectance
    assert unstated.scene.reflectance == stated.scene.reflectance
    assert len(unstated.parameter_sigma) == len(truth.reflectance.parameters)
    assert np.isnan(unstated.parameter_sigma).all()


@pytest.mark.parametrize(("slope", "rest"), [(1.05, 1.12), (0.9, 0.9)])
def test_a_wrong_phase_function_is_found_and_not_taken_by_the_scales(slope, rest):
    """Scales that are right: held as loosely as calibration states them they take what the phase function lacks, and
    brightness 10 degrees beyond the phases mapped is predicted at least twice as badly."""
    start, truth = matched_problem(40, 12, noise=Noise(scale=0.0))
    w0, w1, first, *others = truth.reflectance.values
    bent = truth.reflectance.with_parameters([w0, w1, slope * first, *(rest * c for c in others)])
    start = replace(start, reflectance=bent)
    phase = angle_between(truth.views.sun, truth.views.body_from_cam.translation)

    def beyond(adjusted):
        """Relative error of brightness beyond the phases mapped, where it is right in the middle of these."""
        asked = np.append(phase, phase.max() + np.radians(10.0))
        ratio = adjusted.scene.reflectance.phase_function(asked) / truth.reflectance.phase_function(asked)
        return abs(ratio[-1] / np.median(ratio[:-1]) - 1.0)

    found, loose = adjust(start, MEASURED), adjust(start, replace(MEASURED, scale_sigma=0.01))
    assert beyond(found) < 0.012
    assert beyond(found) < 0.5 * beyond(loose)
    np.testing.assert_allclose(found.scene.views.scale, 1.0, atol=1e-3)


def test_scales_that_scatter_are_left_to():
    """By a hundredth: they are found far better than that, and what they scatter by is."""
    start, truth = matched_problem(60, 12)
    found = adjust(start, MEASURED)
    scatter = np.std(truth.views.scale)
    assert np.std(found.scene.views.scale / truth.views.scale) < 0.4 * scatter
    assert found.noise.scale_scatter == pytest.approx(scatter, rel=0.25)


def test_a_model_without_parameters_has_none_to_estimate():
    scene = synthetic_scene(size=12, reflectance=published("mcewen"))
    found, held = (adjust(scene, AdjustOptions(reflectance_sigma=sigma)) for sigma in (0.1, 0.0))
    assert len(found.parameter_sigma) == 0
    assert found.scene.landmarks.normal.tobytes() == held.scene.landmarks.normal.tobytes()


def test_an_estimate_of_an_estimate_is_held_by_what_was_given():
    """The prior is of the reflectance given, not of the last estimate: else every new one would loosen it."""
    start, truth = matched_problem(24, 10, reflectance=published("lunar-lambert", "vesta"))
    given = truth.reflectance.with_parameters(1.2 * truth.reflectance.parameters)
    exactly = SolverOptions(relative_decrease=1e-9, absolute_decrease=1e-3, settled=0.0)
    tight = replace(OPTIONS, reflectance_sigma=0.03, uncertainty=False, solver=exactly)
    once = adjust(replace(start, reflectance=given), tight).scene
    again, drifted = adjust(once, tight, priors=ScenePriors(reflectance=given)).scene, adjust(once, tight).scene

    def moved(scene):
        return np.abs(once.reflectance.relative_change(scene.reflectance)).max()

    assert moved(again) < 0.1 * moved(drifted)


def test_pose_priors_place_the_map():
    """Camera centres known to a tenth of a ground sample, two samples from where structure from motion put them: the
    map follows them."""
    start, truth = matched_problem(16, 8)
    shift = np.array([2.0, -1.0, 1.5])
    poses = truth.views.body_from_cam
    priors = PosePriors(
        body_from_cam=Rigid(poses.rotation, poses.translation + shift),
        rotation_sigma=np.full(8, 1e-6),
        center_sigma=np.full(8, 0.1),
    )
    moved = adjust(start, replace(OPTIONS, uncertainty=False), priors=ScenePriors(pose_priors=priors)).scene
    np.testing.assert_allclose(moved.views.body_from_cam.translation, poses.translation + shift, atol=0.5)
    offset = np.median(moved.landmarks.position - truth.landmarks.position, axis=0)
    np.testing.assert_allclose(offset, shift, atol=0.3)


def test_landmarks_are_held_by_their_priors():
    start, _ = matched_problem(16, 8)
    held = replace(OPTIONS, position_sigma_gsd=1e-6, normal_sigma_rad=1e-7, albedo_sigma=1e-7, uncertainty=False)
    after, before = adjust(start, held).scene.landmarks, start.landmarks
    np.testing.assert_allclose(after.position, before.position, atol=1e-4)
    np.testing.assert_allclose(after.normal, before.normal, atol=1e-5)
    np.testing.assert_allclose(after.albedo, before.albedo, rtol=1e-5)


def test_suns_do_not_follow_what_brightness_errs_by_all_over_a_view():
    """A view's slopes towards some direction brighter by 3 %, as a wrong model or relief finer than a pixel has it:
    so many landmarks insist on other Suns that these leave their measurements by many sigmas, and take the normals
    along. Held against that, they stay, and without such errors nothing is held."""
    start, truth = matched_problem(40, 10)
    tracks, east_north = start.tracks, np.random.default_rng(3).normal(size=(10, 2))
    slope = np.sum(east_north[start.tracks.view] * truth.landmarks.normal[start.tracks.landmark, :2], -1)
    wrong = replace(start, tracks=replace(tracks, brightness=tracks.brightness * (1 + 0.03 * slope)))
    known = PosePriors(
        body_from_cam=truth.views.body_from_cam, rotation_sigma=np.full(10, 1e-6), center_sigma=np.full(10, 0.1)
    )

    def found(scene, **options):
        adjustment = adjust(
            scene, replace(INDEPENDENT, uncertainty=False, **options), priors=ScenePriors(pose_priors=known)
        )
        suns = angle_between(adjustment.scene.views.sun, truth.views.sun)
        normals = angle_between(adjustment.scene.landmarks.normal, truth.landmarks.normal)
        return np.sqrt(np.mean(suns**2)), np.mean(normals), adjustment.noise.view_prior_factor

    loose_sun, loose_normal, _ = found(wrong)
    sun, normal, factor = found(wrong, brightness_correlation_px=None)
    assert loose_sun > 4e-3
    assert sun < 2e-3
    assert normal < 0.8 * loose_normal
    assert factor > 1.3
    assert found(start, brightness_correlation_px=None)[2] == 1.0


def test_keypoints_may_be_stated_to_be_worse_than_they_are_met():
    """The estimate is the same; without brightness, sigmas of positions and poses grow as those of keypoints do."""
    scene = synthetic_scene(size=12, views=5, keypoint_noise_px=0.3, reflectance=None)
    found = adjust(scene, INDEPENDENT)
    stated = adjust(scene, INDEPENDENT, least_keypoint_factor=3.0 * found.noise.keypoint_factor)
    np.testing.assert_array_equal(stated.scene.landmarks.position, found.scene.landmarks.position)
    assert stated.noise == found.noise
    for name in ("position", "rotation", "center"):
        trace = [np.trace(one.scene.uncertainty[name], axis1=1, axis2=2) for one in (found, stated)]
        assert np.sqrt(np.median(trace[1] / trace[0])) == pytest.approx(3.0, rel=0.05)
    no_better = adjust(scene, INDEPENDENT, least_keypoint_factor=0.3 * found.noise.keypoint_factor)
    np.testing.assert_array_equal(no_better.scene.uncertainty["position"], found.scene.uncertainty["position"])
