"""Instant-NGP: features between nodes, derivatives against differences, a wall in closed form, and known scenes."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.rivals.measure import common_masks, image_figures
from photoclinometry.rivals.ngp import NgpOptions, run_ngp
from photoclinometry.rivals.problem import Problem
from photoclinometry.rivals.radiance.field import Rays, draw, draw_back, first_parameters
from photoclinometry.rivals.radiance.hash_grid import encode, encode_back, resolutions
from photoclinometry.rivals.radiance.rays import Box
from scenes import synthetic_images, synthetic_scene


def test_resolutions_grow_geometrically():
    assert resolutions(5, 16, 256).tolist() == [16, 32, 64, 128, 256]
    assert resolutions(1, 16, 256).tolist() == [16]


def test_features_are_trilinear_between_nodes_that_have_entries_of_their_own():
    """Tables that hold a linear function of the place give it back anywhere."""
    cells = np.array([4, 7])
    table = np.zeros((2, 512, 2), np.float32)
    for level, count in enumerate(cells):
        z, y, x = np.mgrid[: count + 1, : count + 1, : count + 1].reshape(3, -1) / count
        table[level, : len(x)] = np.stack([x + 2 * y - z, 3 * z], -1)
    places = np.random.default_rng(0).random((50, 3)).astype(np.float32)
    x, y, z = places.T.astype(float)
    expected = np.tile(np.stack([x + 2 * y - z, 3 * z], -1), 2)
    np.testing.assert_allclose(encode(places, cells, table), expected, atol=1e-5)


def test_nodes_of_fine_grids_share_entries():
    """Eight nodes around a place have some entries of the table, whose weights sum to one."""
    table = np.ones((1, 16, 2), np.float32)
    places = np.random.default_rng(1).random((20, 3)).astype(np.float32)
    np.testing.assert_allclose(encode(places, np.array([1000]), table), 1.0, atol=1e-5)
    by = encode_back(places, np.array([1000]), 16, np.ones((20, 2), np.float32))
    assert by[..., 0].sum() == pytest.approx(20.0, rel=1e-5)
    assert np.count_nonzero(by[0, :, 0]) > 10


@pytest.fixture
def field():
    rng = np.random.default_rng(2)
    parameters = first_parameters(rng, 3, 64)
    parameters["table"] = rng.normal(size=parameters["table"].shape).astype(np.float32)
    return {name: values.astype(np.float64) for name, values in parameters.items()}, resolutions(3, 2, 9)


@pytest.fixture
def rays():
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(6, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return Rays(rng.random((6, 5, 3)), rng.uniform(0.1, 0.4, (6, 5)), directions)


def test_derivatives_by_every_parameter_are_those_of_differences(field, rays):
    """The table is read in single precision, so that its steps are larger."""
    parameters, cells = field
    by_brightness = np.random.default_rng(4).normal(size=6)
    drawn = draw(parameters, cells, rays)
    found = draw_back(parameters, cells, rays, drawn, by_brightness)
    rng = np.random.default_rng(5)
    for name, values in parameters.items():
        flat = found[name].reshape(-1)
        strong = np.argsort(-np.abs(flat))[:40]
        for index in rng.choice(strong, 6, replace=False):
            moved = []
            step = 1e-3 if name == "table" else 1e-5
            for sign in (1, -1):
                changed = values.copy()
                changed.reshape(-1)[index] += sign * step
                other = draw(parameters | {name: changed}, cells, rays).brightness
                moved.append(by_brightness @ other)
            assert flat[index] == pytest.approx((moved[0] - moved[1]) / (2 * step), rel=5e-3, abs=1e-5), name


def test_shares_of_samples_are_those_of_the_quadrature(field, rays):
    """Mildenhall et al. (2020), Eq. 3, written out."""
    parameters, cells = field
    drawn = draw(parameters, cells, rays)
    depth, value = drawn.depth, drawn.value
    for n in range(6):
        passed, brightness = 1.0, 0.0
        for i in range(5):
            alpha = 1.0 - np.exp(-depth[n, i])
            assert drawn.weight[n, i] == pytest.approx(passed * alpha, rel=1e-5)
            brightness += passed * alpha * value[n, i]
            passed *= 1.0 - alpha
        assert drawn.brightness[n] == pytest.approx(brightness, rel=1e-5)


def test_samples_lie_between_the_planes_around_the_ground():
    scene = synthetic_scene(size=24, views=4)
    box = Box.around(scene)
    crossings = box.rays(scene.views, 2, scene.views.project(2, scene.landmarks.position))
    share = np.linspace(0, 1, 9)[None].repeat(len(scene.landmarks), 0)
    places = box.side * crossings.sampled(share).places.astype(float)
    assert (places[:, 0, 2] / box.side).max() == pytest.approx(box.top, rel=1e-4)
    assert np.abs(places[:, -1, 2]).max() < 1e-3 * box.side
    # Each ray goes through its landmark.
    own = box.frame.inverse()(scene.landmarks.position)
    along = places[:, -1] - places[:, 0]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    off = own - places[:, 0]
    aside = off - np.sum(off * along, -1, keepdims=True) * along
    assert np.linalg.norm(aside, axis=-1).max() < 0.01 * scene.gsd


@pytest.fixture(scope="module")
def problem():
    """Seven views under the mean of their Suns, so that brightness is one of the ground, and one to predict."""
    scene = synthetic_scene(size=24, views=8)
    sun = scene.views.sun.mean(0)
    views = replace(scene.views, sun=np.tile(sun / np.linalg.norm(sun), (8, 1)))
    scene = scene.with_estimate(views, scene.landmarks)
    images = synthetic_images(scene)
    kept = np.arange(8) != 4
    used = replace(scene, views=views[np.flatnonzero(kept)], uncertainty={})
    ordered = [image for image, keep in zip(images, kept, strict=True) if keep] + [images[4]]
    return Problem(scene=used, images=ordered, held_out=views[[4]])


def test_training_explains_views_and_predicts_another_from_where_it_was_seen(problem):
    found = {}
    for iterations in (20, 400):
        outcome = run_ngp(problem, NgpOptions(iterations=iterations, levels=8, table_log2=14, samples=32, rays=256))
        figures = image_figures(problem, outcome, common_masks(problem, [outcome]))
        found[iterations] = figures, outcome
    first, last = (found[n][0] for n in (20, 400))
    assert last["psnr_mean_db"] > first["psnr_mean_db"] + 6.0
    assert last["psnr_held_out_mean_db"] > first["psnr_held_out_mean_db"] + 6.0
    assert last["coverage_percent"] > 95.0
    outcome = found[400][1]
    assert outcome.history[-1] < 0.2 * outcome.history[0]
    assert not outcome.knows_light
    assert outcome.scene is not None
    assert outcome.scene.reflectance is None


def test_a_training_is_the_same_each_time(problem):
    options = NgpOptions(iterations=5, levels=3, table_log2=10, samples=8, rays=32)
    first, second = (run_ngp(problem, options).rendered[0] for _ in range(2))
    np.testing.assert_array_equal(first, second)
