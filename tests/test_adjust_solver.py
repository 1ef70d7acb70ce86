"""The minimum found, against an independent dense solver and against the truth that was simulated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from graphs import dense_jacobian, graph_of, perturbed, residuals_of, some_tracks_missing
from photoclinometry.adjust.graph.smoothness import add_product
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.solve.damped import DampedSystem
from photoclinometry.adjust.solve.krylov import conjugate_gradients
from photoclinometry.adjust.solve.preconditioner import solve_approximately
from photoclinometry.adjust.solve.solver import SolverOptions, minimize
from photoclinometry.adjust.solve.step_control import descend
from photoclinometry.model.errors import InputError
from photoclinometry.model.reflectance import published
from scenes import synthetic_scene

TIGHT = SolverOptions(
    relative_decrease=1e-13,
    absolute_decrease=0,
    settled=0,
    truncation=1e-10,
    final_truncation=1e-12,
    max_steps=100,
    max_cg_iterations=2000,
)


def test_minimum_equals_that_of_an_independent_dense_solver():
    """SciPy's trust-region solver on the factors, its derivatives by differences: same cost to 1e-8."""
    scene = some_tracks_missing(synthetic_scene(size=3, views=4, keypoint_noise_px=0.3, brightness_noise=0.01))
    built = graph_of(scene)
    start = perturbed(scene, size=0.2)
    ours = minimize(built.graph, start, TIGHT)
    assert ours.converged
    residuals = residuals_of(scene, built)
    assert sum(ours.cost.values()) == pytest.approx(np.sum(residuals(ours.estimate) ** 2), rel=1e-7)
    # local coordinates about our start, scaled to a sigma each
    jacobian = dense_jacobian(scene, start)
    size = 1.0 / np.sqrt(np.sum(jacobian**2, 0) + 1e-6)
    views = len(scene.views)

    def moved(x):
        x = x * size
        return residuals(start.step(x[: 10 * views].reshape(views, 10), x[10 * views :].reshape(-1, 6)))

    theirs = least_squares(moved, np.zeros(len(size)), "3-point", xtol=1e-15, ftol=1e-10, gtol=1e-12)
    assert np.sum(residuals(ours.estimate) ** 2) == pytest.approx(2 * theirs.cost, rel=1e-8)


def test_noise_free_measurements_are_explained_exactly():
    """From a wrong start to zero keypoint and brightness residuals, smoothness apart."""
    scene = synthetic_scene(size=12, views=6)
    solution = minimize(graph_of(scene, smooth_sigma=1e9).graph, perturbed(scene, size=0.5), TIGHT, step_limit=30.0)
    assert sum(solution.cost.values()) < 1e-6
    np.testing.assert_allclose(solution.estimate.landmarks.albedo, scene.landmarks.albedo, rtol=1e-4)
    np.testing.assert_allclose(solution.estimate.landmarks.normal, scene.landmarks.normal, atol=1e-4)


def test_not_converging_is_a_status():
    scene = synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01)
    solution = minimize(graph_of(scene).graph, perturbed(scene), SolverOptions(max_steps=1))
    assert not solution.converged
    assert "1 steps" in solution.message


@pytest.mark.parametrize("model", ["mcewen", "lunar-lambert"])
def test_a_start_without_a_finite_cost_is_refused_with_the_group(model):
    """It used to end as converged, since no step lowers what is no number."""
    scene = synthetic_scene(size=6, views=4)
    brightness = scene.tracks.brightness.copy()
    brightness[np.flatnonzero(scene.tracks.lit)[0]] = np.nan
    scene = replace(scene, tracks=replace(scene.tracks, brightness=brightness), reflectance=published(model, "vesta"))
    with pytest.raises(InputError, match="residuals of brightness are no numbers"):
        minimize(graph_of(scene).graph, perturbed(scene, size=0.0))


def test_what_on_step_raises_ends_the_solve():
    scene = synthetic_scene(size=6, views=4)
    graph = graph_of(scene).graph

    def cancel(iteration):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        minimize(graph, perturbed(scene), on_step=cancel)


def test_chebyshev_polynomial_approaches_the_inverse():
    """At a high degree the landmarks' preconditioner is the dense solution of their coupled system."""
    scene = synthetic_scene(size=6, views=5, keypoint_noise_px=0.3, brightness_noise=0.01)
    graph = graph_of(scene).graph
    at = graph.linearize(Estimate(scene.views, scene.landmarks, scene.landmarks.position.mean(0)))
    block, rows = at.landmarks.block.astype(np.float32), at.smooth.rows
    count = 6 * len(block)
    dense = np.empty((count, count))
    for i, axis in enumerate(np.eye(count, dtype=np.float32)):
        out = np.zeros((len(block), 6), np.float32)
        add_product(at.neighbours, rows, block, axis.reshape(-1, 6), out)
        dense[:, i] = out.ravel()
    size = np.sqrt(np.diag(dense))
    np.testing.assert_allclose(dense / np.outer(size, size), (dense / np.outer(size, size)).T, atol=1e-5)
    b = np.random.default_rng(0).normal(size=count) * size
    inverse = np.linalg.inv(at.landmarks.block).astype(np.float32)
    x = solve_approximately(at.neighbours, rows, inverse, b.reshape(-1, 6).astype(np.float32), degree=300, low=1e-3)
    expected = np.linalg.solve(dense, b) * size
    np.testing.assert_allclose(x.ravel() * size, expected, atol=2e-3 * abs(expected).max())


def test_the_gain_ratio_of_a_quadratic_cost_is_one():
    """Near the minimum, where the linear model holds, what a step promised is what it brought: both of one
    linearization, of where the step began."""
    scene = synthetic_scene(size=6, views=5, keypoint_noise_px=0.3, brightness_noise=0.01)
    graph = graph_of(scene).graph
    solution = minimize(graph, perturbed(scene, size=0.2), TIGHT)
    near = solution.estimate.step(
        1e-7 * np.ones((5, 10)), 1e-4 * np.random.default_rng(0).normal(size=(36, 6)) * np.r_[[100.0] * 3, [1.0] * 3]
    )
    at = graph.linearize(near)
    trial = descend(graph, near, at.cost.sum(), at.split(minus_newton(at)), np.inf)
    assert trial.whole
    assert (at.cost.sum() - trial.cost.sum()) / at.decrease(trial.moves) == pytest.approx(1.0, abs=0.01)
    # with the rows of where the step ended it would not be: nothing is left to gain there
    assert graph.linearize(trial.estimate).decrease(trial.moves) < 0.5 * at.decrease(trial.moves)


def scaled_matrix(at):
    """Scales (n,) that make the diagonal of H one, and the dense matrix (n, n) so scaled."""
    scale = (1.0 / np.sqrt(at.diagonal)).astype(np.float32)
    return scale, np.array([at.multiply(axis * scale) * scale for axis in np.eye(len(scale), dtype=np.float32)])


def minus_newton(at):
    """The step to the minimum of the linear model, by a dense solution."""
    scale, dense = scaled_matrix(at)
    return -scale * np.linalg.solve(dense, scale * at.gradient)


def test_a_landmark_damped_alone_hardly_moves_and_the_others_find_their_minimum_about_it():
    """Against a dense solution in which that landmark is held."""
    scene = synthetic_scene(size=6, views=5, keypoint_noise_px=0.3, brightness_noise=0.01)
    at = graph_of(scene).graph.linearize(perturbed(scene, size=0.2))
    of_landmarks = np.zeros(36)
    of_landmarks[20] = 1e6
    system = DampedSystem(at, 1e-6, of_landmarks, 0.02, 10)
    solve = conjugate_gradients(
        system.multiply, system.precondition, -at.gradient.astype(np.float32), max_iterations=500, truncation=1e-8
    )
    scale, dense = scaled_matrix(at)
    free = np.ones(len(scale), bool)
    free[50 + 6 * 20 : 50 + 6 * 21] = False
    expected = np.zeros(len(scale))
    damped = dense[np.ix_(free, free)] + 1e-6 * np.eye(free.sum())
    expected[free] = -np.linalg.solve(damped, (scale * at.gradient)[free])
    found = solve.x / scale
    assert np.abs(found[~free]).max() < 1e-4 * np.abs(found).max()
    np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())


def test_an_estimate_that_counts_as_settled_is_near_the_minimum():
    """Nine landmarks of ten are within their own standard deviation of where they end, and it takes fewer steps."""
    scene = synthetic_scene(size=12, views=6, keypoint_noise_px=0.3, brightness_noise=0.01)
    graph, start = graph_of(scene).graph, perturbed(scene, size=0.5)
    settled, exact = (minimize(graph, start, replace(TIGHT, settled=share), step_limit=30.0) for share in (0.5, 0.0))
    assert settled.converged
    assert settled.message == "converged: landmarks no longer move"
    assert exact.message == "converged: the cost no longer falls"
    assert len(settled.log) < len(exact.log)
    position, end = (solution.estimate.landmarks.position for solution in (settled, exact))
    sigma = 1.0 / np.sqrt(np.einsum("jii->ji", graph.linearize(exact.estimate).landmarks.block)[:, :3])
    off = np.sqrt(np.mean(((position - end) / sigma) ** 2, axis=1))
    assert np.quantile(off, 0.9) < 1.0
