"""A start at the priors: the map follows the cameras, and a wrong prior shows by what its view sees."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.align import transform_poses
from photoclinometry.densify import triangulate_tracks
from photoclinometry.geometry import Rigid, Similarity, angle_between, so3_exp
from photoclinometry.io.site import PosePrior
from photoclinometry.pose_priors import told
from photoclinometry.pose_start import start_at_priors
from scenes import synthetic_scene


@pytest.fixture(scope="module")
def true():
    return synthetic_scene(size=10, views=7)


def displaced(scene):
    """The scene turned by a degree about the origin and moved by 20 ground samples; it sees the same."""
    move = Similarity(1.0, so3_exp(np.array([0.01, -0.01, 0.005])), np.array([800.0, -500.0, 900.0]))
    views = replace(
        scene.views,
        body_from_cam=transform_poses(move, scene.views.body_from_cam),
        sun=scene.views.sun @ move.rotation.T,
    )
    marks = scene.landmarks
    turned = marks.normal @ move.rotation.T
    return scene.with_estimate(views, replace(marks, position=move(marks.position), normal=turned))


def known(scene, names):
    poses = scene.views.body_from_cam.inverse()
    return {name: PosePrior(poses[scene.views.name.index(name)], 1e-4, 10.0) for name in names}


def test_exact_tracks_are_triangulated_exactly(true):
    found = triangulate_tracks(true.tracks, true.views)
    np.testing.assert_allclose(found, true.landmarks.position, atol=1e-6 * np.abs(true.landmarks.position).max())


def test_a_point_seen_once_has_no_place(true):
    first = replace(true.tracks, start=np.arange(len(true.tracks) + 1))
    assert np.isnan(triangulate_tracks(first, true.views)).all()


def test_the_map_and_the_views_without_priors_follow_those_that_have_one(true):
    priors = told(true, known(true, true.views.name[:5]))
    start, used = start_at_priors(displaced(true), priors)
    assert used.tolist() == [True] * 5 + [False] * 2
    offset = np.linalg.norm(start.landmarks.position - true.landmarks.position, axis=-1)
    assert np.median(offset) < 0.05 * true.gsd
    assert np.median(angle_between(start.landmarks.normal, true.landmarks.normal)) < 1e-3
    for k in range(7):
        seen = start.views.project(k, start.landmarks.position) - true.views.project(k, true.landmarks.position)
        assert np.median(np.linalg.norm(seen, axis=-1)) < 0.5
    np.testing.assert_allclose(start.views.sun[6], true.views.sun[6], atol=1e-3)


def test_a_prior_that_sees_something_else_is_left_out(true):
    priors = known(true, true.views.name)
    name = true.views.name[2]
    pose = priors[name].cam_from_body
    turn = so3_exp(np.array([0.0, np.radians(1.0), 0.0]))
    priors[name] = replace(priors[name], cam_from_body=Rigid(turn @ pose.rotation, turn @ pose.translation))
    start, used = start_at_priors(displaced(true), told(true, priors))
    assert np.flatnonzero(~used).tolist() == [2]
    assert np.median(np.linalg.norm(start.landmarks.position - true.landmarks.position, axis=-1)) < 0.05 * true.gsd
