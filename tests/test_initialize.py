"""First normals, brightness and albedo: known answers and recovery of an exact scene."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import Rigid, angle_between, unit
from photoclinometry.model.reflectance import published
from photoclinometry.model.scene import Image
from photoclinometry.photometry.initialize import (
    initial_albedo,
    landmark_spacing_px,
    neighbours,
    normals_from_neighbours,
    sample_brightness,
)
from scenes import synthetic_images, synthetic_scene


def test_normals_of_a_tilted_plane_are_exact_and_face_the_camera():
    rng = np.random.default_rng(0)
    normal = unit(np.array([0.3, -0.2, 1.0]))
    xy = rng.uniform(-50, 50, (500, 2))
    points = np.column_stack([xy, -(xy @ normal[:2]) / normal[2]])
    for camera, expected in ((1e4 * normal, normal), (-1e4 * normal, -normal)):
        found = normals_from_neighbours(points, camera)
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-9)


def test_normals_of_a_finely_sampled_sphere_point_outwards():
    points = unit(np.random.default_rng(1).normal(size=(20_000, 3)))
    points = points[points[:, 2] > 0.5]
    error = angle_between(normals_from_neighbours(points, np.array([0, 0, 100.0])), points)
    assert np.degrees(np.median(error)) < 1.0


def test_normals_need_three_points():
    with pytest.raises(ValueError, match="3 points"):
        normals_from_neighbours(np.zeros((2, 3)), np.zeros(3))


def test_neighbours_on_a_grid_are_the_four_adjacent_points():
    y, x = np.indices((12, 12))
    near, keep = neighbours(np.stack([x, y, 0 * x], -1).reshape(-1, 3).astype(float), 4)
    middle = 5 * 12 + 5
    assert set(near[middle]) == {middle - 1, middle + 1, middle - 12, middle + 12}
    assert keep[middle].all()


def test_neighbours_do_not_reach_across_a_hole():
    points = np.column_stack([np.arange(400.0), np.zeros((400, 2))])
    points[-1, 0] += 60.0
    near, keep = neighbours(points, 4)
    assert not keep[-1].any()
    assert keep[:-3].all()
    assert not (near == np.arange(400)[:, None]).any()


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


def initial(scene, **options):
    landmarks = scene.landmarks
    return initial_albedo(
        landmarks.position, landmarks.normal, scene.tracks, scene.views, scene.reflectance, 0, **options
    )


def test_albedo_of_an_exact_scene_is_exact():
    scene = synthetic_scene(size=20)
    albedo, scale, known = initial(scene)
    np.testing.assert_allclose(albedo, scene.landmarks.albedo, rtol=1e-12)
    np.testing.assert_array_equal(scale, scene.views.scale)
    assert known.all()


def test_scales_of_uncalibrated_views_are_found_relative_to_the_reference():
    scene = synthetic_scene(size=20, reflectance=published("mcewen"))
    start = replace(scene, views=replace(scene.views, scale=np.ones(len(scene.views))))
    albedo, scale, _ = initial(start, estimate_scale=True)
    np.testing.assert_allclose(scale, scene.views.scale / scene.views.scale[0], rtol=1e-9)
    np.testing.assert_allclose(albedo, scene.landmarks.albedo * scene.views.scale[0], rtol=1e-9)


def test_a_landmark_without_light_gets_the_median_albedo_and_is_marked_unknown():
    scene = synthetic_scene(size=20)
    lit = scene.tracks.lit.copy()
    lit[: scene.tracks.start[1]] = False
    albedo, _, known = initial(replace(scene, tracks=replace(scene.tracks, lit=lit)))
    assert not known[0]
    assert known[1:].all()
    assert albedo[0] == np.median(albedo[1:])


def test_light_from_below_is_refused():
    scene = synthetic_scene(size=20)
    with pytest.raises(ValueError, match="no observation is lit"):
        initial(replace(scene, views=replace(scene.views, sun=-scene.views.sun)))
