"""Tracks of some of the landmarks, and in some of the views."""

import numpy as np

from photoclinometry.model.scene import Tracks

TRACKS = Tracks.of_keypoints(
    np.array([0, 3, 4, 6]), np.array([0, 1, 2, 1, 0, 2], np.int32), np.arange(12.0).reshape(6, 2), 0.1
)
"""Three landmarks in three views, the second in one of them only."""


def test_tracks_of_some_landmarks_are_in_their_order():
    found, picked = TRACKS.of_landmarks(np.array([2, 0]))
    np.testing.assert_array_equal(found.start, [0, 2, 5])
    np.testing.assert_array_equal(picked, [4, 5, 0, 1, 2])
    np.testing.assert_array_equal(found.view, [0, 2, 0, 1, 2])


def test_tracks_in_some_views_keep_every_landmark_and_count_views_anew():
    found = TRACKS.of_views(np.array([0, 2]))
    np.testing.assert_array_equal(found.start, [0, 2, 2, 4])
    np.testing.assert_array_equal(found.view, [0, 1, 0, 1])
    assert found.view.dtype == TRACKS.view.dtype
    np.testing.assert_array_equal(found.keypoint, TRACKS.keypoint[[0, 2, 4, 5]])


def test_all_views_are_the_same_tracks():
    found = TRACKS.of_views(np.arange(3))
    for name in ("start", "view", "keypoint", "keypoint_sigma", "brightness", "lit"):
        np.testing.assert_array_equal(getattr(found, name), getattr(TRACKS, name))
