"""Gaussian splatting: derivatives against differences, a Gaussian in closed form, and training on known scenes."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import unit
from photoclinometry.model.reflectance import published
from photoclinometry.model.scene import Tracks
from photoclinometry.rivals.gaussians.blending import LEAST_ALPHA, blend, tiles_of
from photoclinometry.rivals.gaussians.cloud import Cloud, flat_quaternions, rotations
from photoclinometry.rivals.gaussians.colour import HarmonicColour, Light, ReflectanceColour
from photoclinometry.rivals.gaussians.density import densified
from photoclinometry.rivals.gaussians.loss import Target, gradients
from photoclinometry.rivals.gaussians.projection import DILATION_PX2, Pinhole, project
from photoclinometry.rivals.measure import common_masks, image_figures
from photoclinometry.rivals.problem import Problem
from photoclinometry.rivals.splat import SplatOptions, run_splat
from photoclinometry.rivals.splat_reflectance import run_splat_reflectance
from scenes import synthetic_images, synthetic_scene

SHAPE = (37, 45)
"""Not whole tiles."""
CAMERA = Pinhole(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 50.0]), np.array([60.0, 55.0, 22.0, 18.0]))
"""Looks down from 50 above the origin, near enough that perspective matters."""
LIGHT = Light(center=np.array([0.0, 0.0, 50.0]), sun=unit(np.array([0.4, -0.3, 0.8])), scale=3.0, bias=0.02)
COLOURS = {
    "harmonics": HarmonicColour(degree=2),
    "reflectance": ReflectanceColour(reflectance=published("lunar-lambert", "vesta")),
}


def some_cloud(name, count=40, seed=0):
    """Gaussians of all sizes, tilts and opacities over the picture."""
    rng = np.random.default_rng(seed)
    colour = {"harmonics": 0.3 * rng.normal(size=(count, 9))}
    if name == "reflectance":
        colour = {"log_albedo": np.log(rng.uniform(0.2, 0.4, count))}
    tilt = unit(np.column_stack([0.3 * rng.normal(size=(count, 2)), np.ones(count)]))
    return Cloud(
        position=rng.uniform((-16, -14, -2), (16, 14, 2), (count, 3)),
        log_scale=np.log(rng.uniform(0.5, 2.5, (count, 3))),
        quaternion=flat_quaternions(tilt) * rng.uniform(0.5, 2.0, (count, 1)),
        logit=rng.normal(size=count),
        colour=colour,
    )


def some_target(seed=1):
    rng = np.random.default_rng(seed)
    return Target(camera=CAMERA, light=LIGHT, picture=rng.uniform(0, 1, SHAPE), mask=rng.uniform(size=SHAPE) > 0.1)


@pytest.mark.parametrize("name", COLOURS)
def test_derivatives_by_every_parameter_are_those_of_differences(name):
    cloud, target, colour = some_cloud(name, count=14), some_target(), COLOURS[name]
    found = gradients(cloud, colour, target, 1.1, 0.05)
    step = 1e-6
    for key, values in cloud.parameters.items():
        expected = np.empty(values.size)
        for n in range(values.size):
            losses = []
            for side in (step, -step):
                moved = values.copy().reshape(-1)
                moved[n] += side
                changed = Cloud.of(cloud.parameters | {key: moved.reshape(values.shape)})
                losses.append(gradients(changed, colour, target, 1.1, 0.05).loss)
            expected[n] = (losses[0] - losses[1]) / (2 * step)
        assert np.abs(expected).max() > 1e-5
        np.testing.assert_allclose(found.by[key].ravel(), expected, rtol=2e-4, atol=2e-7, err_msg=key)


def test_derivatives_by_gain_and_offset_are_those_of_differences():
    cloud, target, colour = some_cloud("harmonics"), some_target(), COLOURS["harmonics"]
    found = gradients(cloud, colour, target, 1.1, 0.05)
    for by, moves in ((found.by_gain, ((1.1 + 1e-6, 0.05), (1.1 - 1e-6, 0.05))),
                      (found.by_offset, ((1.1, 0.05 + 1e-6), (1.1, 0.05 - 1e-6)))):  # fmt: skip
        high, low = (gradients(cloud, colour, target, *move).loss for move in moves)
        assert by == pytest.approx((high - low) / 2e-6, rel=1e-5)


def test_a_gaussian_is_drawn_as_the_closed_form_says():
    """On the axis, flat towards the camera: variances (f s / z)^2 + 0.3 along x and y, weight o exp(-d' A d / 2)."""
    scale, opacity, brightness = np.array([2.0, 4.0, 1.0]), 0.6, 0.7
    cloud = Cloud(
        position=np.zeros((1, 3)),
        log_scale=np.log(scale)[None],
        quaternion=np.array([[2.0, 0.0, 0.0, 0.0]]),
        logit=np.array([np.log(opacity / (1 - opacity))]),
        colour={},
    )
    ellipses = project(cloud, CAMERA)
    np.testing.assert_allclose(ellipses.center, [[22.0, 18.0]])
    variance = np.array([(60.0 * 2.0 / 50.0) ** 2, (55.0 * 4.0 / 50.0) ** 2]) + DILATION_PX2
    np.testing.assert_allclose(ellipses.conic[0], [1 / variance[0], 0.0, 1 / variance[1]], atol=1e-15)
    made = blend(ellipses, cloud.opacity, np.array([[brightness]]), tiles_of(ellipses, SHAPE), SHAPE)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    alpha = opacity * np.exp(-0.5 * ((x - 22.0) ** 2 / variance[0] + (y - 18.0) ** 2 / variance[1]))
    near = np.hypot((x - 22.0), (y - 18.0)) < ellipses.radius[0]
    alpha = np.where((alpha >= LEAST_ALPHA), alpha, 0.0)
    np.testing.assert_allclose(made.value[near, 0], brightness * alpha[near], rtol=1e-12)
    np.testing.assert_allclose(made.left[near], 1 - alpha[near], rtol=1e-12)


def test_the_nearer_gaussian_is_in_front():
    """Two on one ray: value = c1 a1 + c2 a2 (1 - a1), whatever their order in the arrays."""
    cloud = Cloud(
        position=np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]),
        log_scale=np.full((2, 3), np.log(20.0)),
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
        logit=np.zeros(2),
        colour={},
    )
    camera = CAMERA._replace(intrinsics=np.array([60.0, 55.0, 22.5, 18.5]))  # the centre of a pixel
    ellipses = project(cloud, camera)
    made = blend(ellipses, cloud.opacity, np.array([[0.2], [0.8]]), tiles_of(ellipses, SHAPE), SHAPE)
    assert made.value[18, 22, 0] == pytest.approx(0.5 * 0.8 + 0.5 * 0.5 * 0.2)
    assert made.left[18, 22] == pytest.approx(0.25)


def test_quaternions_turn_the_third_axis_to_the_normal():
    normal = unit(np.random.default_rng(4).normal(size=(50, 3)) + (0, 0, 2.5))
    turned = rotations(flat_quaternions(normal))
    np.testing.assert_allclose(turned[..., 2], normal, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turned), 1.0)


def test_gaussians_that_are_pulled_are_doubled_and_faint_ones_removed():
    cloud = some_cloud("harmonics", count=4)
    cloud = replace(
        cloud,
        logit=np.array([0.0, 0.0, -9.0, 0.0]),
        log_scale=np.log(np.array([0.5, 3.0, 0.5, 0.5]))[:, None] * np.ones(3),
    )
    found, origin = densified(cloud, np.array([1.0, 1.0, 0.0, 0.0]), 100.0, 99, np.random.default_rng(0))
    assert origin.tolist() == [0, 1, 3, -1, -1]
    np.testing.assert_array_equal(found.position[0], found.position[3])  # cloned
    assert np.linalg.norm(found.position[1] - found.position[4]) > 0  # split
    np.testing.assert_allclose(np.exp(found.log_scale[[1, 4]]), 3.0 / 1.6)
    assert len(densified(cloud, np.ones(4), 100.0, 4, np.random.default_rng(0))[0]) == 3


@pytest.fixture(scope="module")
def problem():
    """Seven views of the bumpy surface to learn from, and one under another Sun to predict."""
    scene = synthetic_scene(size=24, views=8)
    images = synthetic_images(scene)
    used = scene.views[np.arange(7)]
    start = np.arange(0, 7 * 24**2 + 1, 7, dtype=np.int64)
    kept = scene.tracks.view < 7
    names = ("view", "keypoint", "keypoint_sigma", "brightness", "lit")
    tracks = Tracks(start=start, **{name: getattr(scene.tracks, name)[kept] for name in names})
    return Problem(scene=replace(scene, views=used, tracks=tracks), images=images, held_out=scene.views[[7]])


@pytest.fixture(scope="module")
def trained(problem):
    options = SplatOptions(iterations=300)
    return {"splat": run_splat(problem, options), "splat-reflectance": run_splat_reflectance(problem, options)}


@pytest.mark.parametrize("name", ["splat", "splat-reflectance"])
def test_training_lowers_the_loss_to_a_third(trained, name):
    history = trained[name].history
    assert history[-1] < history[0] / 3


def test_gaussians_with_a_reflectance_model_predict_an_unseen_sun_and_harmonics_do_not(problem, trained):
    """Although harmonics have their gain and offset fitted to the image that they are to predict."""
    masks = common_masks(problem, list(trained.values()))
    found = {name: image_figures(problem, outcome, masks) for name, outcome in trained.items()}
    better = found["splat-reflectance"]["psnr_held_out_mean_db"] - found["splat"]["psnr_held_out_mean_db"]
    assert better > 3.0
    assert found["splat-reflectance"]["psnr_held_out_mean_db"] > 30.0


def test_gaussians_with_a_reflectance_model_have_the_normals_and_albedos_of_the_surface(problem, trained):
    """But for the outermost three pixels, where a Gaussian has neighbours on one side alone."""
    scene = trained["splat-reflectance"].scene
    row, col = scene.cells
    found = scene.landmarks[(np.minimum(row, col) > 2) & (np.maximum(row, col) < 21)]
    index = {tuple(pixel): n for n, pixel in enumerate(problem.scene.landmarks.pixel)}
    true = problem.scene.landmarks[np.array([index[tuple(pixel)] for pixel in found.pixel])]
    angle = np.degrees(np.arccos(np.clip(np.sum(found.normal * true.normal, -1), -1, 1)))
    assert angle.mean() < 3.5
    assert np.abs(found.albedo / true.albedo - 1).mean() < 0.06
    assert trained["splat"].scene.reflectance is None


def test_a_training_is_the_same_each_time(problem):
    options = SplatOptions(iterations=20, degree=1, stride=2)
    first, second = (run_splat(problem, options) for _ in range(2))
    np.testing.assert_array_equal(first.rendered[0], second.rendered[0])
