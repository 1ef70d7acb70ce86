"""Stated uncertainties as numbers: lengths of errors by hand, in GSD, degrees and per cent."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.evaluate import evaluate_scene, view_table
from photoclinometry.evaluate.sigmas import landmark_sigmas, size, view_sigmas
from photoclinometry.surface.relief import local_frame
from scenes import synthetic_scene


def test_size_is_the_root_of_the_trace_whatever_is_stated():
    """Sigmas 3 and 4 along two axes: 5; as a covariance, turned or not, the same."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = turn @ np.diag([9.0, 16.0]) @ turn.T
    assert size(covariance[None]) == pytest.approx([5.0])
    assert size(np.array([[3.0, 4.0]])) == pytest.approx([5.0])
    assert size(np.array([2.0])) == pytest.approx([2.0])


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
