"""Reference pixels for landmarks: distinct where there is room, shared where there is none."""

import numpy as np
import pytest

from photoclinometry.model.camera import Camera
from photoclinometry.model.errors import InputError
from photoclinometry.model.reference_pixels import pixels_of_landmarks

CAMERA = Camera("PINHOLE", 40, 30, (1e3, 1e3, 20.0, 15.0))


def test_landmarks_in_the_middle_of_pixels_get_those_pixels():
    rows, cols = np.divmod(np.random.default_rng(0).permutation(40 * 30)[:500], 40)
    pixel, region = pixels_of_landmarks(np.stack([cols, rows], -1) + 0.5, CAMERA)
    np.testing.assert_array_equal(pixel, np.stack([rows, cols], -1))
    assert (region.row, region.col) == (rows.min(), cols.min())
    assert (region.height, region.width) == (np.ptp(rows) + 1, np.ptp(cols) + 1)


def test_of_landmarks_in_one_pixel_the_nearest_to_its_centre_stays():
    xy = np.array([[5.9, 7.5], [5.6, 7.5], [5.5, 7.1], [7.0, 20.5]])
    assert pixels_of_landmarks(xy, CAMERA)[0].tolist() == [[7, 6], [7, 5], [6, 5], [20, 7]]


def test_all_landmarks_find_a_pixel_where_there_is_room():
    """A turned grid, noisy and 1.1 pixels wide: its cells do not fit the pixels, but the pixels suffice."""
    grid = np.stack(np.meshgrid(np.arange(20), np.arange(20)), -1).reshape(-1, 2) * 1.1
    grid += np.random.default_rng(0).normal(scale=0.3, size=grid.shape)
    angle = np.radians(20)
    xy = grid @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) + 5
    xy[:, 0] += 5
    pixel, region = pixels_of_landmarks(xy, CAMERA)
    assert len(np.unique(np.floor(xy), axis=0)) < 350
    assert len(np.unique(pixel, axis=0)) > 390
    assert np.abs(pixel[:, ::-1] + 0.5 - xy).max() <= 1.5
    inside = (pixel >= (region.row, region.col)) & (pixel < (region.row + region.height, region.col + region.width))
    assert inside.all()


def test_of_ten_landmarks_in_one_pixel_one_shares_its_pixel():
    pixel, _ = pixels_of_landmarks(np.full((10, 2), 9.5), CAMERA)
    places, count = np.unique(pixel, axis=0, return_counts=True)
    assert (len(places), count.max()) == (9, 2)
    assert places[np.argmax(count)].tolist() == [9, 9]


@pytest.mark.parametrize("xy", [(-41.0, 5.0), (5.0, 61.0), (np.inf, 0.0), (np.nan, 0.0)])
def test_landmarks_far_outside_of_the_reference_are_refused(xy):
    with pytest.raises(InputError, match="1 of 2 landmarks lie far outside"):
        pixels_of_landmarks(np.array([[5.0, 5.0], xy]), CAMERA)
