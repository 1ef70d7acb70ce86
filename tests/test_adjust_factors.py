"""Every factor's Jacobian against central differences, and the compiled kernels against the factors."""

from dataclasses import replace

import numpy as np
import pytest

from jacobians import numerical_jacobian
from photoclinometry.adjust import factors
from photoclinometry.adjust.layout import LANES, ImageSlopes, build_layout, lay_out, spread
from photoclinometry.adjust.priors import Priors
from photoclinometry.adjust.problem import Problem
from photoclinometry.adjust.smoothing import build_neighbours
from photoclinometry.adjust.variables import Estimate
from photoclinometry.model.geometry import so3_exp, sphere_step, unit
from photoclinometry.model.reflectance import DISK_FUNCTIONS, published
from scenes import synthetic_scene

RNG = np.random.default_rng(3)
ROTATION = so3_exp(np.array([0.2, -2.8, 0.4]))
CENTER = np.array([100.0, 50.0, 9000.0])
POSITION = np.array([12.0, -30.0, 8.0])
PIVOT = np.array([20.0, -10.0, 30.0])
INTRINSICS = np.array([9800.0, 9900.0, 512.0, 500.0])


def orbit(x):
    """ROTATION and CENTER moved by the six local coordinates of a pose."""
    turn = so3_exp(x[:3])
    return turn @ ROTATION, PIVOT + turn @ (CENTER - PIVOT + x[3:])


def test_projection_jacobian():
    position = CENTER + ROTATION @ np.array([0.02, -0.03, 1.0]) * 9000
    keypoint = np.array([700.0, 230.0])
    args = INTRINSICS, keypoint, 0.3, PIVOT
    _, by_position, by_pose = factors.projection(ROTATION, CENTER, args[0], position, *args[1:])

    def moved(x):
        rotation, center = orbit(x[3:])
        return factors.projection(rotation, center, args[0], position + x[:3], *args[1:])[0]

    numeric = numerical_jacobian(moved, 9, np.r_[[1e-1] * 3, [1e-4] * 3, [1e-1] * 3])
    np.testing.assert_allclose(np.hstack([by_position, by_pose]), numeric, rtol=1e-6, atol=1e-7 * abs(numeric).max())


def geometry(case):
    """Sun and normal of a delicate case, for a camera at CENTER and a landmark at POSITION."""
    to_camera = unit(CENTER - POSITION)
    if case == "near zero phase":
        return sphere_step(to_camera, np.array([1e-3, 5e-4])), unit(to_camera + [0.3, 0.1, 0])
    if case == "grazing Sun":
        sun = unit(np.array([1.0, 0.0, 0.05]))
        return sun, unit(np.array([0.02, 0.1, 1.0]))
    if case == "grazing camera":
        return unit(np.array([0.5, 0.2, 1.0])), unit(np.array([1.0, 0.3, 0.05]))
    return unit(np.array([0.5, -0.6, 0.8])), unit(np.array([0.1, 0.2, 1.0]))


@pytest.mark.parametrize("case", ["typical", "near zero phase", "grazing Sun", "grazing camera"])
@pytest.mark.parametrize("disk", DISK_FUNCTIONS)
def test_photometric_jacobian(disk, case):
    packed = published(disk, "vesta").packed
    sun, normal = geometry(case)
    scale, bias, albedo, rest = 1.1, 0.01, 0.35, (0.2, 0.004, PIVOT)
    _, analytic = factors.photometric(packed, CENTER, sun, scale, bias, POSITION, normal, albedo, *rest)

    def moved(x):
        return factors.photometric(
            packed, orbit(x[6:12])[1], sphere_step(sun, x[12:14]), scale + x[14], bias + x[15],
            POSITION + x[:3], sphere_step(normal, x[3:5]), albedo + x[5], *rest,
        )[0]  # fmt: skip

    steps = np.r_[[1.0] * 3, [1e-5] * 2, 1e-3, [1e-5] * 3, [1.0] * 3, [1e-5] * 2, 1e-3, 1e-4]
    numeric = numerical_jacobian(moved, 16, steps)[0]
    np.testing.assert_allclose(analytic, numeric, rtol=1e-4, atol=1e-6 * abs(numeric).max())


def test_direct_jacobian():
    """Brightness taken from the image where the landmark projects: the image's slope in all that moves the landmark
    in it."""
    packed = published("lunar-lambert", "vesta").packed
    sun, normal = geometry("typical")
    position = CENTER + ROTATION @ np.array([0.02, -0.03, 1.0]) * 9000
    image = 0.2, np.array([700.0, 230.0]), np.array([0.004, -0.007])
    rest = (image, 0.004, PIVOT)
    _, analytic = factors.direct(packed, ROTATION, CENTER, INTRINSICS, sun, 1.1, 0.01, position, normal, 0.35, *rest)

    def moved(x):
        rotation, center = orbit(x[6:12])
        return factors.direct(
            packed, rotation, center, INTRINSICS, sphere_step(sun, x[12:14]), 1.1 + x[14], 0.01 + x[15],
            position + x[:3], sphere_step(normal, x[3:5]), 0.35 + x[5], *rest,
        )[0]  # fmt: skip

    steps = np.r_[[0.1] * 3, [1e-5] * 2, 1e-3, [1e-6] * 3, [0.1] * 3, [1e-5] * 2, 1e-3, 1e-4]
    numeric = numerical_jacobian(moved, 16, steps)[0]
    np.testing.assert_allclose(analytic, numeric, rtol=1e-4, atol=1e-6 * abs(numeric).max())
    still = factors.photometric(packed, CENTER, sun, 1.1, 0.01, position, normal, 0.35, 0.2, 0.004, PIVOT)
    assert np.linalg.norm(analytic[:3]) > 10 * np.linalg.norm(still[1][:3])


@pytest.mark.parametrize("disk", DISK_FUNCTIONS)
def test_photometric_factor_is_finite_at_zero_phase_and_flat_in_shadow(disk):
    packed = published(disk, "vesta").packed
    to_camera = unit(CENTER - POSITION)
    residual, jacobian = factors.photometric(
        packed, CENTER, to_camera, 1.0, 0.0, POSITION, unit(to_camera + [0.1, 0, 0]), 0.3, 0.2, 0.01, PIVOT
    )
    assert np.isfinite(residual)
    assert np.all(np.isfinite(jacobian))
    below = factors.photometric(
        packed, CENTER, np.array([1.0, 0, 0]), 1.0, 0.0, POSITION, unit(np.array([-0.1, 0, 1])), 0.3, 0.0, 0.01, PIVOT
    )
    assert below[0] == 0.0
    np.testing.assert_array_equal(below[1][:15], 0.0)


def test_sun_jacobian_and_zero_at_the_measurement():
    sun = unit(np.array([0.3, -0.5, 0.8]))
    measured = ROTATION.T @ sun
    residual, jacobian = factors.sun_direction(ROTATION, sun, measured, 1e-3)
    np.testing.assert_allclose(residual, 0.0, atol=1e-10)
    numeric = numerical_jacobian(
        lambda x: factors.sun_direction(so3_exp(x[:3]) @ ROTATION, sphere_step(sun, x[3:]), measured, 1e-3)[0], 5, 1e-4
    )
    np.testing.assert_allclose(jacobian, numeric, rtol=1e-6, atol=1e-6 * abs(numeric).max())


@pytest.mark.parametrize("height", [0.0, 0.2, 5.0], ids=["flat", "typical", "spike"])
def test_smoothness_jacobian(height):
    position, neighbour = np.zeros(3), np.array([1.0, 0.3, height])
    normal = unit(np.array([0.1, -0.2, 1.0]))
    _, analytic = factors.smoothness(position, normal, neighbour, 0.2)
    numeric = numerical_jacobian(
        lambda x: factors.smoothness(position + x[:3], sphere_step(normal, x[3:5]), neighbour + x[5:], 0.2)[0], 8, 1e-4
    )[0]
    np.testing.assert_allclose(analytic, numeric, rtol=1e-6, atol=1e-8)


def perturbed(scene, seed=0, size=1.0):
    rng = np.random.default_rng(seed)
    views, landmarks = len(scene.views), len(scene.landmarks)
    camera = rng.normal(size=(views, 10)) * size * np.r_[[1e-5] * 3, [5.0] * 3, [1e-3] * 2, 1e-2, 1e-3]
    landmark = rng.normal(size=(landmarks, 6)) * size * np.r_[[10.0] * 3, [0.05] * 2, 0.01]
    pivot = scene.landmarks.position.mean(0)
    return Estimate(scene.views, scene.landmarks, pivot).step(camera, landmark)


def slopes_of(scene, seed=11):
    """Brightness that changes by a few per cent per pixel about where the landmarks are seen."""
    slope = 0.003 * np.random.default_rng(seed).normal(size=(len(scene.tracks), 2))
    return ImageSlopes(scene.tracks.keypoint + 0.2, slope.astype(np.float32).astype(float))


def problem_of(scene, limits=(np.inf, np.inf), hide=0.0, slopes=None):
    """The scene's problem with all factors and priors, its weights and pairs; a share of the brightness hidden."""
    rng = np.random.default_rng(5)
    tracks, views, landmarks = scene.tracks, len(scene.views), len(scene.landmarks)
    layout, place = build_layout(tracks, views)
    size = layout.places
    brightness_weight = np.where(rng.uniform(size=len(tracks)) < hide, 0.0, 1 / 0.003)
    measured = lay_out(tracks, place, size, slopes)._replace(
        keypoint_weight=spread(np.full(len(tracks), 2.0), place, size, np.float32),
        brightness_weight=spread(brightness_weight, place, size, np.float32),
        keypoint_limit=np.broadcast_to(np.asarray(limits[0], float), landmarks).copy(),
        brightness_limit=limits[1],
    )
    grid = np.arange(landmarks).reshape(scene.region.height, scene.region.width)
    index = np.stack([np.roll(grid, s, a).ravel() for a in (0, 1) for s in (-1, 1)], -1)
    far = np.linalg.norm(scene.landmarks.position[index] - scene.landmarks.position[:, None], axis=-1) > 2 * scene.gsd
    sigma = np.r_[1.0, np.full(views - 1, 30.0)]
    landmark_sigma = np.full(landmarks, np.inf)
    landmark_sigma[landmarks // 2] = 1.0
    priors = Priors(
        pose_rotation=1e-4 * sigma,
        pose_translation=10.0 * sigma,
        scale=np.full(views, 0.01),
        bias=np.full(views, 0.001),
        landmarks=scene.landmarks,
        position=landmark_sigma,
        normal=np.full(landmarks, np.inf),
        albedo=np.full(landmarks, np.inf),
        views=scene.views,
    )
    neighbours = build_neighbours(index, ~far)
    problem = Problem(layout, measured, neighbours, priors, scene.reflectance, smooth_sigma=0.2)
    return problem, brightness_weight, index, ~far


def observation_factors(scene, estimate, slopes=None):
    """For every observation: landmark, view, `factors.projection` and `factors.photometric`, or with slopes
    `factors.direct`, at problem_of's sigmas."""
    views, points, tracks = estimate.views, estimate.landmarks, scene.tracks
    for n, (j, k) in enumerate(zip(tracks.landmark, tracks.view, strict=True)):
        pose, position = views.body_from_cam[k], points.position[j]
        projection = factors.projection(
            pose.rotation, pose.translation, views.intrinsics[k], position, tracks.keypoint[n], 0.5, estimate.pivot
        )
        what = views.sun[k], views.scale[k], views.bias[k], position, points.normal[j], points.albedo[j]
        packed, rest = scene.reflectance.packed, (0.003, estimate.pivot)
        if slopes is None:
            photometric = factors.photometric(packed, pose.translation, *what, tracks.brightness[n], *rest)
        else:
            camera, image = views.intrinsics[k], (tracks.brightness[n], slopes.at[n], slopes.slope[n])
            photometric = factors.direct(packed, pose.rotation, pose.translation, camera, *what, image, *rest)
        yield j, k, projection, photometric


@pytest.mark.parametrize("direct", [False, True], ids=["measured", "direct"])
@pytest.mark.parametrize(
    "limits", [(np.inf, np.inf), (np.linspace(0.5, 1.5, 81), 1.5)], ids=["squares", "huber by landmark"]
)
def test_kernels_equal_the_factors(limits, direct):
    """Cost, by kind of factor, of a scene in which a third of the observations are missing."""
    scene = some_tracks_missing(synthetic_scene(size=9, views=5, keypoint_noise_px=0.3, brightness_noise=0.01))
    slopes = slopes_of(scene) if direct else None
    problem, weight, index, present = problem_of(scene, limits, hide=0.3, slopes=slopes)
    estimate = perturbed(scene)
    views, points = estimate.views, estimate.landmarks
    expected = np.zeros(4)
    keypoint_limit = np.broadcast_to(limits[0], 81)
    for n, (j, _, (r, *_), (brightness, _)) in enumerate(observation_factors(scene, estimate, slopes)):
        expected[0] += factors.huber(r @ r, keypoint_limit[j])
        if weight[n]:
            expected[1] += factors.huber(brightness * brightness, limits[1])
    for j, m in zip(*np.nonzero(present), strict=True):
        expected[2] += (
            factors.smoothness(points.position[j], points.normal[j], points.position[index[j, m]], 0.2)[0] ** 2
        )
    for k in range(len(views)):
        r = factors.sun_direction(
            views.body_from_cam.rotation[k], views.sun[k], views.sun_measured[k], views.sun_sigma[k]
        )[0]
        expected[3] += r @ r
    np.testing.assert_allclose(problem.cost(estimate)[:4], expected, rtol=1e-6)


def some_tracks_missing(scene):
    tracks = scene.tracks
    keep = np.random.default_rng(1).uniform(size=len(tracks)) < 0.67
    counts = np.bincount(tracks.landmark[keep], minlength=len(tracks.start) - 1)
    names = ("view", "keypoint", "keypoint_sigma", "brightness", "lit")
    fewer = {name: getattr(tracks, name)[keep] for name in names}
    return replace(scene, tracks=replace(tracks, start=np.concatenate([[0], np.cumsum(counts)]), **fewer))


@pytest.mark.parametrize("direct", [False, True], ids=["measured", "direct"])
def test_gradient_is_the_slope_of_the_cost(direct):
    scene = some_tracks_missing(synthetic_scene(size=9, views=5, keypoint_noise_px=0.3, brightness_noise=0.01))
    problem, *_ = problem_of(scene, limits=(2.0, 2.0), slopes=slopes_of(scene) if direct else None)
    estimate = perturbed(scene)
    _, equations = problem.linearize(estimate)
    rng = np.random.default_rng(8)
    for scale in np.eye(4):
        camera = rng.normal(size=(5, 10)) * np.r_[[1e-7] * 3, [1e-2] * 3, [1e-5] * 2, 1e-5, 1e-6]
        camera *= scale[0] * np.r_[[1.0] * 6, [0.0] * 4] + scale[1] * np.r_[[0.0] * 6, [1.0] * 4]
        landmark = rng.normal(size=(81, 6)) * np.r_[[1e-2] * 3, [1e-5] * 2, 1e-6]
        landmark *= scale[2] * np.r_[1.0, 1, 1, 0, 0, 0] + scale[3] * np.r_[0.0, 0, 0, 1, 1, 1]
        slope = numerical_jacobian(lambda t: problem.cost(estimate.step(t[0] * camera, t[0] * landmark)).sum(), 1, 0.3)  # noqa: B023
        predicted = 2 * (np.vdot(equations.camera_gradient, camera) + np.vdot(equations.landmark_gradient, landmark))
        assert predicted == pytest.approx(float(slope[0, 0]), rel=2e-5)


@pytest.mark.parametrize("direct", [False, True], ids=["measured", "direct"])
def test_product_equals_the_dense_normal_matrix(direct):
    """J^T J x of the matrix-free kernel against J from the factors, in single precision."""
    scene = some_tracks_missing(synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01))
    slopes = slopes_of(scene) if direct else None
    problem, *_ = problem_of(scene, slopes=slopes)
    estimate = perturbed(scene)
    _, equations = problem.linearize(estimate)
    jacobian = dense_jacobian(scene, estimate, slopes)
    hessian = jacobian.T @ jacobian
    rng = np.random.default_rng(2)
    size = 1.0 / np.sqrt(np.diag(hessian) + 1e-12)
    x = rng.normal(size=len(hessian)) * size
    landmark, single = np.empty((36, 6), np.float32), x.astype(np.float32)
    camera = problem.multiply_observations(equations, single[:40].reshape(4, 10), single[40:].reshape(-1, 6), landmark)
    product = np.concatenate([camera.ravel(), landmark.ravel()]) * size
    np.testing.assert_allclose(product, hessian @ x * size, atol=2e-5 * abs(hessian @ x * size).max())
    for k in range(4):
        expected = hessian[10 * k : 10 * k + 10, 10 * k : 10 * k + 10]
        block = equations.camera_block[k] - equations.camera_rest[k]
        scaling = np.outer(size, size)[10 * k : 10 * k + 10, 10 * k : 10 * k + 10]
        np.testing.assert_allclose(block * scaling, expected * scaling, atol=1e-6)


def dense_jacobian(scene, estimate, slopes=None):
    """(3 N, 10 K + 6 J) whitened Jacobian of projection and brightness, from the factors."""
    base = 10 * len(estimate.views)
    rows = np.zeros((3 * len(scene.tracks), base + 6 * len(estimate.landmarks)))
    for n, (j, k, projection, (_, row)) in enumerate(observation_factors(scene, estimate, slopes)):
        _, by_position, by_pose = projection
        l, c = base + 6 * j, 10 * k
        rows[3 * n : 3 * n + 2, l : l + 3], rows[3 * n : 3 * n + 2, c : c + 6] = by_position, by_pose
        rows[3 * n + 2, l : l + 6], rows[3 * n + 2, c : c + 10] = row[:6], row[6:]
    return rows


@pytest.mark.parametrize("direct", [False, True], ids=["measured", "direct"])
@pytest.mark.parametrize("disk", ["lunar-lambert", "minnaert", "akimov+", "hapke"])
def test_border_equals_the_products_with_derivatives_by_the_parameters(disk, direct):
    """The rows of the normal equations by reflectance parameters, these columns of J by differences of the factors."""
    scene = some_tracks_missing(synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01))
    scene = replace(scene, reflectance=published(disk, "vesta"))
    slopes = slopes_of(scene) if direct else None
    problem, *_ = problem_of(scene, slopes=slopes)
    count = len(scene.reflectance.parameters)
    changed = np.linspace(-0.1, 0.1, count)
    estimate = replace(perturbed(scene), parameters=changed)
    _, equations = problem.linearize(estimate)

    def with_changes(x):
        return replace(scene, reflectance=scene.reflectance.with_parameters(scene.reflectance.parameters * (1 + x)))

    def residuals(x):
        found = observation_factors(with_changes(x), estimate, slopes)
        return np.concatenate([[*projection[0], photometric[0]] for _, _, projection, photometric in found])

    by_parameter = numerical_jacobian(lambda x: residuals(changed + x), count, 1e-4)
    others = dense_jacobian(with_changes(changed), estimate, slopes)
    expected = others.T @ by_parameter
    border = np.vstack([equations.border.by_camera.reshape(-1, count), equations.border.by_landmark.reshape(-1, count)])
    size = np.sqrt(np.outer(np.sum(others**2, 0), np.sum(by_parameter**2, 0))) + 1e-9
    np.testing.assert_allclose(border / size, expected / size, atol=2e-6)
    np.testing.assert_allclose(equations.border.block, by_parameter.T @ by_parameter, rtol=1e-5)
    gradient = by_parameter.T @ residuals(changed)
    np.testing.assert_allclose(equations.border.gradient, gradient, rtol=1e-5, atol=1e-5 * abs(gradient).max())


def test_priors_on_landmarks_have_the_slope_of_their_cost():
    scene = synthetic_scene(size=6, views=4)
    problem, *_ = problem_of(scene)
    tight = np.full(36, np.inf)
    tight[::2] = 0.01
    problem.priors = replace(problem.priors, position=300 * tight, normal=tight, albedo=0.1 * tight)
    estimate = perturbed(scene)
    nothing = np.zeros((4, 10))
    block, gradient = np.zeros((36, 6, 6)), np.zeros((36, 6))
    problem.priors.add_landmarks(estimate, block, np.zeros_like(block), gradient)
    for i in range(6):
        step = np.eye(6)[i] * np.r_[[1.0] * 3, [1e-3] * 2, 1e-4][i] * np.ones((36, 1))
        slope = numerical_jacobian(lambda t: [problem.priors.cost(estimate.step(nothing, t[0] * step))], 1, 0.1)  # noqa: B023
        assert 2 * np.vdot(gradient, step) == pytest.approx(float(slope[0, 0]), rel=1e-5)
        curved = (
            problem.priors.cost(estimate.step(nothing, step))
            + problem.priors.cost(estimate.step(nothing, -step))
            - 2 * problem.priors.cost(estimate)
        )
        assert np.einsum("ji,jik,jk->", step, block, step) == pytest.approx(curved / 2, rel=0.02)


def test_a_view_without_brightness_in_a_group_adds_nothing_but_its_keypoints():
    """All of one view's brightness hidden: its Sun, scale and bias have no factor, and no stale rows are left."""
    scene = synthetic_scene(size=6, views=4, keypoint_noise_px=0.3, brightness_noise=0.01)
    problem, *_ = problem_of(scene)
    problem.linearize(perturbed(scene))
    layout, _ = build_layout(scene.tracks, 4)
    dark = np.repeat(layout.slot_view == 2, LANES)
    problem.measured.brightness_weight[dark] = 0.0
    _, equations = problem.linearize(perturbed(scene, seed=1))
    np.testing.assert_array_equal(equations.camera_block[2, 6:, :6] - equations.camera_rest[2, 6:, :6], 0.0)
    out = np.empty((36, 6), np.float32)
    landmark = np.random.default_rng(0).normal(size=(36, 6)).astype(np.float32)
    camera = problem.multiply_observations(equations, np.zeros((4, 10), np.float32), landmark, out)
    np.testing.assert_array_equal(camera[2, 6:], 0.0)
    assert np.all(camera[1, 6:] != 0.0)
