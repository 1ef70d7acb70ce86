"""Cholesky factors against NumPy's."""

import numpy as np
import pytest

from photoclinometry.model.cholesky import factorize, invert, solve_lower


@pytest.fixture
def matrix():
    half = np.random.default_rng(1).normal(size=(7, 9))
    return half @ half.T


def test_the_factor_takes_the_lower_triangle_and_leaves_the_upper_one(matrix):
    factor = matrix.copy()
    factorize(factor)
    np.testing.assert_allclose(np.tril(factor), np.linalg.cholesky(matrix), rtol=1e-12)
    np.testing.assert_array_equal(np.triu(factor, 1), np.triu(matrix, 1))


def test_the_inverse_is_that_of_the_matrix(matrix):
    inverse = matrix.copy()
    factorize(inverse)
    invert(inverse)
    np.testing.assert_allclose(np.tril(inverse), np.tril(np.linalg.inv(matrix)), rtol=1e-9)


def test_solutions_are_of_the_lower_triangle_alone(matrix):
    right = np.random.default_rng(2).normal(size=(7, 3))
    found = right.copy()
    solve_lower(matrix, found)
    np.testing.assert_allclose(np.tril(matrix) @ found, right, rtol=1e-10)


def test_what_is_not_positive_definite_has_no_factor(matrix):
    with pytest.raises(np.linalg.LinAlgError, match="7 rows"):
        factorize(matrix - 2.0 * np.trace(matrix) * np.eye(7))


@pytest.mark.parametrize(
    "spoilt",
    [lambda a: a.T, lambda a: a.astype(np.float32), lambda a: a[:, :6], lambda a: a[::2, ::2]],
    ids=["Fortran's order", "float32", "not square", "not contiguous"],
)
def test_other_arrays_than_pointers_can_tell_are_refused(matrix, spoilt):
    with pytest.raises(ValueError, match="contiguous"):
        factorize(spoilt(matrix))
