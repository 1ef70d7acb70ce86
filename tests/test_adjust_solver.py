"""The minimum found, against an independent dense solver and against the truth that was simulated."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from photoclinometry.adjust import factors
from photoclinometry.adjust.smoothing import add_product, solve_approximately
from photoclinometry.adjust.solver import SolverOptions, minimize
from photoclinometry.adjust.variables import Estimate
from photoclinometry.model.errors import NotConvergedError
from photoclinometry.model.geometry import so3_log
from scenes import synthetic_scene
from test_adjust_factors import dense_jacobian, observation_factors, perturbed, problem_of, some_tracks_missing

TIGHT = SolverOptions(
    relative_decrease=1e-13,
    absolute_decrease=0,
    truncation=1e-10,
    final_truncation=1e-12,
    max_steps=100,
    max_cg_iterations=2000,
)


def residuals_of(scene, problem, index, present):
    """All whitened residuals as a function of an estimate, from the factors in plain NumPy."""
    priors = problem.priors

    def residuals(estimate):
        views, points = estimate.views, estimate.landmarks
        out = []
        for _, _, (by_keypoint, *_), (by_brightness, _) in observation_factors(scene, estimate):
            out.extend([*by_keypoint, by_brightness])
        for j, m in zip(*np.nonzero(present), strict=True):
            out.append(factors.smoothness(points.position[j], points.normal[j], points.position[index[j, m]], 0.2)[0])
        for k in range(len(views)):
            out.extend(
                factors.sun_direction(
                    views.body_from_cam.rotation[k], views.sun[k], views.sun_measured[k], views.sun_sigma[k]
                )[0]
            )
        start = priors.views
        turn = so3_log(views.body_from_cam.rotation @ np.swapaxes(start.body_from_cam.rotation, 1, 2))
        move = views.body_from_cam.translation - start.body_from_cam.translation
        out.extend((turn / priors.pose_rotation[:, None]).ravel())
        out.extend((move / priors.pose_translation[:, None]).ravel())
        out.extend((views.scale - start.scale) / priors.scale)
        out.extend((views.bias - start.bias) / priors.bias)
        middle = len(points) // 2
        out.extend((points.position - priors.landmarks.position)[middle] / priors.position[middle])
        return np.array(out)

    return residuals


def test_minimum_equals_that_of_an_independent_dense_solver():
    """SciPy's trust-region solver on the factors, its derivatives by differences: same cost to 1e-8."""
    scene = some_tracks_missing(synthetic_scene(size=3, views=4, keypoint_noise_px=0.3, brightness_noise=0.01))
    problem, _, index, present = problem_of(scene)
    start = perturbed(scene, size=0.2)
    ours = minimize(problem, start, TIGHT)
    assert ours.converged
    residuals = residuals_of(scene, problem, index, present)
    assert sum(ours.cost.values()) == pytest.approx(np.sum(residuals(ours.estimate) ** 2), rel=1e-7)
    # local coordinates about our start, scaled to a sigma each
    jacobian = dense_jacobian(scene, start)
    size = 1.0 / np.sqrt(np.sum(jacobian**2, 0) + 1e-6)
    views = len(scene.views)

    def moved(x):
        x = x * size
        return residuals(start.step(x[: 10 * views].reshape(views, 10), x[10 * views :].reshape(-1, 6)))

    theirs = least_squares(moved, np.zeros(len(size)), method="trf", xtol=1e-15, ftol=1e-10, gtol=1e-12)
    assert np.sum(residuals(ours.estimate) ** 2) == pytest.approx(2 * theirs.cost, rel=1e-8)


def test_noise_free_measurements_are_explained_exactly():
    """From a wrong start to zero keypoint and brightness residuals, smoothness apart."""
    scene = synthetic_scene(size=12, views=6)
    problem, *_ = problem_of(scene)
    problem.smooth_sigma = 1e9
    solution = minimize(problem, perturbed(scene, size=0.5), TIGHT, step_limit=30.0)
    assert sum(solution.cost.values()) < 1e-6
    np.testing.assert_allclose(solution.estimate.landmarks.albedo, scene.landmarks.albedo, rtol=1e-4)
    np.testing.assert_allclose(solution.estimate.landmarks.normal, scene.landmarks.normal, atol=1e-4)


def test_not_converging_is_a_status_and_raises_on_request():
    scene = synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01)
    problem, *_ = problem_of(scene)
    once = SolverOptions(max_steps=1)
    assert not minimize(problem, perturbed(scene), once).converged
    with pytest.raises(NotConvergedError, match="1 steps"):
        minimize(problem, perturbed(scene), once, throw=True)


def test_what_progress_raises_ends_the_solve():
    scene = synthetic_scene(size=6, views=4)
    problem, *_ = problem_of(scene)

    def cancel(iteration):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        minimize(problem, perturbed(scene), progress=cancel)


def test_chebyshev_polynomial_approaches_the_inverse():
    """At a high degree the landmarks' preconditioner is the dense solution of their coupled system."""
    scene = synthetic_scene(size=6, views=5, keypoint_noise_px=0.3, brightness_noise=0.01)
    problem, *_ = problem_of(scene)
    _, equations = problem.linearize(Estimate(scene.views, scene.landmarks, scene.landmarks.position.mean(0)))
    block, rows = equations.landmark_block.astype(np.float32), equations.smooth_rows
    count = 6 * len(block)
    dense = np.empty((count, count))
    for i, axis in enumerate(np.eye(count, dtype=np.float32)):
        out = np.zeros((len(block), 6), np.float32)
        add_product(problem.neighbours, rows, block, axis.reshape(-1, 6), out)
        dense[:, i] = out.ravel()
    size = np.sqrt(np.diag(dense))
    np.testing.assert_allclose(dense / np.outer(size, size), (dense / np.outer(size, size)).T, atol=1e-5)
    b = np.random.default_rng(0).normal(size=count) * size
    inverse = np.linalg.inv(equations.landmark_block).astype(np.float32)
    x = solve_approximately(
        problem.neighbours, rows, inverse, b.reshape(-1, 6).astype(np.float32), degree=300, low=1e-3
    )
    expected = np.linalg.solve(dense, b) * size
    np.testing.assert_allclose(x.ravel() * size, expected, atol=2e-3 * abs(expected).max())
