"""Landmarks beside the map's own: who is who, and that copies hold poses that brightness would bend."""

from dataclasses import replace

import numpy as np

from photoclinometry.adjust import AdjustOptions, ImageSlopes, adjust, companions
from photoclinometry.adjust.companions import COPY_STEP, with_companions
from photoclinometry.model.geometry import align_similarity, so3_log
from photoclinometry.pipeline.direct_refinement import image_gradients
from scenes import synthetic_images, synthetic_scene
from test_adjust_estimate import anchors_around


def slopes_of(scene, direct):
    """Some slope at all observations of landmarks `direct` (J,)."""
    slope = np.where(direct[scene.tracks.landmark, None], [1.0, -2.0], 0.0)
    return ImageSlopes(scene.tracks.keypoint, slope)


def test_copies_have_the_matches_of_direct_landmarks_and_nothing_else():
    scene = synthetic_scene(size=12, views=5)
    row, col = scene.cells
    direct = row < 6
    anchors = anchors_around(scene, count=7)
    company, slopes, roles = with_companions(scene, anchors, slopes_of(scene, direct))
    expected = np.flatnonzero(direct & (row % COPY_STEP == 0) & (col % COPY_STEP == 0))
    own = len(scene.landmarks)
    assert len(expected) == 6
    np.testing.assert_array_equal(np.flatnonzero(roles.mapped), np.arange(own))
    np.testing.assert_array_equal(np.flatnonzero(roles.copy), own + np.arange(6))
    np.testing.assert_array_equal(np.flatnonzero(roles.anchor), own + 6 + np.arange(7))
    np.testing.assert_array_equal(np.flatnonzero(roles.direct), np.flatnonzero(direct))
    np.testing.assert_array_equal(company.landmarks.pixel[roles.copy], scene.landmarks.pixel[expected])
    tracks = company.tracks
    of_copies = roles.copy[tracks.landmark]
    twice = np.isin(scene.tracks.landmark, expected)
    np.testing.assert_array_equal(tracks.keypoint[of_copies], scene.tracks.keypoint[twice])
    assert not tracks.lit[tracks.landmark >= own].any()
    assert not slopes.slope[tracks.landmark >= own].any()
    np.testing.assert_array_equal(slopes.slope[tracks.landmark < own], slopes_of(scene, direct).slope)


def test_without_slopes_there_are_no_copies():
    scene = synthetic_scene(size=12, views=5)
    company, slopes, roles = with_companions(scene, None, None)
    assert company is scene
    assert slopes is None
    assert roles.mapped.all()
    assert not roles.copy.any()
    assert not roles.direct.any()


def rotation_error(found, true):
    """Mean turn [rad] of views against each other, maps aligned by their landmarks."""
    true_from_found = align_similarity(found.landmarks.position, true.landmarks.position)
    turned = true_from_found.rotation @ found.views.body_from_cam.rotation
    turn = so3_log(np.swapaxes(true.views.body_from_cam.rotation, 1, 2) @ turned)
    return float(np.linalg.norm(turn - turn.mean(0), axis=1).mean())


def test_copies_hold_the_poses_where_brightness_is_not_quite_the_models(monkeypatch):
    """Brightness off by up to 3 % in waves across each image, matches good to 0.02 px: the poses stay with the matches,
    several times better than without copies."""
    true = synthetic_scene(size=32, views=8, keypoint_noise_px=0.02)
    rng = np.random.default_rng(3)
    images = []
    for image in synthetic_images(true):
        row, col = np.indices(image.brightness.shape)
        heading, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        wave = np.sin((row * np.sin(heading) + col * np.cos(heading)) / 4.0 + phase)
        images.append(replace(image, brightness=(image.brightness * (1.0 + 0.03 * wave)).astype(np.float32)))
    options = AdjustOptions(uncertainty=False)

    def error():
        start, slopes = image_gradients(true, images)
        return rotation_error(adjust(start, options, slopes=slopes).scene, true)

    held = error()
    monkeypatch.setattr(companions, "COPY_STEP", 10**6)
    assert held < 0.3 * error()
