"""The epipolar geometry of exact correspondences, and Sampson's distance by hand."""

import numpy as np

from photoclinometry.matching.epipolar import fundamental_matrix, sampson_error
from photoclinometry.model.geometry import Rigid
from scenes import synthetic_scene

VIEWS = 6


def test_true_correspondences_satisfy_the_epipolar_constraint():
    scene = synthetic_scene(size=20, views=VIEWS)
    pose, camera = scene.views.body_from_cam, scene.views.cameras
    xy = scene.tracks.keypoint.reshape(-1, VIEWS, 2)
    for view in range(1, VIEWS):
        fundamental = fundamental_matrix(camera[0], pose[0], camera[view], pose[view])
        assert sampson_error(fundamental, xy[:, 0], xy[:, view]).max() < 1e-12


def test_sampson_error_of_a_rectified_pair_is_half_the_squared_row_difference():
    """Two equal cameras side by side: the epipolar lines are the rows, each image takes half the correction."""
    camera = synthetic_scene(size=4).views.cameras[0]
    left = Rigid(np.eye(3), np.zeros(3))
    right = Rigid(np.eye(3), np.array([1.0, 0.0, 0.0]))
    fundamental = fundamental_matrix(camera, left, camera, right)
    error = sampson_error(fundamental, np.array([[10.0, 20.0]]), np.array([[14.0, 20.6]]))
    np.testing.assert_allclose(error, 0.6**2 / 2)
