"""Planes through neighbouring points, and which points are neighbours: known answers."""

import numpy as np
import pytest

from photoclinometry.model.geometry import angle_between, unit
from photoclinometry.surface.neighbours import neighbours, normals_from_neighbours


def test_normals_of_a_tilted_plane_are_exact_and_face_the_camera():
    rng = np.random.default_rng(0)
    normal = unit(np.array([0.3, -0.2, 1.0]))
    xy = rng.uniform(-50, 50, (500, 2))
    points = np.column_stack([xy, -(xy @ normal[:2]) / normal[2]])
    for camera, expected in ((1e4 * normal, normal), (-1e4 * normal, -normal)):
        found = normals_from_neighbours(points, camera)
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-9)


def test_normals_of_a_finely_sampled_sphere_point_outwards():
    points = unit(np.random.default_rng(1).normal(size=(20_000, 3)))
    points = points[points[:, 2] > 0.5]
    error = angle_between(normals_from_neighbours(points, np.array([0, 0, 100.0])), points)
    assert np.degrees(np.median(error)) < 1.0


def test_normals_need_three_points():
    with pytest.raises(ValueError, match="3 points"):
        normals_from_neighbours(np.zeros((2, 3)), np.zeros(3))


def test_neighbours_on_a_grid_are_the_four_adjacent_points():
    y, x = np.indices((12, 12))
    near, keep = neighbours(np.stack([x, y, 0 * x], -1).reshape(-1, 3).astype(float), 4)
    middle = 5 * 12 + 5
    assert set(near[middle]) == {middle - 1, middle + 1, middle - 12, middle + 12}
    assert keep[middle].all()


def test_neighbours_do_not_reach_across_a_hole():
    points = np.column_stack([np.arange(400.0), np.zeros((400, 2))])
    points[-1, 0] += 60.0
    near, keep = neighbours(points, 4)
    assert not keep[-1].any()
    assert keep[:-3].all()
    assert not (near == np.arange(400)[:, None]).any()
