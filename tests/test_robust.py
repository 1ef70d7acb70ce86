"""Robust statistics: known answers for normal samples and for outliers."""

import numpy as np

from photoclinometry.model.robust import huber_weight, robust_sigma


def test_the_robust_sigma_of_a_normal_sample_is_its_standard_deviation():
    sample = np.random.default_rng(0).normal(scale=0.3, size=100_000)
    np.testing.assert_allclose(robust_sigma(sample), 0.3, rtol=0.01)


def test_a_third_of_gross_errors_moves_the_robust_sigma_to_less_than_twice():
    sample = np.random.default_rng(0).normal(size=9000)
    sample[::3] = 1e6
    assert robust_sigma(sample) < 2.0


def test_huber_weights_of_residuals_of_either_sign_are_alike():
    residual = np.array([-10.0, -2.0, 0.0, 2.0, 10.0])
    np.testing.assert_allclose(huber_weight(residual), [0.3, 1.0, 1.0, 1.0, 0.3])


def test_huber_weights_are_one_inside_the_limit_and_its_share_outside():
    np.testing.assert_allclose(huber_weight(np.array([0.0, 3.0, 6.0]), 3.0), [1.0, 1.0, 0.5])
