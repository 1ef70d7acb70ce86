"""The pinhole projection: hand-computed pixels, its derivative, and the compiled statement against the plain one."""

import numpy as np
import pytest

from photoclinometry.model.geometry import so3_exp
from photoclinometry.model.projection import pixel_from_cam, project, project_point

INTRINSICS = np.array([1000.0, 900.0, 320.0, 240.0])


@pytest.fixture
def views():
    """Fifty cameras (rotation, center), each with a point (50, 3) before it."""
    rng = np.random.default_rng(0)
    rotation, center = so3_exp(rng.normal(size=(50, 3))), rng.normal(size=(50, 3))
    in_cam = rng.uniform([-1.0, -1.0, 5.0], [1.0, 1.0, 9.0], (50, 3))
    return rotation, center, np.einsum("kij,kj->ki", rotation, in_cam) + center


def test_a_point_on_the_axis_falls_on_the_principal_point():
    np.testing.assert_array_equal(pixel_from_cam(np.array([0.0, 0.0, 7.0]), INTRINSICS), [320.0, 240.0])


def test_x_goes_right_and_y_down_by_the_focal_length_over_depth():
    np.testing.assert_allclose(pixel_from_cam(np.array([1.0, 2.0, 10.0]), INTRINSICS), [420.0, 420.0])


def test_derivatives_by_position_are_those_of_central_differences(views):
    rotation, center, position = views
    _, by_position = project(rotation, center, INTRINSICS, position)
    for axis, step in enumerate(1e-5 * np.eye(3)):
        ahead, _ = project(rotation, center, INTRINSICS, position + step)
        behind, _ = project(rotation, center, INTRINSICS, position - step)
        np.testing.assert_allclose(by_position[..., axis], (ahead - behind) / 2e-5, rtol=1e-6, atol=1e-5)


def test_the_compiled_statement_is_the_plain_one(views):
    rotation, center, position = views
    expected, _ = project(rotation, center, INTRINSICS, position)
    for r, c, p, pixel in zip(rotation, center, position, expected, strict=True):
        inverse, x, y = project_point(*r.ravel(), *(p - c))
        np.testing.assert_allclose([1000.0 * x + 320.0, 900.0 * y + 240.0], pixel, rtol=1e-12)
        np.testing.assert_allclose(inverse, 1.0 / (r.T @ (p - c))[2], rtol=1e-12)


def test_a_point_behind_the_camera_has_a_negative_inverse_depth():
    assert project_point(*np.eye(3).ravel(), *np.array([0.0, 0.0, -2.0]))[0] == -0.5
