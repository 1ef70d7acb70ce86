"""The finest relief, restored from what pixels, point-spread function and the estimate's differences leave of it."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust import AdjustOptions
from photoclinometry.adjust.graph.smoothness import Smoothness
from photoclinometry.adjust.graph.variables import Estimate
from photoclinometry.adjust.groups import NEAREST_NEIGHBOUR, neighbour_pairs
from photoclinometry.model.geometry import unit
from photoclinometry.model.projection import projected_keypoints
from photoclinometry.surface.fine_relief import DIFFERENCES, ITERATIONS, blur, with_fine_relief
from scenes import synthetic_scene

PSF_PX = 0.5


def with_depths(scene, depth):
    """The scene with its landmarks at depths (h, w), on their rays of the reference view."""
    view, camera = scene.views.body_from_cam[scene.reference], scene.views.cameras[scene.reference]
    ray = camera.ray_in_cam(scene.landmarks.pixel[:, ::-1] + 0.5)
    position = view(ray * depth[scene.cells][:, None])
    return replace(scene, landmarks=replace(scene.landmarks, position=position))


def depths(scene):
    view = scene.views.body_from_cam[scene.reference].inverse()
    return scene.grid(view(scene.landmarks.position)[:, 2])


@pytest.fixture(scope="module")
def plain():
    return replace(synthetic_scene(size=50, views=4), uncertainty={})


def test_sloping_ground_stays_as_it_is_to_its_edges(plain):
    row, col = np.mgrid[:50, :50]
    sloping = with_depths(plain, 1000.0 + 0.8 * col - 0.3 * row)
    found = with_fine_relief(sloping, PSF_PX)
    np.testing.assert_allclose(depths(found), depths(sloping), atol=1e-3)


@pytest.mark.parametrize("length_px", [4.0, 7.0])
def test_a_wave_gets_back_what_the_blur_took_but_for_the_part_that_iterations_leave(plain, length_px):
    row, _ = np.mgrid[:50, :50]
    share = np.exp(-2.0 * (np.pi * blur(1, PSF_PX) / length_px) ** 2)
    wave = np.sin(2 * np.pi * row / length_px)
    found = depths(with_fine_relief(with_depths(plain, 1000.0 + 0.1 * share * wave), PSF_PX)) - 1000.0
    inner = np.s_[12:38, 12:38]
    expected = 0.1 * (1.0 - (1.0 - share) ** (ITERATIONS + 1)) * wave
    np.testing.assert_allclose(found[inner], expected[inner], atol=1e-3)


def test_landmarks_stay_on_their_rays_of_the_reference_view_and_all_else_stays(plain):
    rough = with_depths(plain, 1000.0 + 0.1 * np.random.default_rng(0).standard_normal((50, 50)))
    found, of_reference = with_fine_relief(rough, PSF_PX), rough.tracks.view == rough.reference
    assert np.ptp(depths(found) - depths(rough)) > 0.05
    before, after = projected_keypoints(rough)[of_reference], projected_keypoints(found)[of_reference]
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert found.landmarks.normal is rough.landmarks.normal
    assert found.landmarks.albedo is rough.landmarks.albedo
    assert found.uncertainty == {}


def test_positions_are_uncertain_by_what_was_restored_nearby_along_the_ray(plain):
    row, _ = np.mgrid[:50, :50]
    rough = with_depths(plain, 1000.0 + 0.1 * np.sin(2 * np.pi * row / 4.0))
    own = np.tile(1e-4 * np.eye(3), (len(rough.landmarks), 1, 1))
    found = with_fine_relief(replace(rough, uncertainty={"position": own, "rotation": np.ones(4)}), PSF_PX)
    np.testing.assert_array_equal(found.uncertainty["rotation"], np.ones(4))
    ray = unit(rough.landmarks.position - rough.views.body_from_cam[rough.reference].translation)
    more = found.uncertainty["position"] - own
    along = np.einsum("ni,nij,nj->n", ray, more, ray)
    np.testing.assert_allclose(np.trace(more, axis1=1, axis2=2), along, rtol=1e-9)
    inner = (rough.cells[0] > 14) & (rough.cells[0] < 35) & (rough.cells[1] > 14) & (rough.cells[1] < 35)
    moved = np.linalg.norm(found.landmarks.position - rough.landmarks.position, axis=-1)
    assert np.mean(along[inner]) == pytest.approx(np.mean(moved[inner] ** 2), rel=0.02)
    assert along.min() > 0.2 * np.mean(moved[inner] ** 2)
    middle = (rough.cells[0] > 14) & (rough.cells[0] < 35)
    edge = np.mean(along[middle & (rough.cells[1] == 0)])
    assert edge == pytest.approx(2.0 * np.mean(along[inner]), rel=0.25), "as much is missing where nothing is restored"


def test_nothing_is_restored_beside_a_hole(plain):
    rough = with_depths(plain, 1000.0 + 0.1 * np.random.default_rng(1).standard_normal((50, 50)))
    kept = np.flatnonzero(~((np.abs(rough.cells[0] - 25) < 3) & (np.abs(rough.cells[1] - 25) < 3)))
    tracks, _ = rough.tracks.of_landmarks(kept)
    holed = replace(rough, landmarks=rough.landmarks[kept], tracks=tracks)
    change = depths(with_fine_relief(holed, PSF_PX)) - depths(holed)
    assert np.nanmax(np.abs(change[22:29, 22:29])) == 0.0
    assert np.nanmin(np.abs(change[10, 10:40])) > 0.0


def test_of_coarser_maps_pixels_blur_less_of_a_landmark_and_the_smoothing_to_the_grid_counts():
    assert blur(1, 0.5) == pytest.approx(np.sqrt(1 / 8 + 1 / 12 + 0.25))
    assert blur(2, 0.5) == pytest.approx(np.sqrt(1 / 8 + (1 / 12 + 0.25 + 0.75) / 4))


@pytest.mark.parametrize("direction", [(1, 0), (1, 1)])
def test_heights_that_fit_slopes_by_smoothness_lack_what_the_gaussian_takes(direction):
    """Least squares of the smoothness factors alone, for the heights, of ground whose normals are those of a wave."""
    size, length = 33, 8.0
    x, y = np.meshgrid(np.arange(size, dtype=float), np.arange(size, dtype=float))
    k = 2 * np.pi / length * unit(np.array(direction, float))
    phase, height = k[0] * x + k[1] * y, 1e-3
    slope = height * np.cos(phase)
    normal = unit(np.stack([-k[0] * slope, -k[1] * slope, np.ones_like(x)], -1)).reshape(-1, 3)
    flat = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
    scene = synthetic_scene(size=size, views=4)
    landmarks = replace(scene.landmarks, position=flat, normal=normal)
    pairs = neighbour_pairs(flat, len(flat), AdjustOptions().smooth_neighbours, NEAREST_NEIGHBOUR)
    rows = Smoothness(pairs, sigma=1.0).linearize(Estimate(scene.views, landmarks, np.zeros(3)), np.float64)
    number = np.arange(len(rows.residual))
    jacobian = np.zeros((len(number), size * size))
    jacobian[number, pairs.target] += rows.rows[:, 2]
    jacobian[number, pairs.source] -= rows.rows[:, 2]
    found = -np.linalg.lstsq(jacobian, rows.residual, rcond=None)[0].reshape(size, size)
    inner = np.s_[10:23, 10:23]
    wave = np.sin(phase)[inner].ravel()
    design = np.stack([wave, np.ones_like(wave)], -1)
    gain = np.linalg.lstsq(design, found[inner].ravel(), rcond=None)[0][0] / height
    assert gain == pytest.approx(np.exp(-2.0 * DIFFERENCES * (np.pi / length) ** 2), abs=0.025)
