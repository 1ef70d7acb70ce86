"""Sigmas allow for what two estimates disagree on: variances times one and the mean square of the moves."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.geometry import sphere_step
from photoclinometry.pipeline.checks.widened_sigmas import normalized_changes, with_inflated_uncertainties
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.surface.relief import local_frame
from scenes import synthetic_scene
from truths import TURNED_FRAME

ANGLE = 1e-3


@pytest.fixture(scope="module")
def scene():
    """Heights known to a tenth of a GSD, normals and Suns to 1e-3 rad, albedos to 0.002, biases to 0.001."""
    found = synthetic_scene(size=20, views=6)
    count, up = len(found.landmarks), local_frame(found).rotation[:, 2]
    position = (0.1 * found.gsd) ** 2 * (1e-6 * np.eye(3) + np.outer(up, up))
    return replace(found, uncertainty={
        "position": np.tile(position, (count, 1, 1)),
        "normal": np.tile(ANGLE**2 * np.eye(2), (count, 1, 1)),
        "albedo": np.full(count, 0.002),
        "sun": np.tile(ANGLE**2 * np.eye(2), (6, 1, 1)),
        "bias": np.full(6, 0.001),
    })  # fmt: skip


@pytest.fixture(scope="module")
def signs(scene):
    """(J,) of a checkerboard, which no rotation of the map takes off."""
    row, col = scene.cells
    return np.where((row + col) % 2, 1.0, -1.0)


def before(scene, signs, times):
    """Another estimate: each landmark `times` its sigmas higher or lower, and so on for all that is stated."""
    landmarks, views, up = scene.landmarks, scene.views, local_frame(scene).rotation[:, 2]
    step = times * signs[:, None]
    alternate = np.resize([1.0, -1.0], 6)
    return replace(
        scene,
        landmarks=replace(
            landmarks,
            position=landmarks.position + 0.1 * scene.gsd * step * up,
            normal=sphere_step(landmarks.normal, ANGLE * step * np.ones(2)),
            albedo=landmarks.albedo + 0.002 * times * signs,
        ),
        views=replace(
            views,
            sun=sphere_step(views.sun, ANGLE * times * alternate[:, None] * np.ones(2)),
            bias=views.bias + 0.001 * times * alternate,
        ),
    )


def test_moves_of_two_sigmas_make_variances_five_times_larger(scene, signs):
    """But for what a similarity and a common factor of albedos take of the moves."""
    everywhere = np.ones(len(scene.landmarks), bool)
    found = with_inflated_uncertainties(scene, before(scene, signs, 2.0), everywhere).uncertainty
    for name, stated in scene.uncertainty.items():
        factor = np.sqrt(5.0) if stated.ndim == 1 else 5.0
        np.testing.assert_allclose(found[name], factor * stated, rtol=0.05, err_msg=name)


def test_estimates_that_agree_change_nothing_in_whatever_frame(scene, signs):
    everywhere = np.ones(len(scene.landmarks), bool)
    same = with_inflated_uncertainties(scene, transform_scene(TURNED_FRAME, scene), everywhere).uncertainty
    for name, stated in scene.uncertainty.items():
        np.testing.assert_allclose(same[name], stated, rtol=1e-6, err_msg=name)


def test_landmarks_that_do_not_tell_are_widened_by_what_the_others_say(scene, signs):
    """Two neighbours that were put back are 100 GSD away, or as bright as nothing is."""
    other, sound = before(scene, signs, 1.0), np.ones(len(scene.landmarks), bool)
    sound[[6, 7]] = False
    position = other.landmarks.position.copy()
    position[[6, 7]] += 100.0 * scene.gsd * local_frame(scene).rotation[:, 2]
    astray = replace(other, landmarks=replace(other.landmarks, position=position))
    assert normalized_changes(scene, astray, sound)["normal"] == pytest.approx(1.0, rel=0.05)
    far = replace(other, landmarks=replace(other.landmarks, albedo=np.where(sound, other.landmarks.albedo, 9.0)))
    assert normalized_changes(scene, far, sound)["albedo"] == pytest.approx(1.0, rel=0.05)


def test_what_states_nothing_stays_as_it_is(scene, signs):
    silent = replace(scene, uncertainty={})
    assert (
        with_inflated_uncertainties(silent, before(scene, signs, 1.0), np.ones(len(scene.landmarks), bool)).uncertainty
        == {}
    )
