"""Measured Suns: errors of each view's own, and one that all of an arc have in common."""

from dataclasses import replace

import numpy as np
import pytest

from graphs import sun_residuals
from photoclinometry.adjust.graph.sun_directions import SunDirections, common_turns, sun_offsets, unexplained_variance
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.model.geometry import so3_exp, sphere_step
from scenes import synthetic_scene

OWN, COMMON = 1e-3, 1e-2


@pytest.fixture(scope="module")
def estimate():
    scene = synthetic_scene(size=4, views=6)
    views = replace(scene.views, sun_sigma=np.full(6, OWN), sun_common_sigma=np.full(6, COMMON))
    return Estimate(views, scene.landmarks, scene.landmarks.position.mean(0))


@pytest.fixture(scope="module", params=[[0] * 6, [0, 1, 0, 0, 1, 1]], ids=["one arc", "two arcs"])
def of_arcs(estimate, request):
    return replace(estimate, views=replace(estimate.views, arc=np.array(request.param)))


def measured_with(estimate, rotation, own):
    """With the Suns that were measured turned alike in C (3,) [rad], and each moved (K, 2) [rad]."""
    views = estimate.views
    in_cam = np.einsum("kij,ki->kj", views.body_from_cam.rotation, views.sun)
    return replace(estimate, views=replace(views, sun_measured=sphere_step(in_cam, own) @ so3_exp(rotation).T))


def cost(estimate):
    return sum(rows.cost for rows in SunDirections.of(estimate.views).rows(estimate))


def test_the_cost_is_that_of_gaussian_errors_of_their_covariance(of_arcs):
    rng = np.random.default_rng(0)
    off = measured_with(of_arcs, COMMON * rng.normal(size=3), OWN * rng.normal(size=(6, 2)))
    assert cost(off) == pytest.approx(np.sum(sun_residuals(off.views) ** 2), rel=1e-9)
    alone = replace(off, views=replace(off.views, sun_common_sigma=np.zeros(6)))
    assert cost(alone) == pytest.approx(np.sum(sun_residuals(alone.views) ** 2), rel=1e-9)


def test_errors_as_stated_cost_one_for_each_number(estimate):
    """Twelve, in the mean over 2,000 draws, to four standard errors."""
    rng = np.random.default_rng(1)
    costs = [
        cost(measured_with(estimate, COMMON * rng.normal(size=3), OWN * rng.normal(size=(6, 2)))) for _ in range(2000)
    ]
    assert np.mean(costs) == pytest.approx(12.0, abs=4 * np.sqrt(24 / 2000))


def test_a_rotation_of_all_is_told_from_errors_of_single_suns(estimate):
    rotation = 2.0 * COMMON * np.array([0.6, -0.8, 0.0])
    own, common = sun_offsets(measured_with(estimate, rotation, np.zeros((6, 2))).views)
    np.testing.assert_allclose(common, [rotation / COMMON], atol=0.05)
    assert np.abs(own).max() < 0.3
    moved = np.zeros((6, 2))
    moved[2] = 10.0 * OWN, 0.0
    own, common = sun_offsets(measured_with(estimate, np.zeros(3), moved).views)
    assert np.linalg.norm(own[2]) > 5.0
    assert np.linalg.norm(own, axis=1).argmax() == 2
    assert np.linalg.norm(common) < 1.0


def test_each_arc_has_a_rotation_of_its_own(estimate):
    """Two arcs turned by three sigmas each, in other directions: either turn is told, and the cost is that of the two
    arcs alone."""
    arc, turns = np.array([0, 1, 0, 0, 1, 1]), 3.0 * COMMON * np.array([[0.6, -0.8, 0.0], [-0.8, -0.6, 0.0]])
    parts = [measured_with(estimate, turn, np.zeros((6, 2))).views.sun_measured for turn in turns]
    measured = np.where((arc == 0)[:, None], parts[0], parts[1])
    off = replace(estimate, views=replace(estimate.views, sun_measured=measured, arc=arc))
    own, common = sun_offsets(off.views)
    np.testing.assert_allclose(common, turns / COMMON, atol=0.15)
    assert np.abs(own).max() < 0.5
    np.testing.assert_allclose(common_turns(off.views, np.array([1, 0, 2]))[:2], -turns[::-1], atol=0.15 * COMMON)
    assert not common_turns(off.views, np.array([2])).any()
    apart = [cost(replace(off, views=off.views[arc == number])) for number in (0, 1)]
    assert cost(off) == pytest.approx(sum(apart), rel=1e-12)
    together = replace(off, views=replace(off.views, arc=np.zeros(6, int)))
    assert cost(together) > 100.0 * cost(off)


def test_offsets_squared_are_the_cost(of_arcs):
    rng = np.random.default_rng(2)
    off = measured_with(of_arcs, COMMON * rng.normal(size=3), OWN * rng.normal(size=(6, 2)))
    own, common = sun_offsets(off.views)
    assert np.sum(own**2) + np.sum(common**2) == pytest.approx(cost(off), rel=1e-12)


def test_slopes_are_those_of_the_residuals(of_arcs):
    rng = np.random.default_rng(3)
    off = measured_with(of_arcs, COMMON * rng.normal(size=3), OWN * rng.normal(size=(6, 2)))
    suns = SunDirections.of(off.views, weight=1.7)
    still = np.zeros((len(off.landmarks), 6))
    for n, touch in [(n, touch) for n, rows in enumerate(suns.rows(off)) for touch in rows.touches]:
        k = int(touch.index[0])
        for m in (0, 1, 2, 6, 7):
            step = np.zeros((6, 10))
            step[k, m] = 1e-6
            ends = [suns.rows(off.step(sign * step, still))[n].residual[0] for sign in (1, -1)]
            np.testing.assert_allclose((ends[0] - ends[1]) / 2e-6, touch.jacobian[0, :, m], rtol=1e-4, atol=1e-3)


def test_the_group_owns_what_was_measured(of_arcs):
    """Views of an estimate that state other measurements change nothing."""
    suns = SunDirections.of(of_arcs.views)
    views = of_arcs.views
    other = replace(views, sun_measured=-views.sun_measured, sun_sigma=9.0 * views.sun_sigma)
    for before, after in zip(suns.rows(of_arcs), suns.rows(replace(of_arcs, views=other)), strict=True):
        np.testing.assert_array_equal(before.residual, after.residual)


def test_suns_that_brightness_moved_further_than_both_errors_allow_are_as_uncertain_as_that(estimate):
    """Each moved by five sigmas about both axes, where both errors allow sqrt(2): 25 = 1 + 1 + 23 times the variance,
    but for what half of the moves are less than typical ones of normal errors (1.4826). By half a sigma, nothing."""
    alone = replace(estimate, views=replace(estimate.views, sun_common_sigma=np.zeros(6)))
    signs = np.random.default_rng(4).choice([-1.0, 1.0], (6, 2))
    allowed = np.full(6, OWN**2)
    near = measured_with(alone, np.zeros(3), 0.5 * OWN * signs)
    np.testing.assert_array_equal(unexplained_variance(near.views, allowed), 0.0)
    far = measured_with(alone, np.zeros(3), 5.0 * OWN * signs)
    expected = ((5.0 * 1.4826) ** 2 - 2.0) * OWN**2
    np.testing.assert_allclose(unexplained_variance(far.views, allowed), expected, rtol=0.01)


def test_one_sun_that_is_wrong_is_not_the_brightness(estimate):
    alone = replace(estimate, views=replace(estimate.views, sun_common_sigma=np.zeros(6)))
    moved = np.zeros((6, 2))
    moved[3] = 50.0 * OWN
    off = measured_with(alone, np.zeros(3), moved)
    np.testing.assert_array_equal(unexplained_variance(off.views, np.full(6, OWN**2)), 0.0)
