"""Errors of the approximations in the covariances of a large map, against exact ones by sparse factorisation.

    python benchmarks/uncertainty.py [side] [views]

On matched problems, linearized at the truth: errors independent, and shared by neighbours as in real runs (keypoints by
24 x 24 landmarks, brightness by 6 x 6). Printed: sigma as approximated over the exact one, in the map's own frame, mean
and extremes over all views, and over a hundred landmarks.
"""

from __future__ import annotations

import time

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from matched import matched_problem
from photoclinometry.adjust import AdjustOptions
from photoclinometry.adjust.covariance.linearized_graph import (
    LinearizedGraph,
    landmark_moves,
    linearized_graph,
    loosely_held,
    view_moves,
)
from photoclinometry.adjust.covariance.marginals import marginals
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.layout import morton_order
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.groups import factor_groups, setup_of, smoothness_group
from photoclinometry.adjust.noise import Noise
from photoclinometry.adjust.tie_points import with_tie_points
from photoclinometry.model.scene import Scene

BRIGHTNESS_SIGMA = 0.0015
VIEW_KINDS = {
    "rotation": slice(0, 3),
    "shift": slice(3, 6),
    "Sun": slice(6, 8),
    "scale": slice(8, 9),
    "bias": slice(9, 10),
}
LANDMARK_KINDS = {"position": slice(0, 3), "normal": slice(3, 5), "albedo": slice(5, 6)}


def graph_of(scene: Scene, keypoint_px: float = 1.0, brightness_px: float = 1.0) -> FactorGraph:
    """The graph that `adjust` minimises for a matched scene, least squares, errors shared by squares of these sides."""
    options = AdjustOptions(keypoint_loss=np.inf, brightness_loss=np.inf, reflectance_sigma=0.0)
    noise = Noise(
        keypoint_factor=1.0,
        keypoint_correlation_px=keypoint_px,
        pose_only_keypoint_factor=1.0,
        sparse_keypoint_factor=1.0,
        brightness_sigma=BRIGHTNESS_SIGMA,
        brightness_correlation_px=brightness_px,
    )
    scene, _, members = with_tie_points(scene, None)
    setup = setup_of(scene, members, options)
    smoothness = smoothness_group(setup, scene.landmarks, noise)
    return FactorGraph(factor_groups(setup, np.ones(len(scene.tracks), bool), noise, smoothness))


def at_truth(side: int, views: int, keypoint_px: float, brightness_px: float) -> LinearizedGraph:
    """A matched problem in the solver's order, its gauge loose as in `estimate_uncertainty`."""
    _, truth = matched_problem(side, views)
    order = morton_order(truth.landmarks.pixel)
    tracks, _ = truth.tracks.of_landmarks(order)
    scene = Scene(**{**vars(truth), "landmarks": truth.landmarks[order], "tracks": tracks})
    start = Estimate(scene.views, scene.landmarks, np.median(scene.landmarks.position, axis=0))
    return loosely_held(linearized_graph(graph_of(scene, keypoint_px, brightness_px), start))


def exact(at: LinearizedGraph, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variances of all views (K, 10) and of chosen landmarks (n, 6), in the map's own frame."""
    count, views, links = len(at), len(at.cameras.scale), at.links
    patch = at.patch(0, count)
    pairs = np.arange(len(links.source))
    columns = np.hstack([6 * links.source[:, None] + np.arange(5), 6 * links.target[:, None] + np.arange(3)])
    values = np.hstack([-links.rows[:, :3], links.rows[:, 3:], links.rows[:, :3]])
    rows = sparse.csr_matrix((values.ravel(), (np.repeat(pairs, 8), columns.ravel())), shape=(len(pairs), 6 * count))
    blocks = sparse.bsr_matrix((patch.own.sum(1) + at.prior, np.arange(count), np.arange(count + 1)))
    information = (blocks.tocsc() + rows.T @ rows).tocsc()
    factor = splu(information, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    coupling = patch.coupling.reshape(6 * count, -1)
    response = factor.solve(coupling)
    total = at.common_prior.reshape(views, 10, views, 10).copy()
    total[range(views), :, range(views), :] += patch.view_block
    camera = np.linalg.inv(total.reshape(10 * views, -1) - coupling.T @ response)
    move = landmark_moves(at, 0, count)
    fit = move[:, :3].reshape(-1, 7)
    by_position = response.reshape(count, 6, -1)[:, :3].reshape(3 * count, -1)
    frame = -np.linalg.solve(fit.T @ fit, fit.T @ by_position)
    kept = np.eye(len(camera)) + view_moves(at) @ -frame
    found = np.empty((len(chosen), 6))
    for n, j in enumerate(chosen):
        own = factor.solve(np.eye(6 * count, 6, -6 * int(j)))[6 * j : 6 * j + 6]
        moved = response[6 * j : 6 * j + 6] + move[j] @ frame
        found[n] = np.diag(own + moved @ camera @ moved.T)
    return np.diag(kept @ camera @ kept.T).reshape(views, 10), found


def main(side: int = 64, views: int = 12) -> None:
    chosen = np.random.default_rng(0).choice(side * side, 100, replace=False)
    for keypoint_px, brightness_px in ((1.0, 1.0), (24.0, 6.0)):
        at = at_truth(side, views, keypoint_px, brightness_px)
        by_view, by_landmark = exact(at, chosen)
        begin = time.process_time()
        found = marginals(at, frame=np.ones(len(at), bool), exact=0)
        spent = time.process_time() - begin
        print(f"{side} x {side} landmarks, {views} views, errors shared by {keypoint_px:g} and {brightness_px:g} px")
        ratios = {
            "views": (np.sqrt(np.diag(found.views).reshape(views, 10) / by_view), VIEW_KINDS),
            "landmarks": (np.sqrt(np.einsum("jaa->ja", found.landmark[chosen]) / by_landmark), LANDMARK_KINDS),
        }
        for ratio, kinds in ratios.values():
            for kind, place in kinds.items():
                part = ratio[:, place]
                print(f"  {kind:10} {part.mean():.3f}  ({part.min():.3f} to {part.max():.3f})")
        print(f"  {spent:.1f} CPU s")


if __name__ == "__main__":
    import sys

    main(*map(int, sys.argv[1:]))
