"""Predictions for a scene's observations, against the plain statements of projection and reflectance."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.model.projection import (
    keypoint_residuals,
)
from photoclinometry.model.reflectance import photometric_angles, published
from photoclinometry.photometry.predict import (
    observation_brightness,
    phase_of_views,
    shading,
)
from scenes import synthetic_scene


def test_keypoint_residuals_are_projections_minus_keypoints():
    scene = synthetic_scene(size=8, keypoint_noise_px=0.5)
    tracks, residual = scene.tracks, keypoint_residuals(scene)
    for n in range(0, len(tracks), 7):
        predicted = scene.views.project(tracks.view[n], scene.landmarks.position[tracks.landmark[n]])
        np.testing.assert_allclose(residual[n], predicted - tracks.keypoint[n], atol=1e-9)


def test_shading_is_that_of_the_photometric_angles():
    scene = synthetic_scene(size=8)
    view, landmark = scene.tracks.view, scene.tracks.landmark
    position, normal = scene.landmarks.position, scene.landmarks.normal
    mu0, mu, rho = shading(landmark, view, scene.views, position, normal, scene.reflectance)
    center = scene.views.body_from_cam.translation
    expected = photometric_angles(scene.views.sun[view], center[view], position[landmark], normal[landmark])
    np.testing.assert_allclose(mu0, expected[0], rtol=1e-12)
    np.testing.assert_allclose(mu, expected[1], rtol=1e-12)
    np.testing.assert_allclose(rho, scene.reflectance(*expected), rtol=1e-12)


@pytest.mark.parametrize("model", ["lunar-lambert", "mcewen"])
def test_predicted_brightness_is_the_measured_one_of_an_exact_scene(model):
    """Eqs. 29 (calibrated) and 30 (scale and bias)."""
    exact = synthetic_scene(size=8, reflectance=published(model, "vesta"))
    np.testing.assert_allclose(observation_brightness(exact), exact.tracks.brightness, rtol=1e-12)


def test_geometry_alone_predicts_no_brightness():
    with pytest.raises(InputError, match="geometry alone"):
        observation_brightness(replace(synthetic_scene(size=8), reflectance=None))


def test_the_phase_of_a_view_is_that_in_the_middle_of_its_map():
    scene = synthetic_scene(size=8)
    middle, center = np.median(scene.landmarks.position, axis=0), scene.views.body_from_cam.translation
    expected = photometric_angles(scene.views.sun, center, np.broadcast_to(middle, center.shape), np.array([0, 0, 1.0]))
    np.testing.assert_allclose(phase_of_views(scene), expected[2], rtol=1e-12)
    assert np.ptp(np.degrees(phase_of_views(scene))) > 5.0
