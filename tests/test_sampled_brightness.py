"""Brightness at keypoints: what is lit, and the resolution at which it is sampled."""

from dataclasses import replace

import numpy as np

from photoclinometry.model.geometry import Rigid
from photoclinometry.model.image import Image
from photoclinometry.photometry.sampled_brightness import landmark_spacing_px, sample_brightness
from scenes import synthetic_images, synthetic_scene


def test_brightness_is_not_lit_outside_beside_invalid_pixels_or_in_shadow():
    brightness = np.full((20, 20), 0.1, np.float32)
    brightness[10:, :] = 0.001
    valid = np.ones((20, 20), bool)
    valid[3, 3] = False
    brightness[3, 3] = np.nan
    image = Image("a", brightness, valid)
    xy = np.array([[8.0, 5.0], [0.4, 5.0], [3.0, 3.0], [4.6, 4.6], [8.0, 15.0], [9.0, 6.0], [12.0, 4.0]])
    value, lit = sample_brightness([image], np.zeros(len(xy), int), xy)
    assert lit.tolist() == [True, False, False, True, False, True, True]
    assert np.isfinite(value).all()


def test_brightness_at_exact_keypoints_is_that_of_the_model():
    scene = synthetic_scene(size=30)
    value, lit = sample_brightness(synthetic_images(scene), scene.tracks.view, scene.tracks.keypoint)
    assert lit.all()
    np.testing.assert_allclose(value, scene.tracks.brightness, rtol=0.05)
    assert np.median(np.abs(value / scene.tracks.brightness - 1)) < 0.003


def test_a_finer_image_is_smoothed_to_the_landmarks_spacing():
    """A map of three pixels per landmark does not resolve stripes of three pixels: its brightness is their mean."""
    col = np.indices((90, 90))[1]
    image = Image("fine", (0.2 + 0.1 * np.cos(2 * np.pi * col / 3.0)).astype(np.float32), np.ones((90, 90), bool))
    xy = np.random.default_rng(0).uniform(20.0, 70.0, (200, 2))
    views = np.zeros(len(xy), int)
    sharp, _ = sample_brightness([image], views, xy)
    smooth, _ = sample_brightness([image], views, xy, spacing_px=np.array([3.0]))
    assert np.abs(sharp - 0.2).max() > 0.05
    np.testing.assert_allclose(smooth, 0.2, atol=0.002)
    np.testing.assert_array_equal(sample_brightness([image], views, xy, spacing_px=np.array([1.1]))[0], sharp)


def test_spacing_is_the_ratio_of_resolutions():
    scene = synthetic_scene(size=10)
    views, position = scene.views, scene.landmarks.position
    middle = position.mean(0)
    pose = views.body_from_cam
    nearer = Rigid(pose.rotation, pose.translation.copy())
    nearer.translation[1] = middle + 0.5 * (pose.translation[1] - middle)
    before = landmark_spacing_px(views, position, 0)
    after = landmark_spacing_px(replace(views, body_from_cam=nearer), position, 0)
    assert before[0] == after[0] == 1.0
    np.testing.assert_allclose(after[1], 2.0 * before[1], rtol=1e-3)
