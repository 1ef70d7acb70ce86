"""Steps are limited landmark by landmark, but not what the whole map does together."""

import numpy as np

from graphs import graph_of, perturbed
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.solve.solver import minimize
from photoclinometry.adjust.solve.step_control import MAX_TURN, common_motion, descend, limited
from scenes import synthetic_scene


def start():
    scene = synthetic_scene(size=10, views=4)
    return Estimate(scene.views, scene.landmarks, scene.landmarks.position.mean(0))


def affine(position):
    """A shear, a stretch and a shift."""
    return position @ np.array([[0.1, 0.0, 0.3], [0.0, 0.2, -0.2], [0.0, 0.0, 0.4]]) + [3.0, -7.0, 20.0]


def test_common_motion_is_found_among_landmarks_that_leap():
    position = start().landmarks.position
    moves = affine(position)
    rng = np.random.default_rng(0)
    leaping = rng.permutation(len(moves))[:10]
    moves[leaping] += rng.normal(0.0, 1e4, (10, 3))
    found = common_motion(moves, position, 0.01)
    np.testing.assert_allclose(found, affine(position), atol=0.02)


def test_what_the_whole_map_does_is_not_cut_and_a_leap_is():
    estimate = start()
    position = estimate.landmarks.position
    step = np.zeros((len(position), 6))
    step[:, :3] = affine(position)
    step[:, 4], step[7, :3] = 0.1, step[7, :3] + [0.0, 0.0, 500.0]
    moves = limited(step, 2.0, estimate)
    others = np.arange(len(position)) != 7
    np.testing.assert_array_equal(moves[others], step[others])
    assert np.linalg.norm(moves[7, :3] - affine(position)[7]) < 2.5
    assert moves[7, 4] < 0.01


def test_a_landmark_that_stays_while_the_map_moves_is_left_alone():
    estimate = start()
    step = np.zeros((len(estimate.landmarks), 6))
    step[:, :3] = affine(estimate.landmarks.position)
    step[3, :3] = 0.0
    np.testing.assert_array_equal(limited(step, 2.0, estimate)[3], step[3])


def test_normals_turn_and_albedos_fall_by_no_more_than_their_limits():
    estimate = start()
    step = np.zeros((len(estimate.landmarks), 6))
    step[0, 3], step[1, 5], step[2, 5] = 2.0, -5.0, 5.0
    moves = limited(step, 1.0, estimate)
    assert moves[0, 3] == MAX_TURN
    np.testing.assert_allclose(estimate.landmarks.albedo[1] + moves[1, 5], 0.1 * estimate.landmarks.albedo[1])
    assert moves[2, 5] == 5.0


def test_landmarks_have_limits_of_their_own():
    """What the map must not do, an anchor may: ten units where 2 are the others' limit."""
    estimate = start()
    count = len(estimate.landmarks)
    step, limit = np.zeros((count, 6)), np.full(count, 2.0)
    step[[3, 4], 2], limit[4] = 10.0, 50.0
    moves = limited(step, limit, estimate)
    assert moves[4, 2] == 10.0
    assert abs(moves[3, 2] - 2.0) < 0.3  # what all do is fitted, and pulled a little by these two


def test_a_landmark_that_a_step_makes_worse_is_held_back_and_no_other():
    """Away from the minimum all go back to it, but for one, whose normal turns by half a radian on its way."""
    scene = synthetic_scene(size=10, views=4, keypoint_noise_px=0.3, brightness_noise=0.01)
    graph, spoilt = graph_of(scene).graph, 34
    estimate = minimize(graph, perturbed(scene, size=0.2)).estimate
    away = np.zeros((len(estimate.landmarks), 6))
    away[:, 5] = 0.005 * estimate.landmarks.albedo
    begin, back = estimate.step(np.zeros((4, 10)), away, np.zeros(0)), -away
    back[spoilt, 3] = 0.5
    trial = descend(graph, begin, graph.cost(begin).sum(), (np.zeros((4, 10)), back, np.zeros(0)), np.inf)
    assert trial.whole
    assert trial.cost.sum() < graph.cost(begin).sum()
    np.testing.assert_array_equal(np.flatnonzero(trial.held), [spoilt])
    moves = trial.moves[40:].reshape(-1, 6)
    others = np.arange(len(moves)) != spoilt
    np.testing.assert_array_equal(moves[others], back[others])
    assert np.linalg.norm(moves[spoilt]) < 0.3 * np.linalg.norm(back[spoilt])
