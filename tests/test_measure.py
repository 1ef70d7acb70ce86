"""Distances, slopes and volumes of shapes whose answers are known, and sigmas by numerical derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest

import photoclinometry as pcm
from jacobians import numerical_jacobian
from measured_maps import SIZE, flat, map_of_heights, outline_of, pixel_of
from photoclinometry.model.errors import InputError
from photoclinometry.surface.measure import Measured, distance, height_difference, landmark_at, slope, volume
from photoclinometry.surface.relief import local_frame


def test_of_a_plane_distances_are_those_of_the_grid():
    scene = map_of_heights(flat())
    a, b = pixel_of(scene, 2, 3), pixel_of(scene, 6, 6)
    found = distance(scene, a, b)
    assert found.value == pytest.approx(10.0)
    assert found.sigma == pytest.approx(0.01 * math.sqrt(2.0))
    assert found.unit == "m"
    assert height_difference(scene, a, b).value == pytest.approx(0.0, abs=1e-9)
    assert slope(scene, a, b).value == pytest.approx(0.0, abs=1e-9)


def test_a_step_up_has_its_height_and_slope():
    height = flat()
    height[10, 10], height[10, 12] = 1.5, -1.5
    scene = map_of_heights(height)
    a, b = pixel_of(scene, 10, 12), pixel_of(scene, 10, 10)
    assert height_difference(scene, a, b).value == pytest.approx(3.0, rel=1e-3)
    found = slope(scene, a, b)
    assert found.value == pytest.approx(math.degrees(math.atan2(3.0, 4.0)), rel=1e-3)
    assert found.sigma == pytest.approx(math.degrees(0.01 * math.sqrt(2.0) / 5.0), rel=1e-3)
    assert slope(scene, b, a).value == pytest.approx(-found.value)


def test_a_pyramid_on_a_tilted_plane_has_the_volume_of_a_pyramid():
    """Base 12 x 12 m, height 3 m: 144 m^3; upside down the opposite.

    Squares of the grid are cut along one diagonal. Two of the ridges run across it, three squares each, and lose a
    sixth of the square (4 m^2) times the height of a step (1 m).
    """
    row, col = np.indices((SIZE, SIZE)) - 10
    tent = 3.0 * np.maximum(1.0 - np.maximum(np.abs(row), np.abs(col)) / 3.0, 0.0)
    for sign in (1.0, -1.0):
        scene = map_of_heights(sign * tent + 0.1 * col)
        found = volume(scene, outline_of(scene, 6, 14))
        assert found.value == pytest.approx(sign * (144.0 - 6 * 4.0 / 6.0), rel=0.005)
        assert found.unit == "m^3"


def test_the_sigma_of_a_volume_is_that_of_numerical_derivatives():
    row, col = np.indices((SIZE, SIZE)) - 10
    scene = map_of_heights(2.0 * np.exp(-(row**2 + col**2) / 18.0) + 0.2 * col + 0.01 * row * col)
    outline = outline_of(scene, 8, 12)
    frame = local_frame(scene)
    inside = np.flatnonzero(((row >= -2) & (row <= 2) & (col >= -2) & (col <= 2))[scene.cells])

    def moved(step):
        position = scene.landmarks.position.copy()
        position[inside] += step.reshape(-1, 3) @ frame.rotation.T
        return np.array([volume(replace(scene, landmarks=replace(scene.landmarks, position=position)), outline).value])

    gradient = numerical_jacobian(moved, 3 * len(inside), np.full(3 * len(inside), 1e-4))[0]
    assert volume(scene, outline).sigma == pytest.approx(0.01 * np.linalg.norm(gradient), rel=0.05)


def test_without_a_unit_lengths_are_in_gsd():
    scene = map_of_heights(flat(), frame="own")
    a, b = pixel_of(scene, 2, 3), pixel_of(scene, 6, 6)
    found = distance(scene, a, b)
    assert found.unit == "GSD"
    assert found.value == pytest.approx(10.0 / scene.gsd)
    assert volume(scene, outline_of(scene, 4, 12)).unit == "GSD^3"


def test_results_are_written_to_the_digits_that_are_known():
    assert str(Measured(value=1234.5678, sigma=0.0123, unit="m")) == "1234.568 +- 0.012 m"
    assert str(Measured(value=1234.5678, sigma=123.0, unit="m")) == "1235 +- 123 m"
    assert str(Measured(value=1.0, sigma=math.inf, unit="m")) == "1.000 +- inf m"


def test_places_outside_the_map_and_outlines_that_are_too_small_are_refused():
    scene = map_of_heights(flat())
    assert landmark_at(scene, pixel_of(scene, 0, 0)) == np.flatnonzero((np.stack(scene.cells) == 0).all(0))[0]
    with pytest.raises(InputError, match="no landmark at pixel"):
        landmark_at(scene, (0.0, 0.0))
    a = pixel_of(scene, 3, 3)
    with pytest.raises(InputError, match="one landmark"):
        distance(scene, a, a)
    with pytest.raises(InputError, match="draw a larger one"):
        volume(scene, outline_of(scene, 3, 4))
    with pytest.raises(InputError, match="three at least"):
        volume(scene, np.zeros((2, 2)))
    kept = np.flatnonzero(~((scene.cells[0] == 10) & (scene.cells[1] == 10)))
    holed = replace(
        scene, landmarks=scene.landmarks[kept], uncertainty={"position": scene.uncertainty["position"][kept]}
    )
    with pytest.raises(InputError, match="without landmarks"):
        volume(holed, outline_of(scene, 6, 14))


def test_the_package_offers_them():
    scene = map_of_heights(flat())
    a, b = pixel_of(scene, 2, 3), pixel_of(scene, 6, 6)
    corners = outline_of(scene, 4, 12)
    assert pcm.distance(scene, a, b) == distance(scene, a, b)
    assert pcm.height_difference(scene, a, b) == height_difference(scene, a, b)
    assert pcm.slope(scene, a, b) == slope(scene, a, b)
    assert pcm.volume(scene, corners.tolist()) == volume(scene, corners)
