"""Triangulation: exact for exact tracks, the textbook's solution for noisy ones, none where rays do not fix a point."""

from dataclasses import replace

import numpy as np

from photoclinometry.matching.triangulation import PinholeCameras, triangulate, triangulate_tracks
from scenes import synthetic_scene

VIEWS, SIZE = 6, 20


def test_triangulation_agrees_with_the_textbook_transform():
    """The compiled solution against the singular vector of the stacked homogeneous system."""
    scene = synthetic_scene(size=SIZE, views=VIEWS)
    cam_from_body = scene.views.body_from_cam.inverse()
    noisy = scene.tracks.keypoint.reshape(-1, VIEWS, 2) + np.random.default_rng(0).normal(
        scale=0.05, size=(SIZE * SIZE, VIEWS, 2)
    )
    intrinsics, pose = scene.views.intrinsics, scene.views.body_from_cam
    cameras = PinholeCameras(np.ascontiguousarray(pose.rotation), pose.translation, intrinsics)
    for xy in noisy[::37]:
        point = np.zeros(3)
        used = np.ones(VIEWS, bool)
        assert triangulate(xy, np.ones(VIEWS), used, cameras, point)
        rows = []
        for k in range(VIEWS):
            matrix = np.column_stack([cam_from_body.rotation[k], cam_from_body.translation[k] / scene.gsd])
            x, y = (xy[k] - intrinsics[k, 2:]) / intrinsics[k, :2]
            rows += [x * matrix[2] - matrix[0], y * matrix[2] - matrix[1]]
        solution = np.linalg.svd(np.array(rows))[2][-1]
        expected = scene.gsd * solution[:3] / solution[3]
        assert np.linalg.norm(point - expected) < 0.05 * scene.gsd


def test_exact_tracks_are_triangulated_exactly():
    true = synthetic_scene(size=10)
    found = triangulate_tracks(true.tracks, true.views)
    np.testing.assert_allclose(found, true.landmarks.position, atol=1e-6 * np.abs(true.landmarks.position).max())


def test_a_point_seen_once_has_no_position():
    true = synthetic_scene(size=4)
    once = replace(true.tracks, start=np.arange(len(true.tracks) + 1))
    assert np.isnan(triangulate_tracks(once, true.views)).all()
