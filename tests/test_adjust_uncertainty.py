"""The uncertainties of an adjusted scene: honest, in the scene's order, in the coordinates that `calibrate` expects."""

from dataclasses import replace

import numpy as np
import pytest

from estimate_starts import INDEPENDENT, anchors_around, start_of
from photoclinometry.adjust import AdjustOptions, PosePriors, ScenePriors, adjust
from photoclinometry.adjust.covariance.marginals import Marginals
from photoclinometry.adjust.covariance.uncertainty import (
    bounded_normals,
    error_model,
    scene_uncertainty,
    with_frame_error,
    with_local_errors,
)
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.noise import local_noise
from photoclinometry.adjust.stated_uncertainty import uncertainty_at
from photoclinometry.evaluate.sigma_calibration import sigma_metrics
from photoclinometry.model.geometry import Rigid, so3_log
from photoclinometry.model.scene import Tracks
from photoclinometry.model.sigma import sigma_of_length
from scenes import synthetic_scene

HELD = replace(INDEPENDENT, reflectance_sigma=0.0)


@pytest.fixture(scope="module")
def adjusted():
    true = synthetic_scene(size=16, views=8, keypoint_noise_px=0.3, brightness_noise=0.01)
    return true, adjust(start_of(true), HELD).scene


def test_stated_sigmas_are_those_of_the_errors(adjusted):
    """One draw, independent errors: the mean normalised square of 256 landmarks near one."""
    true, found = adjusted
    metrics = sigma_metrics(found, true.views, true.landmarks, 1.0)
    assert metrics["position_sigma_nees"] == pytest.approx(1.0, abs=0.3)
    assert metrics["normal_sigma_nees"] == pytest.approx(1.0, abs=0.5)
    assert 0.2 < metrics["rotation_sigma_nees"] < 2.5
    assert 0.2 < metrics["center_sigma_nees"] < 2.5


def test_uncertainties_at_the_minimum_are_those_that_the_estimate_states():
    """One statement, but for the misfits from place to place, which are the fit's."""
    found = adjust(start_of(synthetic_scene(size=16, views=8, keypoint_noise_px=0.3, brightness_noise=0.01)), HELD)
    at, noise = uncertainty_at(found.scene, HELD, noise=found.noise)
    local = local_noise(found.scene, found.lit, noise.brightness_sigma, np.ones(256, bool))
    for name in ("position", "normal"):
        axes = at[name].shape[-1]
        expected = local**0.5 * sigma_of_length(at[name], axes)
        np.testing.assert_allclose(sigma_of_length(found.scene.uncertainty[name], axes), expected, rtol=0.02)
    np.testing.assert_allclose(found.scene.uncertainty["sun"], at["sun"], rtol=0.02)


def test_landmarks_of_fewer_views_are_less_certain_and_keep_their_places(adjusted):
    """A corner seen in half of the views: there, and only there, larger sigmas."""
    true, everywhere = adjusted
    corner = (true.landmarks.pixel - (true.region.row, true.region.col) < 5).all(1)
    kept = ~(corner[true.tracks.landmark] & (true.tracks.view % 2 == 1))
    fields = ("view", "keypoint", "keypoint_sigma", "brightness", "lit")
    count = np.bincount(true.tracks.landmark[kept], minlength=len(corner))
    tracks = Tracks(start=np.concatenate([[0], np.cumsum(count)]), **{f: getattr(true.tracks, f)[kept] for f in fields})
    found = adjust(start_of(replace(true, tracks=tracks)), HELD).scene
    grown = found.uncertainty["albedo"] / everywhere.uncertainty["albedo"]
    assert np.median(grown[corner]) > 1.15
    assert np.median(grown[~corner]) < 1.1


def test_geometry_alone_states_what_it_estimates_and_anchors_are_left_out(adjusted):
    true, _ = adjusted
    found = adjust(replace(start_of(true), reflectance=None), INDEPENDENT, tie_points=anchors_around(true)).scene
    assert {name: value.shape for name, value in found.uncertainty.items()} == {
        "position": (256, 3, 3),
        "rotation": (8, 3, 3),
        "center": (8, 3, 3),
    }


def test_with_pose_priors_the_frame_is_theirs(adjusted):
    """Centres known to half a GSD along each axis: stated no worse than that; positions carry the frame's own error,
    which eight such centres leave at a sixth of a GSD or so along each axis, where in the map's frame there is none."""
    true, found = adjusted
    count, sigma = len(true.views), 0.5 * true.gsd
    priors = PosePriors(
        body_from_cam=true.views.body_from_cam,
        rotation_sigma=np.full(count, 1e-6),
        center_sigma=np.full(count, sigma),
    )
    placed = adjust(start_of(true), INDEPENDENT, priors=ScenePriors(pose_priors=priors)).scene
    assert sigma_of_length(placed.uncertainty["center"], 3).max() <= np.sqrt(3) * sigma
    of_placed, of_found = (sigma_of_length(scene.uncertainty["position"], 3) for scene in (placed, found))
    apart = of_placed**2 - of_found**2
    assert np.median(apart) > (sigma / 3) ** 2


def test_they_can_be_left_out_and_older_ones_are_forgotten(adjusted):
    _, found = adjusted
    options = AdjustOptions(uncertainty=False, max_reweightings=1)
    assert adjust(found, options).scene.uncertainty == {}


def test_poses_are_turned_into_the_camera_frame_and_its_centre(adjusted):
    """As `calibrate` measures errors: so3_log(true^T estimate) in C, centres in B; by differences."""
    true, _ = adjusted
    estimate, count = Estimate(true.views, true.landmarks, np.array([30.0, -50.0, 9.0])), len(true.views)
    rng = np.random.default_rng(0)
    root = rng.normal(size=(10 * count, 10 * count)) / np.tile(np.r_[[1e3] * 3, [1.0] * 3, [1e3] * 4], count)[:, None]
    camera = root @ root.T
    step = 1e-5
    by_turn, by_shift = np.zeros((count, 3, 6)), np.zeros((count, 3, 6))
    for i in range(6):
        moved = estimate.step(np.tile(step * np.eye(10)[i], (count, 1)), np.zeros((len(true.landmarks), 6))).views
        turn = np.swapaxes(true.views.body_from_cam.rotation, 1, 2) @ moved.body_from_cam.rotation
        by_turn[..., i] = so3_log(turn) / step
        by_shift[..., i] = (moved.body_from_cam.translation - true.views.body_from_cam.translation) / step
    landmark = np.tile(np.eye(6), (len(true.landmarks), 1, 1))
    mapped = np.ones(len(true.landmarks), bool)
    ones = np.ones(len(landmark))
    marginals = Marginals(
        views=camera,
        landmark=landmark,
        common=camera,
        albedo_relative=ones,
        albedo_by_common=np.stack([ones, ones], -1),
    )
    found = scene_uncertainty(marginals, true.views, estimate.pivot, mapped)
    for k in range(count):
        block = camera[10 * k : 10 * k + 6, 10 * k : 10 * k + 6]
        for name, by in (("rotation", by_turn[k]), ("center", by_shift[k])):
            expected = by @ block @ by.T
            np.testing.assert_allclose(found[name][k], expected, rtol=1e-3, atol=1e-3 * abs(expected).max())


def test_an_error_that_n_share_has_a_nth_of_the_variance_it_is_weighed_with():
    """Side 1: independent. Side 2: a quarter, 3 / 24 of it common. Side 10: a hundredth, all of it common."""

    def model(side, smoothness=(1.0, 1.0)):
        return error_model(side, 1.0, np.array(smoothness), direct=np.zeros(2, bool))

    assert (model(1.0).keypoint[0], model(1.0).keypoint_common) == (1.0, 0.0)
    assert (model(2.0).keypoint[0], model(2.0).keypoint_common) == pytest.approx((0.25, 3 / 24))
    assert (model(10.0).keypoint[0], model(10.0).keypoint_common) == pytest.approx((0.01, 1.0))
    assert model(1.0, (0.3, -0.4)).smoothness == pytest.approx(0.125)
    assert (model(10.0).brightness, model(10.0).brightness_common) == (1.0, 0.0)


def test_keypoints_of_landmarks_that_brightness_holds_add_no_error():
    """They count as if good to many pixels, and are good to a tenth."""
    assert error_model(2.0, 1.0, np.zeros(0), direct=np.array([True, False])).keypoint.tolist() == [0.0, 0.25]


def test_noise_from_place_to_place_does_not_multiply_errors_of_the_frame():
    """A map known to 0.1 within, whose place is known to 3: twice the noise."""
    count = 4
    own, common = (np.tile(size**2 * np.eye(3), (count, 1, 1)) for size in (0.1, 3.0))
    own[3] = np.diag([np.inf, np.inf, np.inf])
    stated = {"position": own + common, "normal": np.tile(np.diag([4.0, 1.0]), (count, 1, 1)), "albedo": np.ones(count)}
    found = with_local_errors(stated, np.full(count, 4.0), {"position": common})
    np.testing.assert_allclose(found["position"][:3], np.tile(9.04 * np.eye(3), (3, 1, 1)))
    assert np.isinf(np.diag(found["position"][3])).all()
    np.testing.assert_allclose(found["normal"], 4.0 * stated["normal"])
    np.testing.assert_allclose(found["albedo"], 2.0)


def test_the_level_of_albedos_does_not_follow_the_noise_of_a_place():
    """Variances of 0.09, 0.08 of them in common, where noise is four times as large: 0.08 + 4 (0.09 - 0.08)."""
    stated = {"albedo": np.full(2, 0.3), "albedo_relative": np.full(2, 0.1)}
    found = with_local_errors(stated, np.full(2, 4.0), {"albedo": np.full(2, 0.08)})
    np.testing.assert_allclose(found["albedo"] ** 2, 0.12)
    np.testing.assert_allclose(found["albedo_relative"], 0.2)


def test_heights_of_single_landmarks_tilt_the_frame_by_hand():
    """Heights of 5 x 5 landmarks at -2 to 2, known to 0.1: tilts about x and y have the variance 0.01 / 50 each, the
    level 0.01 / 25; a camera 30 above has its own errors, those tilts, and moves by 30 times these and by the level."""
    x, y = np.meshgrid(np.arange(-2.0, 3.0), np.arange(-2.0, 3.0))
    position = np.stack([x.ravel(), y.ravel(), np.zeros(25)], -1)
    views = synthetic_scene(size=4, views=3).views
    pose = Rigid(np.tile(np.eye(3), (3, 1, 1)), np.tile([0.0, 0.0, 30.0], (3, 1)))
    own = np.tile(1e-6 * np.eye(3), (3, 1, 1))
    stated = {"position": np.tile(np.diag([0.0, 0.0, 0.01]), (25, 1, 1)), "rotation": own, "center": own}
    found = with_frame_error(stated, position, replace(views, body_from_cam=pose))
    tilt = 0.01 / 50.0
    np.testing.assert_allclose(found["rotation"][1], np.diag([1e-6 + tilt, 1e-6 + tilt, 1e-6]), atol=1e-12)
    np.testing.assert_allclose(
        found["center"][1], 1e-6 * np.eye(3) + np.diag([900 * tilt, 900 * tilt, 0.01 / 25]), atol=1e-12
    )
    np.testing.assert_array_equal(found["position"], stated["position"])
    stated["position"][7, 2, 2] = np.inf
    assert np.isfinite(with_frame_error(stated, position, views)["center"]).all()


def test_a_part_that_is_larger_than_the_whole_leaves_nothing():
    whole, part = np.eye(3)[None], np.diag([2.0, 0.5, 0.5])[None]
    found = with_local_errors({"position": whole}, np.array([9.0]), {"position": part})
    np.testing.assert_allclose(found["position"][0], np.diag([2.0, 5.0, 5.0]))


def test_a_normal_that_nothing_tells_points_anywhere_above_the_ground():
    """Its sigma is that of directions evenly over the hemisphere, in each direction in which nothing tells it."""
    height = np.random.default_rng(0).uniform(size=1_000_000)
    spread = np.sqrt(np.mean(np.arccos(height) ** 2) / 2.0)
    good = np.deg2rad(1.0) ** 2 * np.array([[2.0, 0.5], [0.5, 1.0]])
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    along = turn @ np.diag([good[1, 1], 1e10]) @ turn.T
    found = bounded_normals(np.stack([good, along, np.diag([np.inf, 1.0]), np.diag([np.inf, np.inf])]))
    np.testing.assert_allclose(found[0], good, rtol=2e-3)
    np.testing.assert_allclose(np.linalg.eigvalsh(found[1]), [good[1, 1], spread**2], rtol=3e-3)
    np.testing.assert_allclose(found[2], np.diag([spread**2, 1.0 / (1.0 + spread**-2)]), rtol=3e-3)
    np.testing.assert_allclose(found[3], spread**2 * np.eye(2), rtol=3e-3)
