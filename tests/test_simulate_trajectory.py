import numpy as np
import pytest

from photoclinometry.model.camera import Camera
from photoclinometry.model.geometry import angle_between
from photoclinometry.simulate.trajectory import (
    LIGHTING,
    draw_poses,
    draw_suns,
    ground_half_extent,
    looking_at,
    measure_suns,
)

CAMERA = Camera("PINHOLE", 1024, 1024, (10714.0, 10714.0, 512.0, 512.0))


def poses(count=30, seed=0):
    return draw_poses(
        np.random.default_rng(seed), np.full(count, 640e3), CAMERA, np.radians(np.full(count, 25.0)), 15.0
    )


def test_north_is_up_without_roll_and_turns_with_it():
    pose = looking_at(np.array([0.0, 0.0, 100.0]), np.zeros(3), 0.0)
    np.testing.assert_allclose(pose.rotation.T @ [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(pose.rotation.T @ [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], atol=1e-12)
    turned = looking_at(np.array([0.0, 0.0, 100.0]), np.zeros(3), 0.3)
    assert np.linalg.det(turned.rotation) == pytest.approx(1.0)
    assert angle_between(turned.rotation[:, 0], pose.rotation[:, 0]) == pytest.approx(0.3)


def test_views_see_the_site_from_all_sides_within_the_emission_limit():
    body_from_cam = poses()
    center = body_from_cam.translation
    emission = angle_between(center, np.array([0.0, 0.0, 1.0]))
    assert emission.max() <= np.radians(25.0)
    assert np.degrees(emission.max()) > 22.0
    azimuth = np.sort(np.arctan2(center[:, 1], center[:, 0]))
    assert np.diff(azimuth).max() < np.radians(45.0)
    pixel = CAMERA.pixel_from_cam(body_from_cam.inverse()(np.zeros((30, 3))))
    assert np.abs(pixel - 512.0).max() < 60.0
    distance = np.linalg.norm(center, axis=1) / 640e3
    assert 0.949 < distance.min() < distance.max() < 1.051


@pytest.mark.parametrize("name", LIGHTING)
def test_suns_fill_the_ranges_asked(name):
    lighting = LIGHTING[name]
    sun = draw_suns(np.random.default_rng(0), 60, lighting)
    np.testing.assert_allclose(np.linalg.norm(sun, axis=1), 1.0)
    incidence = np.degrees(np.arccos(sun[:, 2]))
    low, high = lighting.incidence_deg
    assert low <= incidence.min() < low + 3
    assert high - 3 < incidence.max() <= high
    mean = np.arctan2(sun[:, 1].mean(), sun[:, 0].mean())
    azimuth = np.degrees(np.angle(np.exp(1j * (np.arctan2(sun[:, 1], sun[:, 0]) - mean))))
    assert 0.9 * lighting.azimuth_spread_deg < np.ptp(azimuth) <= lighting.azimuth_spread_deg


def test_measured_suns_are_off_by_the_sigma_asked_about_both_axes():
    pose = poses(400)
    sun = draw_suns(np.random.default_rng(1), 400, LIGHTING["strong"])
    measured = measure_suns(np.random.default_rng(2), sun, pose, 1e-3, 0.0)
    error = angle_between(np.einsum("kij,kj->ki", pose.rotation, measured), sun)
    assert np.sqrt(np.mean(error**2) / 2) == pytest.approx(1e-3, rel=0.1)


def test_measured_suns_may_be_off_by_one_rotation_in_the_camera_frame():
    pose = poses(400)
    sun = draw_suns(np.random.default_rng(1), 400, LIGHTING["strong"])
    alone, together = (measure_suns(np.random.default_rng(2), sun, pose, 1e-3, common) for common in (0.0, 0.02))
    turn = np.linalg.lstsq(alone, together, rcond=None)[0].T
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert 0.002 < np.arccos((np.trace(turn) - 1) / 2) < 0.1


def test_the_ground_reaches_beyond_every_corner_of_every_image():
    half = ground_half_extent(CAMERA, 640e3, np.radians(25.0), 15.0, 262e3)
    corner = np.array([[-3.0, -3.0], [1027.0, -3.0], [-3.0, 1027.0], [1027.0, 1027.0]])
    reach, low = 0.0, 262e3 - 1500.0
    for seed in range(5):
        body_from_cam = poses(29, seed)
        for k in range(29):
            ray = CAMERA.ray_in_cam(corner) @ body_from_cam.rotation[k].T
            ray /= np.linalg.norm(ray, axis=1, keepdims=True)
            center = body_from_cam.translation[k] + [0.0, 0.0, 262e3]
            b = ray @ center
            t = -b - np.sqrt(b * b - center @ center + low**2)
            reach = max(reach, np.abs((center + t[:, None] * ray)[:, :2]).max())
    assert 0.8 * half < reach < half
