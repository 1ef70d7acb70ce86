"""Stated uncertainties as numbers: lengths of errors by hand, in GSD, degrees and per cent."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.evaluate import evaluate_scene, view_table
from photoclinometry.evaluate.sigmas import landmark_sigmas, view_sigmas
from photoclinometry.model.errors import InputError
from photoclinometry.model.sigma import sigma_along, sigma_of_length
from photoclinometry.surface.relief import local_frame
from scenes import synthetic_scene


def test_sigmas_along_a_direction_by_hand():
    direction = np.array([[0.6, 0.8, 0.0]])
    assert sigma_along(np.array([2.0]), direction) == [2.0]
    assert sigma_along(np.array([[3.0, 4.0, 9.0]]), direction) == pytest.approx(np.hypot(1.8, 3.2))
    correlated = np.array([[[9.0, 12.0, 0.0], [12.0, 16.0, 0.0], [0.0, 0.0, 1.0]]])
    assert sigma_along(correlated, direction) == pytest.approx(0.6 * 3.0 + 0.8 * 4.0)
    assert sigma_along(correlated, direction[0]) == sigma_along(correlated, direction)


def test_sigmas_of_a_length_are_the_root_of_the_trace_whatever_is_stated():
    """Sigmas 3 and 4 along two axes: 5; as a covariance, turned or not, the same; 2 along each of three: 2 root 3."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = turn @ np.diag([9.0, 16.0]) @ turn.T
    assert sigma_of_length(covariance[None], 2) == pytest.approx([5.0])
    assert sigma_of_length(np.array([[3.0, 4.0]]), 2) == pytest.approx([5.0])
    assert sigma_of_length(np.array([2.0]), 3) == pytest.approx([2.0 * np.sqrt(3.0)])


@pytest.mark.parametrize("shape", [(3, 2), (2, 3), (3, 3, 2), (4,), ()])
def test_uncertainties_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match="uncertainty has shape"):
        sigma_along(np.ones(shape), np.ones((3, 3)))


@pytest.mark.parametrize("shape", [(3, 2), (3, 3, 2), ()])
def test_uncertainties_over_other_axes_are_refused(shape):
    with pytest.raises(InputError, match="of 3 numbers"):
        sigma_of_length(np.ones(shape), 3)


@pytest.fixture(scope="module")
def stated():
    """Position 1 GSD across and 2 GSD up, normals 0.1 degrees about each axis, albedo 0.003, camera centres 3 GSD."""
    scene = synthetic_scene(size=12, views=4)
    count, up = len(scene.landmarks), local_frame(scene).rotation[:, 2]
    position = scene.gsd**2 * (np.eye(3) + 3.0 * np.outer(up, up))
    uncertainty = {
        "position": np.tile(position, (count, 1, 1)),
        "normal": np.tile(np.radians(0.1) ** 2 * np.eye(2), (count, 1, 1)),
        "albedo": np.full(count, 0.003),
        "center": np.tile((3.0 * scene.gsd) ** 2 / 3.0 * np.eye(3), (4, 1, 1)),
        "scale": np.full(4, 0.01),
    }
    return replace(scene, uncertainty=uncertainty)


def test_landmarks_and_views_in_the_units_of_their_names(stated):
    found = landmark_sigmas(stated)
    np.testing.assert_allclose(found["position_sigma_gsd"], np.sqrt(6.0))
    np.testing.assert_allclose(found["height_sigma_gsd"], 2.0)
    np.testing.assert_allclose(found["normal_sigma_deg"], 0.1 * np.sqrt(2.0))
    np.testing.assert_allclose(found["albedo_sigma_percent"], 0.3 / stated.landmarks.albedo)
    views = view_sigmas(stated)
    np.testing.assert_allclose(views["center_sigma_gsd"], 3.0)
    np.testing.assert_allclose(views["scale_sigma_percent"], 1.0)
    assert set(views) == {"center_sigma_gsd", "scale_sigma_percent"}


def test_tables_and_figures_state_them(stated):
    assert evaluate_scene(stated)["height_sigma_rms_gsd"] == pytest.approx(2.0)
    assert [row["center_sigma_gsd"] for row in view_table(stated)] == pytest.approx([3.0] * 4)
    assert not any("sigma" in key for key in evaluate_scene(replace(stated, uncertainty={})))
