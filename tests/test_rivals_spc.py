"""Classic stereophotoclinometry: its steps by themselves, and the recovery of an exactly known scene."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import Rigid, so3_exp
from photoclinometry.rivals.correlate import correlation_shifts
from photoclinometry.rivals.integrate import integrate_normals
from photoclinometry.rivals.problem import Problem
from photoclinometry.rivals.spc import SpcOptions, run_spc
from scenes import FOCAL_PX, GSD, synthetic_images, synthetic_scene

SIZE = 48


@pytest.fixture(scope="module")
def problem():
    """Eight views of the bumpy surface, without noise."""
    scene = synthetic_scene(size=SIZE, views=8)
    return Problem(scene=scene, images=synthetic_images(scene), held_out=None)


def errors(found, true):
    """Mean errors of heights about their mean [GSD], normals [degrees] and albedos [%]."""
    off = np.sum((found.landmarks.position - true.landmarks.position) * true.landmarks.normal, -1) / GSD
    angle = np.degrees(np.arccos(np.clip(np.sum(found.landmarks.normal * true.landmarks.normal, -1), -1, 1)))
    albedo = 100.0 * np.abs(found.landmarks.albedo / true.landmarks.albedo - 1.0)
    return np.abs(off - off.mean()).mean(), angle.mean(), albedo.mean()


def test_heights_of_exact_normals_are_those_of_the_surface():
    scene = synthetic_scene(size=SIZE, views=3)
    pose, camera = scene.views.body_from_cam[0], scene.views.cameras[0]
    ray = camera.ray_in_cam(scene.landmarks.pixel[:, ::-1] + 0.5)
    depth = scene.grid(pose.inverse()(scene.landmarks.position)[:, 2])
    cell = np.array([[8, 8], [8, 40], [40, 8], [40, 40], [24, 24]])
    control = depth[cell[:, 0], cell[:, 1]].copy()
    control[4] += 20 * GSD  # a wrong one
    normal = scene.grid(scene.landmarks.normal @ pose.rotation)
    found = integrate_normals(scene.grid(ray), normal, GSD, 0.03, cell, control, 0.2 * GSD)
    assert np.abs(found - depth).max() < 0.1 * GSD


def test_parts_of_the_map_without_a_control_height_have_none():
    ray = np.tile([0.0, 0.0, 1.0], (6, 9, 1))
    ray[..., 0], ray[..., 1] = np.meshgrid(np.arange(9) * 1e-3, np.arange(6) * 1e-3)
    ray[:, 4] = np.nan
    normal = np.tile([0.0, 0.0, -1.0], (6, 9, 1))
    found = integrate_normals(ray, normal, 1.0, 0.03, np.array([[2, 1]]), np.array([1000.0]), 0.2)
    np.testing.assert_allclose(found[:, :4], 1000.0)
    assert np.isnan(found[:, 4:]).all()


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.4), (1.2, 0.6)])
def test_a_shifted_picture_is_found_to_a_twentieth_of_a_cell(shift):
    row, col = np.mgrid[:60, :60].astype(float)

    def picture(r, c):
        return np.sin(r / 2.3) * np.cos(c / 3.1 + 0.2 * r) + 0.5 * np.sin(0.9 * c - 0.4 * r)

    cell = np.stack(np.meshgrid(np.arange(15, 46, 5), np.arange(15, 46, 5)), -1).reshape(-1, 2)
    template, image = picture(row, col), 3.0 + 2.0 * picture(row - shift[0], col - shift[1])
    found, good = correlation_shifts(template, image, cell, 17, 2, 0.6)
    assert good.all()
    assert np.abs(found - shift).max() < 0.05


def test_spc_recovers_an_exactly_known_scene(problem):
    outcome = run_spc(problem, SpcOptions(poses="fixed"))
    height, normal, albedo = errors(outcome.scene, problem.scene)
    assert height < 0.06
    assert normal < 0.6
    assert albedo < 0.6


def test_each_iteration_lowers_the_residual_and_the_first_surface_is_left_behind(problem):
    history = np.array(run_spc(problem, SpcOptions(poses="fixed")).history)
    assert (np.diff(history) < 0).all()
    assert history[-1] < 0.5 * history[0]


def test_pointing_errors_are_found_from_the_shifts(problem):
    rng = np.random.default_rng(3)
    pose = problem.scene.views.body_from_cam
    turn = 0.4 / FOCAL_PX * rng.normal(size=(len(pose), 3)) * (1, 1, 0)
    turn[problem.scene.reference] = 0.0
    wrong = Rigid(pose.rotation @ so3_exp(turn), pose.translation)
    views = replace(problem.scene.views, body_from_cam=wrong)
    outcome = run_spc(replace(problem, scene=replace(problem.scene, views=views)))

    def off_px(found):
        points = problem.scene.landmarks.position
        return [np.abs(found.project(k, points) - problem.scene.views.project(k, points)).mean() for k in range(8)]

    assert np.mean(off_px(outcome.scene.views)) < 0.25 * np.mean(off_px(views))
    assert errors(outcome.scene, problem.scene)[1] < 1.0


def test_views_are_predicted_with_the_maps_own_light(problem):
    held = problem.scene.views[[3]]
    used = [k for k in range(8) if k != 3]
    tracks = problem.scene.tracks
    kept = tracks.view != 3
    number = np.array([0, 1, 2, -1, 3, 4, 5, 6], np.int32)
    fewer = replace(
        problem.scene,
        views=problem.scene.views[used],
        tracks=replace(
            tracks,
            start=np.arange(0, 7 * SIZE**2 + 1, 7, dtype=np.int64),
            view=number[tracks.view[kept]],
            **{name: getattr(tracks, name)[kept] for name in ("keypoint", "keypoint_sigma", "brightness", "lit")},
        ),
    )
    images = [problem.images[k] for k in (*used, 3)]
    outcome = run_spc(Problem(scene=fewer, images=images, held_out=held), SpcOptions(poses="fixed"))
    there = outcome.covered[-1]
    error = (outcome.rendered[-1] - images[-1].brightness)[there]
    assert np.sqrt(np.mean(error**2)) < 0.02 * images[-1].brightness[there].mean()
