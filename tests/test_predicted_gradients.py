"""Gradients of predicted brightness: those of exact images, without the noise of one image."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.photometry.predicted_gradients import predicted_gradient, with_predicted_gradients
from photoclinometry.photometry.shading import normals_from_shading, seen_on_surface
from scenes import synthetic_images, synthetic_scene, thinned, with_landmarks


@pytest.mark.parametrize("view", [0, 3])
def test_they_are_those_of_exact_images(view):
    """By differences of the map; of the images by splines between pixels."""
    scene = synthetic_scene(size=24)
    of_image = seen_on_surface(scene, synthetic_images(scene)).gradient[scene.tracks.view == view]
    found = predicted_gradient(scene, view)
    inside = np.isfinite(found).all(-1)
    assert inside.sum() == 22 * 22
    size = np.sqrt(np.mean(of_image[inside] ** 2))
    assert np.sqrt(np.mean((found - of_image)[inside] ** 2)) < 0.03 * size


def test_of_a_map_from_noisy_images_they_err_less_than_the_images_own():
    scene = synthetic_scene(size=24, views=12)
    exact, rng = synthetic_images(scene), np.random.default_rng(1)
    noise = 0.02 * scene.tracks.brightness.mean()
    noisy = [replace(i, brightness=i.brightness + noise * rng.normal(size=i.brightness.shape)) for i in exact]
    true = seen_on_surface(scene, exact).gradient
    measured, _, own = seen_on_surface(scene, noisy)
    found = with_predicted_gradients(normals_from_shading(measured), own)
    inside = np.isfinite(predicted_gradient(scene, 0)).all(-1)[scene.tracks.landmark]
    err, err_own = (np.sqrt(np.mean((each - true)[inside] ** 2)) for each in (found, own))
    # Of twelve brightnesses a landmark's normal and albedo take up three.
    assert err < 0.7 * err_own


def test_where_a_neighbour_lacks_the_images_are_kept():
    scene = synthetic_scene(size=12)
    middle = scene.grid(np.arange(len(scene.landmarks)))[6, 6]
    holed = with_landmarks(scene, np.arange(len(scene.landmarks)) != middle)
    given = np.full((len(holed.tracks), 2), 7.0)
    found = with_predicted_gradients(holed, given)
    kept = np.zeros((12, 12), bool)
    kept[[0, -1], :] = kept[:, [0, -1]] = True
    kept[[5, 7, 6, 6], [6, 6, 5, 7]] = True
    np.testing.assert_array_equal((found == 7.0).all(-1), kept[holed.cells][holed.tracks.landmark])


def test_maps_of_a_larger_stride_keep_the_images():
    scene = thinned(synthetic_scene(size=12), 2)
    given = np.full((len(scene.tracks), 2), 7.0)
    assert with_predicted_gradients(scene, given) is given
