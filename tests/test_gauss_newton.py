"""Gauss-Newton: exact in one step on a linear problem, the minimum of a curved one, bounded steps, an honest status."""

import numpy as np
import pytest

from photoclinometry.model.gauss_newton import gauss_newton
from photoclinometry.model.robust import huber_weight


def linear_fit(jacobian, data):
    def linearize(x):
        return jacobian.T @ (jacobian @ x - data), jacobian.T @ jacobian

    return linearize


def add(x, step):
    return x + step


def test_a_linear_problem_is_solved_by_one_step():
    rng = np.random.default_rng(0)
    jacobian, true = rng.normal(size=(20, 3)), np.array([1.0, -2.0, 3.0])
    found = gauss_newton(np.zeros(3), linear_fit(jacobian, jacobian @ true), add, iterations=2)
    np.testing.assert_allclose(found.state, true, atol=1e-12)
    np.testing.assert_array_equal(found.information, jacobian.T @ jacobian)
    assert found.converged


def test_a_decay_rate_is_recovered():
    t = np.linspace(0.0, 2.0, 30)
    data = 3.0 * np.exp(-1.7 * t)

    def linearize(x):
        model = x[0] * np.exp(-x[1] * t)
        jacobian = np.stack([model / x[0], -t * model], -1)
        return jacobian.T @ (model - data), jacobian.T @ jacobian

    found = gauss_newton(np.array([1.0, 1.0]), linearize, add, iterations=50, longest=0.5)
    np.testing.assert_allclose(found.state, [3.0, 1.7], rtol=1e-8)


def test_huber_weights_make_a_location_robust():
    data = np.concatenate([np.random.default_rng(0).normal(size=90), np.full(10, 100.0)])

    def linearize(x):
        residual = x[0] - data
        weight = huber_weight(np.abs(residual), 1.0)
        return np.array([weight @ residual]), np.array([[weight.sum()]])

    found = gauss_newton(np.zeros(1), linearize, add, iterations=100)
    assert abs(found.state[0]) < 0.3
    assert abs(data.mean()) > 9.0


def test_no_component_of_a_step_is_longer_than_its_limit():
    steps = []

    def move(x, step):
        steps.append(step)
        return x + step

    target = np.array([10.0, 1.0])
    gauss_newton(np.zeros(2), linear_fit(np.eye(2), target), move, iterations=100, longest=np.array([0.5, 1.0]))
    np.testing.assert_allclose(steps[0], [0.5, 0.05])
    np.testing.assert_allclose(np.sum(steps, axis=0), target)


@pytest.mark.parametrize(("iterations", "converged"), [(1, False), (2, True)])
def test_the_status_tells_whether_the_last_step_was_negligible(iterations, converged):
    found = gauss_newton(np.zeros(2), linear_fit(np.eye(2), np.ones(2)), add, iterations=iterations)
    assert found.converged is converged
