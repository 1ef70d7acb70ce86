"""Every factor's Jacobian against central differences."""

import numpy as np
import pytest

from jacobians import numerical_jacobian
from photoclinometry.adjust.graph import factors
from photoclinometry.model.geometry import so3_exp, sphere_step, unit
from photoclinometry.model.reflectance import MODELS, starting_model

RNG = np.random.default_rng(3)
ROTATION = so3_exp(np.array([0.2, -2.8, 0.4]))
CENTER = np.array([100.0, 50.0, 9000.0])
POSITION = np.array([12.0, -30.0, 8.0])
PIVOT = np.array([20.0, -10.0, 30.0])
INTRINSICS = np.array([9800.0, 9900.0, 512.0, 500.0])


def orbit(x):
    """ROTATION and CENTER moved by the six local coordinates of a pose."""
    turn = so3_exp(x[:3])
    return turn @ ROTATION, PIVOT + turn @ (CENTER - PIVOT + x[3:])


def test_projection_jacobian():
    position = CENTER + ROTATION @ np.array([0.02, -0.03, 1.0]) * 9000
    keypoint = np.array([700.0, 230.0])
    args = INTRINSICS, keypoint, 0.3, PIVOT
    _, by_position, by_pose = factors.projection(ROTATION, CENTER, args[0], position, *args[1:])

    def moved(x):
        rotation, center = orbit(x[3:])
        return factors.projection(rotation, center, args[0], position + x[:3], *args[1:])[0]

    numeric = numerical_jacobian(moved, 9, np.r_[[1e-1] * 3, [1e-4] * 3, [1e-1] * 3])
    np.testing.assert_allclose(np.hstack([by_position, by_pose]), numeric, rtol=1e-6, atol=1e-7 * abs(numeric).max())


def geometry(case):
    """Sun and normal of a delicate case, for a camera at CENTER and a landmark at POSITION."""
    to_camera = unit(CENTER - POSITION)
    if case == "near zero phase":
        return sphere_step(to_camera, np.array([1e-3, 5e-4])), unit(to_camera + [0.3, 0.1, 0])
    if case == "grazing Sun":
        sun = unit(np.array([1.0, 0.0, 0.05]))
        return sun, unit(np.array([0.02, 0.1, 1.0]))
    if case == "grazing camera":
        return unit(np.array([0.5, 0.2, 1.0])), unit(np.array([1.0, 0.3, 0.05]))
    return unit(np.array([0.5, -0.6, 0.8])), unit(np.array([0.1, 0.2, 1.0]))


@pytest.mark.parametrize("case", ["typical", "near zero phase", "grazing Sun", "grazing camera"])
@pytest.mark.parametrize("disk", MODELS)
def test_photometric_jacobian(disk, case):
    vector = starting_model(disk, "vesta").parameter_vector
    sun, normal = geometry(case)
    scale, bias, albedo, rest = 1.1, 0.01, 0.35, (0.2, 0.004, PIVOT)
    _, analytic = factors.photometric(vector, CENTER, sun, scale, bias, POSITION, normal, albedo, *rest)

    def moved(x):
        return factors.photometric(
            vector, orbit(x[6:12])[1], sphere_step(sun, x[12:14]), scale + x[14], bias + x[15],
            POSITION + x[:3], sphere_step(normal, x[3:5]), albedo + x[5], *rest,
        )[0]  # fmt: skip

    steps = np.r_[[1.0] * 3, [1e-5] * 2, 1e-3, [1e-5] * 3, [1.0] * 3, [1e-5] * 2, 1e-3, 1e-4]
    numeric = numerical_jacobian(moved, 16, steps)[0]
    np.testing.assert_allclose(analytic, numeric, rtol=1e-4, atol=1e-6 * abs(numeric).max())


def test_direct_jacobian():
    """Brightness taken from the image where the landmark projects: the image's slope in all that moves the landmark
    in it."""
    vector = starting_model("lunar-lambert", "vesta").parameter_vector
    sun, normal = geometry("typical")
    position = CENTER + ROTATION @ np.array([0.02, -0.03, 1.0]) * 9000
    image = 0.2, np.array([700.0, 230.0]), np.array([0.004, -0.007])
    rest = (image, 0.004, PIVOT)
    _, analytic = factors.direct(vector, ROTATION, CENTER, INTRINSICS, sun, 1.1, 0.01, position, normal, 0.35, *rest)

    def moved(x):
        rotation, center = orbit(x[6:12])
        return factors.direct(
            vector, rotation, center, INTRINSICS, sphere_step(sun, x[12:14]), 1.1 + x[14], 0.01 + x[15],
            position + x[:3], sphere_step(normal, x[3:5]), 0.35 + x[5], *rest,
        )[0]  # fmt: skip

    steps = np.r_[[0.1] * 3, [1e-5] * 2, 1e-3, [1e-6] * 3, [0.1] * 3, [1e-5] * 2, 1e-3, 1e-4]
    numeric = numerical_jacobian(moved, 16, steps)[0]
    np.testing.assert_allclose(analytic, numeric, rtol=1e-4, atol=1e-6 * abs(numeric).max())
    still = factors.photometric(vector, CENTER, sun, 1.1, 0.01, position, normal, 0.35, 0.2, 0.004, PIVOT)
    assert np.linalg.norm(analytic[:3]) > 10 * np.linalg.norm(still[1][:3])


@pytest.mark.parametrize("disk", MODELS)
def test_photometric_factor_is_finite_at_zero_phase_and_flat_in_shadow(disk):
    vector = starting_model(disk, "vesta").parameter_vector
    to_camera = unit(CENTER - POSITION)
    residual, jacobian = factors.photometric(
        vector, CENTER, to_camera, 1.0, 0.0, POSITION, unit(to_camera + [0.1, 0, 0]), 0.3, 0.2, 0.01, PIVOT
    )
    assert np.isfinite(residual)
    assert np.all(np.isfinite(jacobian))
    below = factors.photometric(
        vector, CENTER, np.array([1.0, 0, 0]), 1.0, 0.0, POSITION, unit(np.array([-0.1, 0, 1])), 0.3, 0.0, 0.01, PIVOT
    )
    assert below[0] == 0.0
    np.testing.assert_array_equal(below[1][:15], 0.0)


def test_sun_jacobian_and_zero_at_the_measurement():
    sun = unit(np.array([0.3, -0.5, 0.8]))
    measured = ROTATION.T @ sun
    residual, jacobian = factors.sun_direction(ROTATION, sun, measured, 1e-3)
    np.testing.assert_allclose(residual, 0.0, atol=1e-10)
    numeric = numerical_jacobian(
        lambda x: factors.sun_direction(so3_exp(x[:3]) @ ROTATION, sphere_step(sun, x[3:]), measured, 1e-3)[0], 5, 1e-4
    )
    np.testing.assert_allclose(jacobian, numeric, rtol=1e-6, atol=1e-6 * abs(numeric).max())


@pytest.mark.parametrize("height", [0.0, 0.2, 5.0], ids=["flat", "typical", "spike"])
def test_smoothness_jacobian(height):
    position, neighbour = np.zeros(3), np.array([1.0, 0.3, height])
    normal = unit(np.array([0.1, -0.2, 1.0]))
    _, analytic = factors.smoothness(position, normal, neighbour, 0.2)
    numeric = numerical_jacobian(
        lambda x: factors.smoothness(position + x[:3], sphere_step(normal, x[3:5]), neighbour + x[5:], 0.2)[0], 8, 1e-4
    )[0]
    np.testing.assert_allclose(analytic, numeric, rtol=1e-6, atol=1e-8)
