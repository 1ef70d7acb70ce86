"""From a mesh to a grid: what is exact stays exact, gaps stay gaps, and of two layers the upper is seen."""

import numpy as np
import pytest

from photoclinometry.model.errors import InputError
from photoclinometry.output.export.grid import MAX_PIXELS, grid_around, resample, resample_heights


def net(seed: int = 0, count: int = 400):
    """Scattered points (J, 2) of a square of 20 with its corners, and their triangles."""
    from scipy.spatial import Delaunay

    xy = np.random.default_rng(seed).uniform(0.0, 20.0, (count, 2))
    xy = np.concatenate([xy, [[0, 0], [20, 0], [0, 20], [20, 20]]])
    return xy + (1e5, -3e4), Delaunay(xy).simplices


def test_a_grid_is_north_up_and_lies_on_whole_pixels():
    grid = grid_around(np.array([[10.2, -3.0], [15.9, 4.1]]), 2.0)
    assert (grid.corner, grid.shape) == ((10.0, 6.0), (5, 3))
    np.testing.assert_array_equal(grid.pixel_centers()[0, 0], [11.0, 5.0])
    np.testing.assert_array_equal(grid.pixel_centers()[-1, -1], [15.0, -3.0])
    np.testing.assert_array_equal(grid.pixel_from_map(grid.pixel_centers())[3, 1], [1.5, 3.5])


def test_linear_values_are_exact():
    xy, faces = net()
    grid = grid_around(xy, 0.37)
    values = np.stack([3.0 + 2.0 * xy[:, 0] - xy[:, 1], np.ones(len(xy))], -1)
    image, valid = resample(grid, np.c_[xy, 0 * xy[:, 0]], values, faces)
    x, y = np.moveaxis(grid.pixel_centers(), -1, 0)
    np.testing.assert_allclose(image[valid], np.stack([3.0 + 2.0 * x - y, 1.0 + 0 * x], -1)[valid], rtol=1e-9)
    low, high = xy.min(0), xy.max(0)
    inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
    np.testing.assert_array_equal(valid, inside)


def test_heights_of_quadratic_ground_are_exact_where_linear_ones_are_not():
    xy, faces = net()
    center = xy.mean(0)

    def ground(at):
        x, y = np.moveaxis(at - center, -1, 0)
        return 5.0 + 0.3 * x - 0.02 * x * x + 0.05 * x * y + 0.03 * y * y

    x, y = (xy - center).T
    slope = np.stack([0.3 - 0.04 * x + 0.05 * y, 0.05 * x + 0.06 * y], -1)
    place, grid = np.c_[xy, ground(xy)], grid_around(xy, 0.37)
    found, valid = resample_heights(grid, place, slope, faces)
    true = ground(grid.pixel_centers())
    np.testing.assert_allclose(found[valid], true[valid], atol=1e-7)
    flat, _ = resample(grid, place, place[:, 2:], faces)
    assert np.abs(flat[..., 0] - true)[valid].max() > 0.01


def test_the_agreement_with_another_programs_interpolation_is_pixel_by_pixel():
    from matplotlib.tri import LinearTriInterpolator, Triangulation

    xy, faces = net(1)
    faces = faces[np.random.default_rng(2).random(len(faces)) > 0.1]  # with holes
    value, grid = np.random.default_rng(3).normal(size=len(xy)), grid_around(xy, 0.173)
    image, valid = resample(grid, np.c_[xy, value], value[:, None], faces)
    other = LinearTriInterpolator(Triangulation(*(xy - xy[0]).T, faces), value)
    expected = other(*np.moveaxis(grid.pixel_centers() - xy[0], -1, 0))
    np.testing.assert_array_equal(valid, ~np.ma.getmaskarray(expected))
    assert 0.05 < (~valid).mean() < 0.5
    np.testing.assert_allclose(image[valid, 0], expected.data[valid], atol=1e-8)


def test_of_ground_over_ground_the_upper_is_on_the_map():
    square = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    place = np.concatenate([np.c_[square, np.zeros(3)], np.c_[square + 1.1, np.full(3, 5.0)]])
    grid = grid_around(place[:, :2], 0.5)
    for faces in ([[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]]):
        image, valid = resample(grid, place, place[:, 2:], np.array(faces))
        x, y = np.moveaxis(grid.pixel_centers(), -1, 0)
        upper = (x > 1.1) & (y > 1.1) & (x + y < 12.2)
        np.testing.assert_allclose(image[upper], 5.0)
        np.testing.assert_allclose(image[valid & ~upper], 0.0)


@pytest.mark.parametrize("pixel", [0.0, -1.0, float("nan"), float("inf")])
def test_pixels_without_a_size_are_refused(pixel):
    with pytest.raises(InputError, match="--resolution"):
        grid_around(np.zeros((2, 2)), pixel)


def test_far_too_many_pixels_are_refused_before_they_are_made():
    with pytest.raises(InputError, match=f"{MAX_PIXELS:,} are the limit"):
        grid_around(np.array([[0.0, 0.0], [1e6, 1e6]]), 1e-3)
