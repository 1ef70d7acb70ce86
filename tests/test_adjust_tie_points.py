"""Tie points beside the map: which landmark is which, and pose-only ones hold poses that brightness would bend."""

from dataclasses import replace

import numpy as np
import pytest

from estimate_starts import anchors_around
from photoclinometry.adjust import AdjustOptions, ImageGradients, adjust, tie_points
from photoclinometry.adjust.tie_points import POSE_ONLY_STEP, with_tie_points
from photoclinometry.model.geometry import align_similarity, so3_log
from photoclinometry.pipeline.direct_refinement import image_gradients
from scenes import synthetic_images, synthetic_scene


def gradients_of(scene, direct):
    """Some slope at all observations of landmarks `direct` (J,)."""
    slope = np.where(direct[scene.tracks.landmark, None], [1.0, -2.0], 0.0)
    return ImageGradients(scene.tracks.keypoint, slope)


def test_pose_only_tie_points_have_the_matches_of_direct_landmarks_and_nothing_else():
    scene = synthetic_scene(size=12, views=5)
    row, col = scene.cells
    direct = row < 6
    anchors = anchors_around(scene, count=7)
    company, gradients, members = with_tie_points(scene, gradients_of(scene, direct), anchors)
    expected = np.flatnonzero(direct & (row % POSE_ONLY_STEP == 0) & (col % POSE_ONLY_STEP == 0))
    own = len(scene.landmarks)
    assert len(expected) == 6
    np.testing.assert_array_equal(np.flatnonzero(members.of_map), np.arange(own))
    np.testing.assert_array_equal(np.flatnonzero(members.pose_only), own + np.arange(6))
    np.testing.assert_array_equal(np.flatnonzero(members.sparse), own + 6 + np.arange(7))
    np.testing.assert_array_equal(np.flatnonzero(members.direct), np.flatnonzero(direct))
    np.testing.assert_array_equal(company.landmarks.pixel[members.pose_only], scene.landmarks.pixel[expected])
    tracks = company.tracks
    of_pose_only = members.pose_only[tracks.landmark]
    twice = np.isin(scene.tracks.landmark, expected)
    np.testing.assert_array_equal(tracks.keypoint[of_pose_only], scene.tracks.keypoint[twice])
    assert not tracks.lit[tracks.landmark >= own].any()
    assert not gradients.gradient[tracks.landmark >= own].any()
    np.testing.assert_array_equal(gradients.gradient[tracks.landmark < own], gradients_of(scene, direct).gradient)


def test_without_gradients_there_are_no_pose_only_tie_points():
    scene = synthetic_scene(size=12, views=5)
    company, gradients, members = with_tie_points(scene, None)
    assert company is scene
    assert gradients is None
    assert members.of_map.all()
    assert not members.pose_only.any()
    assert not members.direct.any()


def rotation_error(found, true):
    """Mean turn [rad] of views against each other, maps aligned by their landmarks."""
    true_from_found = align_similarity(found.landmarks.position, true.landmarks.position)
    turned = true_from_found.rotation @ found.views.body_from_cam.rotation
    turn = so3_log(np.swapaxes(true.views.body_from_cam.rotation, 1, 2) @ turned)
    return float(np.linalg.norm(turn - turn.mean(0), axis=1).mean())


MATCH_SIGMA_PX = 0.02


def off_the_model():
    """A scene with matches good to MATCH_SIGMA_PX, and its images, whose brightness is off by up to 3 % in waves."""
    true = synthetic_scene(size=32, views=8, keypoint_noise_px=MATCH_SIGMA_PX)
    rng = np.random.default_rng(3)
    images = []
    for image in synthetic_images(true):
        row, col = np.indices(image.brightness.shape)
        heading, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        wave = np.sin((row * np.sin(heading) + col * np.cos(heading)) / 4.0 + phase)
        images.append(replace(image, brightness=(image.brightness * (1.0 + 0.03 * wave)).astype(np.float32)))
    return true, images


def adjusted(true, images):
    start, gradients = image_gradients(true, images)
    return adjust(start, AdjustOptions(uncertainty=False), gradients=gradients)


def test_pose_only_tie_points_hold_the_poses_where_brightness_is_not_quite_the_models(monkeypatch):
    """The poses stay with the matches, several times better than without pose-only tie points."""
    true, images = off_the_model()
    held = rotation_error(adjusted(true, images).scene, true)
    monkeypatch.setattr(tie_points, "POSE_ONLY_STEP", 10**6)
    assert held < 0.3 * rotation_error(adjusted(true, images).scene, true)


def test_pose_only_tie_points_are_as_noisy_as_their_matches_and_the_map_is_farther_off():
    true, images = off_the_model()
    noise = adjusted(true, images).noise
    sigma = true.tracks.keypoint_sigma[0]
    assert noise.pose_only_keypoint_factor * sigma == pytest.approx(MATCH_SIGMA_PX, rel=0.3)
    assert noise.keypoint_factor > 2.0 * noise.pose_only_keypoint_factor
