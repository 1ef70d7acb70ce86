"""Volume, area, centre of mass, inertia and their standard deviations: bodies computed by hand, and Monte Carlo."""

import numpy as np
import pytest

from cubes import CUBE
from photoclinometry.model.geometry import so3_exp, unit
from photoclinometry.surface.closed_mesh import icosahedron, refine, vertex_areas, vertex_normals
from photoclinometry.surface.mass_properties import mass_properties


@pytest.fixture(scope="module")
def egg():
    direction, faces = refine(*icosahedron(), 0.25, unit)
    x, y, z = direction.T
    return (1.0 + 0.25 * x + 0.15 * x * y + 0.1 * z * z)[:, None] * direction, faces


def figures(found):
    return np.r_[found.volume, found.area, found.center, found.inertia.ravel()]


def sigmas(found):
    return np.r_[found.sigma_volume, found.sigma_area, found.sigma_center, found.sigma_inertia.ravel()]


def test_a_box_by_hand():
    """Sides 2, 4, 6 about (10, 20, 30): inertia over mass (16 + 36, 4 + 36, 4 + 16) / 12."""
    found = mass_properties(CUBE[0] * [1.0, 2.0, 3.0] + [10.0, 20.0, 30.0], CUBE[1])
    assert found.volume == pytest.approx(48.0, rel=1e-12)
    assert found.area == pytest.approx(88.0, rel=1e-12)
    np.testing.assert_allclose(found.center, [10.0, 20.0, 30.0], rtol=1e-12)
    np.testing.assert_allclose(found.inertia, np.diag([52.0, 40.0, 20.0]) / 12.0, atol=1e-12)
    assert np.isnan(found.sigma_volume)


def test_a_turned_box_has_the_turned_tensor():
    turn = so3_exp(np.array([0.3, -0.5, 0.2]))
    plain = mass_properties(CUBE[0] * [1.0, 2.0, 3.0], CUBE[1])
    turned = mass_properties(CUBE[0] * [1.0, 2.0, 3.0] @ turn.T, CUBE[1])
    np.testing.assert_allclose(turned.inertia, turn @ plain.inertia @ turn.T, atol=1e-12)


def test_a_tetrahedron_by_hand():
    """Corners 0, x, y, z: volume 1/6, centre 1/4, second moments 1/10 - 1/16 and -1/80."""
    vertices = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    found = mass_properties(vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    assert found.volume == pytest.approx(1.0 / 6.0)
    np.testing.assert_allclose(found.center, 0.25)
    second = np.full((3, 3), 1.0 / 20.0 - 1.0 / 16.0) + np.eye(3) / 20.0
    np.testing.assert_allclose(found.inertia, np.trace(second) * np.eye(3) - second, atol=1e-12)


def test_a_sphere_with_one_common_error_by_hand():
    """All heights off together by 1 %: volume by 3 %, area by 2 %, inertia by 2 %, the centre not at all."""
    vertices, faces = refine(*icosahedron(), 0.1, unit)
    found = mass_properties(
        vertices, faces, normals=vertices, sigma_height=np.full(len(vertices), 0.01), correlation_length=np.inf
    )
    assert found.sigma_volume / found.volume == pytest.approx(0.03, rel=1e-9)
    assert found.sigma_area / found.area == pytest.approx(0.02, rel=1e-9)
    np.testing.assert_allclose(np.diag(found.sigma_inertia) / np.diag(found.inertia), 0.02, rtol=1e-9)
    np.testing.assert_allclose(found.sigma_center, 0.0, atol=1e-5)


def test_independent_errors_on_a_sphere_by_hand():
    """The volume's standard deviation is that of a sum of areas times heights."""
    vertices, faces = refine(*icosahedron(), 0.1, unit)
    found = mass_properties(vertices, faces, sigma_height=np.full(len(vertices), 0.01))
    assert found.sigma_volume == pytest.approx(0.01 * np.sqrt((vertex_areas(vertices, faces) ** 2).sum()), rel=0.01)


@pytest.mark.parametrize("length", [0.0, 0.1, 0.5, 3.0, np.inf])
def test_standard_deviations_are_those_of_monte_carlo(egg, length):
    """1,500 draws of correlated heights: standard deviations are known to 1.8 %."""
    vertices, faces = egg
    normals, rng = vertex_normals(vertices, faces), np.random.default_rng(1)
    sigma = 1e-4 * (1.0 + 0.5 * vertices[:, 0])
    square = ((vertices[:, None] - vertices) ** 2).sum(-1)
    correlation = np.eye(len(vertices)) if length == 0.0 else np.exp(-0.5 * square / length**2)
    root = np.linalg.cholesky(correlation + 1e-9 * np.eye(len(vertices)))
    draws = []
    for _ in range(1500):
        height = sigma * (root @ rng.normal(size=len(vertices)))
        draws.append(figures(mass_properties(vertices + height[:, None] * normals, faces, normals=normals)))
    found = mass_properties(vertices, faces, sigma_height=sigma, correlation_length=length)
    np.testing.assert_allclose(sigmas(found), np.std(draws, axis=0), rtol=0.06, atol=1e-8)


def test_unknown_heights_count_as_the_worst_known(egg):
    vertices, faces = egg
    sigma = np.full(len(vertices), 0.01)
    sigma[: len(sigma) // 2] = np.nan
    found = mass_properties(vertices, faces, sigma_height=sigma, correlation_length=0.3)
    whole = mass_properties(vertices, faces, sigma_height=np.full(len(vertices), 0.01), correlation_length=0.3)
    np.testing.assert_allclose(sigmas(found), sigmas(whole))


def test_one_vertex_does_not_tell_how_badly_unknown_heights_are_known(egg):
    vertices, faces = egg
    sigma = np.full(len(vertices), 0.01)
    whole = mass_properties(vertices, faces, sigma_height=sigma, correlation_length=0.3)
    sigma[: len(sigma) // 2] = np.nan
    sigma[-1] = 0.1
    found = mass_properties(vertices, faces, sigma_height=sigma, correlation_length=0.3)
    np.testing.assert_allclose(found.sigma_volume, whole.sigma_volume, rtol=0.3)


def test_the_unit_of_length_does_not_matter(egg):
    vertices, faces = egg
    sigma = np.full(len(vertices), 0.01)
    small = mass_properties(vertices, faces, sigma_height=sigma, correlation_length=0.2)
    large = mass_properties(1e3 * vertices + 5e3, faces, sigma_height=1e3 * sigma, correlation_length=200.0)
    np.testing.assert_allclose(large.sigma_volume, 1e9 * small.sigma_volume, rtol=0.02)
    np.testing.assert_allclose(large.sigma_center, 1e3 * small.sigma_center, rtol=0.02)
    np.testing.assert_allclose(large.inertia, 1e6 * small.inertia, rtol=1e-6, atol=1.0)
