"""The covariance of a small map by a dense inverse, and the linearized graph that is to have the same."""

from dataclasses import replace

import numpy as np

from graphs import BRIGHTNESS_SIGMA, KEYPOINT_SIGMA, graph_of, residuals_of
from jacobians import numerical_jacobian
from photoclinometry.adjust.covariance.linearized_graph import linearized_graph
from photoclinometry.adjust.graph.variables import Estimate

PIVOT = np.array([10.0, -20.0, 5.0])


def linearized_at_truth(scene, factor=1.0, links=True):
    """The scene linearized where it is, with the sigmas of `graph_of` times `factor`, and what it was built of."""
    built = graph_of(scene, keypoint_sigma=KEYPOINT_SIGMA * factor, brightness_sigma=BRIGHTNESS_SIGMA * factor)
    at = linearized_graph(built.graph, Estimate(scene.views, scene.landmarks, PIVOT))
    if not links:
        none = np.zeros(0, np.int64)
        start = np.zeros(len(scene.landmarks) + 1, np.int64)
        at = replace(at, links=at.links._replace(
            start=start, target=none, source=none, incoming_start=start, incoming=none, rows=np.zeros((0, 5))
        ))  # fmt: skip
    return at, built


def dense_covariance(scene, built, extra=()):
    """Inverse of J^T J, J by differences of the residuals in plain NumPy, and the number of the views' coordinates."""
    jacobian, views = jacobian_by_differences(scene, built)
    return covariance_of(np.vstack([jacobian, *extra])), views


def covariance_of(jacobian):
    """Inverse of J^T J, coordinates scaled to ones on its diagonal."""
    information = jacobian.T @ jacobian
    scale = np.sqrt(np.diag(information))
    return np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)


def jacobian_by_differences(scene, built):
    """J of views and landmarks by differences of the residuals, and the number of the views' coordinates."""
    estimate = Estimate(scene.views, scene.landmarks, PIVOT)
    residuals = residuals_of(scene, built)
    views = 10 * len(scene.views)
    size = views + 6 * len(scene.landmarks)
    steps = np.r_[np.tile([1e-6] * 3 + [1e-1] * 3 + [1e-4] * 4, len(scene.views)),
                  np.tile([0.1] * 3 + [1e-4] * 3, len(scene.landmarks))]  # fmt: skip

    def moved(x):
        return residuals(estimate.step(x[:views].reshape(-1, 10), x[views:].reshape(-1, 6)))

    return numerical_jacobian(moved, size, steps), views
