import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.simulate.surface import Surface, sphere_drop
from rough_ground import inner_points, rough_surface


def test_surface_passes_through_its_samples_rows_going_north():
    surface = rough_surface()
    row, col = 17, 29
    xy = np.array([-7.0 + 3.0 * col, 11.0 + 3.0 * row])
    assert surface.height_at(xy) == pytest.approx(surface.height[row, col], abs=1e-12)
    assert surface.albedo_at(xy) == pytest.approx(surface.albedo[row, col], abs=1e-12)


def test_a_quadratic_surface_is_reproduced_exactly():
    """Catmull-Rom interpolation is exact for polynomials of degree 2 in each direction."""
    x, y = np.meshgrid(np.arange(30) * 2.0, np.arange(30) * 2.0)

    def height(x, y):
        return 0.02 * x * x - 0.03 * x * y + 0.01 * y * y + 0.5 * x - 4.0

    surface = Surface(height(x, y), np.full(x.shape, 0.3), 2.0, (0.0, 0.0))
    p = inner_points(surface, 200)
    np.testing.assert_allclose(surface.height_at(p), height(*p.T), atol=1e-10)
    slope = np.stack([0.04 * p[:, 0] - 0.03 * p[:, 1] + 0.5, -0.03 * p[:, 0] + 0.02 * p[:, 1]], -1)
    normal = np.concatenate([-slope, np.ones((200, 1))], -1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(surface.normal_at(p), normal, atol=1e-10)


def test_normals_are_the_derivatives_of_the_height():
    surface = rough_surface()
    p, step = inner_points(surface, 300), 1e-5
    normal = surface.normal_at(p)
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        slope = (surface.height_at(p + shift) - surface.height_at(p - shift)) / (2 * step)
        np.testing.assert_allclose(-normal[:, axis] / normal[:, 2], slope, atol=1e-6)


def test_height_and_slope_are_continuous_across_cell_edges():
    surface = rough_surface()
    x = -7.0 + 3.0 * 12
    y = np.linspace(20.0, 90.0, 50)
    left, right = (np.stack([np.full(50, x + d), y], -1) for d in (-1e-9, 1e-9))
    np.testing.assert_allclose(surface.height_at(left), surface.height_at(right), atol=1e-7)
    np.testing.assert_allclose(surface.normal_at(left), surface.normal_at(right), atol=1e-7)


def test_sphere_drop_lies_on_the_sphere():
    x, y = np.random.default_rng(0).uniform(-100.0, 100.0, (2, 50))
    z = sphere_drop(x, y, 300.0)
    np.testing.assert_allclose(x**2 + y**2 + (z + 300.0) ** 2, 300.0**2, rtol=1e-12)
    with pytest.raises(InputError, match="radius"):
        sphere_drop(np.array([290.0]), np.array([0.0]), 300.0)
