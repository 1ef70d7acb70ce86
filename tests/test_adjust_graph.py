"""The factor graph: compiled groups against the factors in NumPy, general groups by themselves, linearizations kept."""

from dataclasses import replace

import numpy as np
import pytest

from graphs import (
    BRIGHTNESS_SIGMA,
    KEYPOINT_SIGMA,
    SMOOTH_SIGMA,
    dense_jacobian,
    gradients_of,
    graph_of,
    observation_factors,
    perturbed,
    some_tracks_missing,
)
from jacobians import numerical_jacobian
from photoclinometry.adjust.graph import factors
from photoclinometry.adjust.graph.altimetry import Altimetry
from photoclinometry.adjust.graph.control_points import ControlPoints
from photoclinometry.adjust.graph.general import JacobianBlock, Rows
from photoclinometry.adjust.graph.graph import FactorGraph
from photoclinometry.adjust.graph.observations import Brightness, Keypoints, ObservationTable
from photoclinometry.adjust.graph.priors import (
    Exposure,
    Gauge,
    KnownPoses,
    LandmarkPriors,
    PosePriors,
    ReflectancePrior,
)
from photoclinometry.adjust.graph.smoothness import Smoothness
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import starting_model
from range_factors import Ranges
from scenes import synthetic_scene


@pytest.fixture(scope="module")
def partly_seen():
    return some_tracks_missing(synthetic_scene(size=9, views=5, keypoint_noise_px=0.3, brightness_noise=0.01))


@pytest.mark.parametrize("direct", [False, True], ids=["measured", "direct"])
@pytest.mark.parametrize("limits", [(np.inf, np.inf), (np.array([0.7, 1.3]), 1.5)], ids=["squares", "huber by group"])
def test_kernels_equal_the_factors(partly_seen, limits, direct):
    """Cost, by group, of a scene in which a third of the observations are missing."""
    scene = partly_seen
    gradients = gradients_of(scene) if direct else None
    built = graph_of(scene, limits, hide=0.3, gradients=gradients)
    estimate = perturbed(scene)
    views, points = estimate.views, estimate.landmarks
    expected = np.zeros(4)
    keypoint_limit = np.broadcast_to(limits[0], 2)
    for n, (j, _, (r, *_), (brightness, _)) in enumerate(observation_factors(scene, estimate, gradients)):
        expected[0] += factors.huber(r @ r, keypoint_limit[j % 2])
        if built.used[n]:
            expected[1] += factors.huber(brightness * brightness, limits[1])
    for j, m in zip(*np.nonzero(built.present), strict=True):
        neighbour = points.position[built.index[j, m]]
        expected[2] += factors.smoothness(points.position[j], points.normal[j], neighbour, SMOOTH_SIGMA)[0] ** 2
    for k in range(len(views)):
        rotation, measured = views.body_from_cam.rotation[k], (views.sun_measured[k], views.sun_sigma[k])
        r = factors.sun_direction(rotation, views.sun[k], *measured)[0]
        expected[3] += r @ r
    graph = built.graph
    assert graph.cost_names[:4] == ("keypoint", "brightness", "smoothness", "sun")
    np.testing.assert_allclose(graph.cost(estimate)[:4], expected, rtol=1e-6)
    np.testing.assert_allclose(graph.linearize(estimate).cost, graph.cost(estimate), rtol=1e-12)


def test_the_smoothness_kernel_equals_the_factor_with_bends_and_spikes(partly_seen):
    """Rows and residuals of all pairs, one landmark lying along a neighbour's normal."""
    built, estimate = graph_of(partly_seen, (np.inf, np.inf)), perturbed(partly_seen)
    pairs, points = built.graph.smoothness.neighbours, estimate.landmarks
    position = points.position.copy()
    position[pairs.target[0]] = position[pairs.source[0]] + 0.3 * points.normal[pairs.source[0]]
    estimate = replace(estimate, landmarks=replace(points, position=position))
    bend = np.random.default_rng(5).normal(0.0, 0.1, len(pairs.target))
    found = Smoothness(pairs, SMOOTH_SIGMA, bend).linearize(estimate, float)
    for p, (j, q) in enumerate(zip(pairs.source, pairs.target, strict=True)):
        residual, jacobian = factors.smoothness(position[j], points.normal[j], position[q], SMOOTH_SIGMA, bend[p])
        assert found.residual[p] == pytest.approx(residual, rel=1e-12)
        np.testing.assert_allclose(found.rows[p], [*jacobian[5:], *jacobian[3:5]], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("direct", [False, True], ids=["measured", "direct"])
def test_gradient_is_the_slope_of_the_cost(partly_seen, direct):
    graph = graph_of(partly_seen, (2.0, 2.0), gradients=gradients_of(partly_seen) if direct else None).graph
    estimate = perturbed(partly_seen)
    at = graph.linearize(estimate)
    rng = np.random.default_rng(8)
    for scale in np.eye(4):
        camera = rng.normal(size=(5, 10)) * np.r_[[1e-7] * 3, [1e-2] * 3, [1e-5] * 2, 1e-5, 1e-6]
        camera *= scale[0] * np.r_[[1.0] * 6, [0.0] * 4] + scale[1] * np.r_[[0.0] * 6, [1.0] * 4]
        landmark = rng.normal(size=(81, 6)) * np.r_[[1e-2] * 3, [1e-5] * 2, 1e-6]
        landmark *= scale[2] * np.r_[1.0, 1, 1, 0, 0, 0] + scale[3] * np.r_[0.0, 0, 0, 1, 1, 1]
        slope = numerical_jacobian(lambda t: graph.cost(estimate.step(t[0] * camera, t[0] * landmark)).sum(), 1, 0.3)  # noqa: B023
        predicted = 2 * (np.vdot(at.views.gradient, camera) + np.vdot(at.landmarks.gradient, landmark))
        assert predicted == pytest.approx(float(slope[0, 0]), rel=2e-5)


@pytest.mark.parametrize("direct", [False, True], ids=["measured", "direct"])
def test_product_equals_the_dense_normal_matrix(direct):
    """J^T J x of the matrix-free kernel against J from the factors, in single precision."""
    scene = some_tracks_missing(synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01))
    gradients = gradients_of(scene) if direct else None
    estimate = perturbed(scene)
    at = graph_of(scene, gradients=gradients).graph.linearize(estimate)
    jacobian = dense_jacobian(scene, estimate, gradients)
    hessian = jacobian.T @ jacobian
    rng = np.random.default_rng(2)
    size = 1.0 / np.sqrt(np.diag(hessian) + 1e-12)
    x = rng.normal(size=len(hessian)) * size
    landmark, single = np.empty((36, 6), np.float32), x.astype(np.float32)
    camera = at.observed.multiply(single[:40].reshape(4, 10), single[40:].reshape(-1, 6), landmark)
    product = np.concatenate([camera.ravel(), landmark.ravel()]) * size
    np.testing.assert_allclose(product, hessian @ x * size, atol=2e-5 * abs(hessian @ x * size).max())
    for k in range(4):
        expected = hessian[10 * k : 10 * k + 10, 10 * k : 10 * k + 10]
        scaling = np.outer(size, size)[10 * k : 10 * k + 10, 10 * k : 10 * k + 10]
        np.testing.assert_allclose(at.observed.view_block[k] * scaling, expected * scaling, atol=1e-6)


@pytest.mark.parametrize("direct", [False, True], ids=["measured", "direct"])
@pytest.mark.parametrize("disk", ["lunar-lambert", "minnaert", "akimov+", "hapke"])
def test_border_equals_the_products_with_derivatives_by_the_parameters(disk, direct):
    """The rows of the normal equations by reflectance parameters, these columns of J by differences of the factors."""
    scene = some_tracks_missing(synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01))
    scene = replace(scene, reflectance=starting_model(disk, "vesta"))
    gradients = gradients_of(scene) if direct else None
    count = len(scene.reflectance.parameters)
    changed = np.linspace(-0.1, 0.1, count)
    estimate = replace(perturbed(scene), parameters=changed)
    at = graph_of(scene, gradients=gradients).graph.linearize(estimate)

    def with_changes(x):
        return replace(scene, reflectance=scene.reflectance.moved(x))

    def residuals(x):
        found = observation_factors(with_changes(x), estimate, gradients)
        return np.concatenate([[*projection[0], photometric[0]] for _, _, projection, photometric in found])

    by_parameter = numerical_jacobian(lambda x: residuals(changed + x), count, 1e-4)
    others = dense_jacobian(with_changes(changed), estimate, gradients)
    expected = others.T @ by_parameter
    border = np.vstack([at.border.by_view.reshape(-1, count), at.border.by_landmark.reshape(-1, count)])
    size = np.sqrt(np.outer(np.sum(others**2, 0), np.sum(by_parameter**2, 0))) + 1e-9
    np.testing.assert_allclose(border / size, expected / size, atol=2e-6)
    np.testing.assert_allclose(at.border.block, by_parameter.T @ by_parameter, rtol=1e-5)
    gradient = by_parameter.T @ residuals(changed)
    np.testing.assert_allclose(at.border.gradient, gradient, rtol=1e-5, atol=1e-5 * abs(gradient).max())


def test_a_linearization_is_a_value_that_later_ones_do_not_change(partly_seen):
    """Rows, gradient and products of one estimate stay what they are while others are linearized and costed."""
    graph = graph_of(partly_seen).graph
    at = graph.linearize(perturbed(partly_seen))
    x = np.random.default_rng(0).normal(size=len(at.gradient)).astype(np.float32)
    gradient, product, decrease = at.gradient.copy(), at.multiply(x), at.decrease(1e-3 * x)
    graph.linearize(perturbed(partly_seen, seed=1))
    graph.cost(perturbed(partly_seen, seed=2))
    np.testing.assert_array_equal(at.gradient, gradient)
    np.testing.assert_array_equal(at.multiply(x), product)
    assert at.decrease(1e-3 * x) == decrease


def test_the_promised_decrease_is_the_quadratic_models(partly_seen):
    """For a short move the cost falls by what the linearization promises, to second order."""
    graph, estimate = graph_of(partly_seen).graph, perturbed(partly_seen)
    at = graph.linearize(estimate)
    downhill = -1e-7 * at.gradient / at.diagonal
    camera, landmark, _ = at.split(downhill)
    fell = graph.cost(estimate).sum() - graph.cost(estimate.step(camera, landmark)).sum()
    assert at.decrease(downhill) == pytest.approx(fell, rel=1e-4)


def general_groups(scene):
    """One of every general group."""
    count, rng = len(scene.landmarks), np.random.default_rng(4)
    tight = np.where(np.arange(count) % 2, 0.01, np.inf)
    first, central = scene.views.body_from_cam[0], scene.landmarks.position[7]
    return [
        LandmarkPriors(
            landmarks=scene.landmarks, position_sigma=300 * tight, normal_sigma=tight, albedo_sigma=0.1 * tight
        ),
        PosePriors(
            body_from_cam=scene.views.body_from_cam,
            rotation_sigma=np.r_[1e-4, np.inf, 1e-3, 1e-4],
            center_sigma=np.r_[10.0, np.inf, 20.0, np.inf],
        ),
        Gauge(
            view=0, body_from_cam=first, rotation_sigma=1e-4, center_sigma=5.0, landmark=7, position=central,
            position_sigma=2.0,
        ),
        KnownPoses(body_from_cam=scene.views.body_from_cam, covariance=correlated_poses(rng)),
        Exposure(scale_sigma=np.r_[0.01, np.inf, 0.02, 0.01], bias_sigma=np.full(4, 0.001)),
        ControlPoints(
            landmark=np.array([3, 5]), position=scene.landmarks.position[[3, 5]], sigma=rng.uniform(1, 5, (2, 3))
        ),
        ReflectancePrior(sigma=0.05),
        Altimetry(
            landmark=np.array([3, 5, 8]), track=np.array([0, 1, 1]), first=1, shift_sigma=np.r_[20.0, 7.0],
            position=scene.landmarks.position[[3, 5, 8]] + rng.normal(0, 30, (3, 3)), sigma=rng.uniform(1, 5, 3),
        ),
        PosePriors(
            body_from_cam=scene.views.body_from_cam, rotation_sigma=np.r_[1e-4, np.inf, 1e-3, 1e-4],
            center_sigma=np.r_[10.0, np.inf, 20.0, np.inf], common_rotation_sigma=1e-3, common_center_sigma=50.0,
        ),
        PosePriors(
            body_from_cam=scene.views.body_from_cam, rotation_sigma=np.full(4, 1e-3), center_sigma=np.full(4, 10.0),
            common_rotation_sigma=1e-3, common_center_sigma=50.0, arc=np.array([0, 2, 0, 1]),
        ),
        Ranges(np.array([1, 3]), np.array([2, 4]), np.array([5e5, 6e5]), 3.0),
    ]  # fmt: skip


def correlated_poses(rng):
    """(4, 6, 6): from where a camera looks is hardly known, where it looks well."""
    root = np.diag([1e-4, 1e-4, 1e-4, 10.0, 10.0, 10.0]) @ rng.normal(size=(4, 6, 6))
    return root @ np.swapaxes(root, 1, 2)


class EveryNumberTouched:
    """Of the systematic errors; those that no factor touches are held by ones on the diagonal instead."""

    name = "every number"

    def rows(self, estimate):
        slope = np.tile(1e-3 * np.eye(10), (3, 1, 1))
        return [Rows(1e-3 * estimate.systematic, (JacobianBlock("systematic", np.arange(3), slope),))]


@pytest.mark.parametrize("number", range(11))
def test_general_groups_have_the_slopes_of_their_residuals(number):
    scene = synthetic_scene(size=6, views=4)
    group = general_groups(scene)[number]
    # rotations far from their prior are not linear in omega: see `pose_rows`
    estimate = replace(perturbed(scene, size=0.3), parameters=np.linspace(-0.1, 0.1, 6), systematic=systematic())
    for part, rows in enumerate(group.rows(estimate)):
        for touch in rows.touches:
            size = touch.jacobian.shape[2]
            for i in range(size):
                step = {"view": np.zeros((4, 10)), "landmark": np.zeros((36, 6)), "parameter": np.zeros(6)}
                step["systematic"] = np.zeros((3, 10))
                h = {
                    "view": [1e-6] * 3 + [1.0] * 3 + [1e-4] * 4,
                    "landmark": [1.0] * 3 + [1e-4] * 3,
                    "systematic": [1e-6] * 3 + [1.0] * 3,
                }.get(touch.variable, [1e-3] * size)[i]
                step[touch.variable][..., i] = h

                def moved(t, step=step, part=part):
                    views = np.concatenate([step["view"], step["systematic"]])
                    now = estimate.step(t * views, t * step["landmark"], t * step["parameter"])
                    return group.rows(now)[part].residual

                slope = (moved(1.0) - moved(-1.0)) / (2 * h)
                if len(rows.touches) > 1:  # every view and landmark moved, of which a factor touches one each
                    scale = abs(touch.jacobian).max()
                else:
                    scale = abs(touch.jacobian[:, :, i]).max() + 1e-12
                np.testing.assert_allclose(slope, touch.jacobian[:, :, i], atol=2e-3 * scale)


def systematic():
    """(3, 10) values of systematic errors: of all pose priors, and of two tracks."""
    out = np.zeros((3, 10))
    out[0, :6], out[1:, :3] = [1e-4, -2e-4, 1e-4, 5.0, -9.0, 20.0], [[3.0, -8.0, 2.0], [-4.0, 0.0, 1.0]]
    return out


def test_general_groups_add_to_gradient_blocks_and_products():
    """With them and without: H and g differ by J^T J and J^T r of their rows, those that touch two variables too."""
    scene = synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01)
    estimate = replace(perturbed(scene), parameters=np.zeros(6), systematic=systematic())
    others = general_groups(scene)
    plain, more = (
        graph_of(scene, others=(EveryNumberTouched(), *groups)).graph.linearize(estimate) for groups in ((), others)
    )
    n = 40 + 30 + 216 + 6
    jacobian, residual = [], []
    for group in others:
        for rows in group.rows(estimate):
            for f in range(len(rows.residual)):
                row = np.zeros((rows.residual.shape[1], n))
                for touch in rows.touches:
                    first = {"view": 0, "systematic": 40, "landmark": 70, "parameter": 286}[touch.variable]
                    size = {"view": 10, "systematic": 10, "landmark": 6, "parameter": 6}[touch.variable]
                    start = first + size * touch.index[f]
                    row[:, start : start + touch.jacobian.shape[2]] += touch.jacobian[f]
                jacobian.append(row)
                residual.append(rows.residual[f])
    jacobian, residual = np.vstack(jacobian), np.concatenate(residual)
    expected = jacobian.T @ residual
    np.testing.assert_allclose(more.gradient - plain.gradient, expected, atol=1e-9 * abs(more.gradient).max())
    own = np.sum(jacobian**2, axis=0)
    np.testing.assert_allclose((more.diagonal - plain.diagonal) / more.diagonal, own / more.diagonal, atol=1e-5)
    size = 1.0 / np.sqrt(more.diagonal)
    for i in range(5):
        x = (np.random.default_rng(i).normal(size=n) * size).astype(np.float32)
        found = (more.multiply(x) - plain.multiply(x)) * size
        whole = np.linalg.norm(more.multiply(x) * size)
        np.testing.assert_allclose(found, (jacobian.T @ (jacobian @ x)) * size, atol=2e-5 * whole)


def test_a_landmark_seen_twice_in_one_view_is_refused():
    tracks = synthetic_scene(size=4, views=4).tracks
    view = tracks.view.copy()
    view[tracks.start[3] + 1] = view[tracks.start[3]]
    with pytest.raises(ValueError, match="two observations in one view"):
        ObservationTable(replace(tracks, view=view), 4)


def test_a_view_without_brightness_adds_nothing_but_its_keypoints():
    """All of one view's brightness hidden: its Sun, scale and bias have no factor, and no stale rows are left."""
    scene = synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01)
    at = graph_of(scene, used=scene.tracks.view != 2).graph.linearize(perturbed(scene, seed=1))
    np.testing.assert_array_equal(at.observed.view_block[2, 6:, :6], 0.0)
    out = np.empty((36, 6), np.float32)
    landmark = np.random.default_rng(0).normal(size=(36, 6)).astype(np.float32)
    camera = at.observed.multiply(np.zeros((4, 10), np.float32), landmark, out)
    np.testing.assert_array_equal(camera[2, 6:], 0.0)
    assert np.all(camera[1, 6:] != 0.0)


def test_groups_that_contradict_each_other_are_refused():
    scene = synthetic_scene(size=6, views=4)
    table, other = ObservationTable(scene.tracks, 4), ObservationTable(scene.tracks, 4)
    every, sigma = np.ones(36, bool), np.ones(len(scene.tracks))
    one = Keypoints(name="one", table=table, landmarks=every, sigma=sigma)
    light = Brightness(
        table=other, reflectance=scene.reflectance, used=sigma > 0, brightness=scene.tracks.brightness, sigma=1.0
    )
    with pytest.raises(ValueError, match="one table"):
        FactorGraph([one, light])
    with pytest.raises(ValueError, match="keypoints of one landmark"):
        FactorGraph([one, replace(one, name="two")])
    with pytest.raises(ValueError, match="has keypoints"):
        FactorGraph([Exposure(scale_sigma=np.ones(4), bias_sigma=np.ones(4))])


def test_sigmas_of_the_helper_are_those_of_the_factors(partly_seen):
    graph = graph_of(partly_seen).graph
    assert graph.observations.keypoint_weight.max() == 1 / KEYPOINT_SIGMA
    assert graph.observations.brightness_weight.max() == 1 / BRIGHTNESS_SIGMA


def test_a_pose_prior_counts_the_turn_about_each_axis():
    """A view turned by two sigmas and moved by three along single axes: 4 and 9."""
    scene = synthetic_scene(size=6, views=4)
    estimate = perturbed(scene, size=0.0)
    nothing = np.full(3, np.inf)
    prior = PosePriors(
        body_from_cam=Rigid(scene.views.body_from_cam.rotation, scene.views.body_from_cam.translation),
        rotation_sigma=np.r_[1e-4, nothing],
        center_sigma=np.r_[2.0, nothing],
    )
    step = np.zeros((4, 10))
    step[0, 3:6] = [0.0, 6.0, 0.0]
    assert prior.rows(estimate.step(step, np.zeros((36, 6))))[0].cost == pytest.approx(9.0)
    step[0, :6] = [0.0, 0.0, 2e-4, 0.0, 0.0, 0.0]
    assert np.sum(prior.rows(estimate.step(step, np.zeros((36, 6))))[0].residual[0, :3] ** 2) == pytest.approx(4.0)


def test_costs_of_landmarks_are_of_their_own_observations_and_pairs():
    """They add up to the cost of observations, and to that of smoothness twice; what moves one landmark's albedo
    changes no other's."""
    scene = synthetic_scene(size=7, views=4, keypoint_noise_px=0.3, brightness_noise=0.01)
    graph = graph_of(scene, limits=(1.5, 1.5)).graph
    estimate = perturbed(scene)
    cost, of_landmarks = graph.costs(estimate)
    names = dict(zip(graph.cost_names, cost, strict=True))
    expected = names["keypoint"] + names["brightness"] + 2.0 * names["smoothness"]
    assert of_landmarks.sum() == pytest.approx(expected, rel=1e-9)
    np.testing.assert_array_equal(cost, graph.cost(estimate))
    step = np.zeros((49, 6))
    step[11, 5] = 0.05
    moved = graph.costs(estimate.step(np.zeros((4, 10)), step, np.zeros(0)))[1]
    np.testing.assert_array_equal(np.flatnonzero(np.abs(moved - of_landmarks) > 1e-6 * of_landmarks), [11])
