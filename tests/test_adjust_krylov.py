"""Conjugate gradients against a direct solve."""

import numpy as np
import pytest

from photoclinometry.adjust.solve.krylov import conjugate_gradients


@pytest.fixture
def system():
    """H (200, 200) with eigenvalues of 0.5 to 1.5 but for five of 0.01 and less, and a right-hand side."""
    rng = np.random.default_rng(0)
    basis = np.linalg.qr(rng.normal(size=(200, 200)))[0]
    eigenvalues = np.r_[np.geomspace(1e-4, 1e-2, 5), rng.uniform(0.5, 1.5, 195)]
    return (basis * eigenvalues) @ basis.T, rng.normal(size=200)


def solve(system, **options):
    h, b = system
    scale = np.linspace(0.5, 2.0, 200)
    return conjugate_gradients(lambda x: h @ x, lambda r: r / scale, b, max_iterations=500, **options)


def test_conjugate_gradients_equal_a_direct_solve(system):
    direct = np.linalg.solve(*system)
    np.testing.assert_allclose(solve(system, truncation=1e-12).x, direct, rtol=1e-5, atol=1e-5 * np.abs(direct).max())


def test_ritz_values_end_at_the_eigenvalues_of_the_preconditioned_matrix(system):
    inverse_root = np.diag(np.linspace(0.5, 2.0, 200) ** -0.5)
    eigenvalues = np.linalg.eigvalsh(inverse_root @ system[0] @ inverse_root)
    ritz = solve(system, truncation=1e-12).ritz_values()
    assert ritz[0] == pytest.approx(eigenvalues[0], rel=1e-6)
    assert ritz[-1] == pytest.approx(eigenvalues[-1], rel=1e-6)


def test_iterations_end_where_little_is_left_to_gain(system):
    """What the solution still lacks of x^T H x - 2 b^T x is of the size asked for."""
    h, b = system
    lowest = -b @ np.linalg.solve(h, b)
    x = solve(system, enough=1.0).x
    assert 0.0 < x @ h @ x - 2.0 * b @ x - lowest < 1.0
    assert not solve(system, enough=1.0).broke_down


def test_an_indefinite_matrix_ends_the_iteration(system):
    """Rounding can make a nearly singular matrix so: what was found until then is finite."""
    h, b = system
    spoilt = h - 2.0 * np.outer(b, b) / np.vdot(b, b)
    found = conjugate_gradients(lambda x: spoilt @ x, lambda r: r, b, max_iterations=500)
    assert found.iterations == 0
    assert found.broke_down
    np.testing.assert_array_equal(found.x, 0.0)
