"""Coarser closed meshes stay closed, keep their holes, and stay near the surface."""

import numpy as np
import pytest

from archives import SHARED
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.surface.closed_mesh import icosahedron, is_watertight, refine, signed_volume
from photoclinometry.surface.decimate import decimate

COMET = SHARED / "shapes" / "67p.obj"


@pytest.fixture(scope="module")
def ball():
    return refine(*icosahedron(), 0.06, unit)


def torus(around=60, across=24):
    """A closed mesh with a hole through it: V - E + F = 0."""
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    phi, theta = 2 * np.pi * i / around, 2 * np.pi * j / across
    ring = 1.0 + 0.35 * np.cos(theta)
    vertices = np.stack([ring * np.cos(phi), ring * np.sin(phi), 0.35 * np.sin(theta)], -1).reshape(-1, 3)
    number = lambda a, b: (a % around) * across + b % across  # noqa: E731
    a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return vertices, faces


def euler(vertices, faces):
    """V - E + F of a closed mesh."""
    return len(vertices) - len(faces) // 2


def test_a_sphere_stays_closed_and_round(ball):
    """With 1,024 triangles edges are 0.17 long, and the middles of triangles 0.17^2 / 6 below their corners."""
    vertices, faces = decimate(*ball, len(ball[1]) // 5)
    assert len(faces) == pytest.approx(len(ball[1]) // 5, abs=1)
    assert is_watertight(faces)
    assert euler(vertices, faces) == 2
    middles = vertices[faces].mean(1)
    below = 1.0 - np.linalg.norm(middles, axis=1)
    assert below.mean() < 0.17**2 / 6.0
    assert np.abs(below).max() < 2.0 * 0.17**2 / 6.0
    assert signed_volume(vertices, faces) == pytest.approx(signed_volume(*ball), rel=0.01)


def test_rough_ground_is_made_as_coarse_as_asked(ball):
    """Collapses leave vertices with three neighbours; these have to go as well, or nothing may in the end."""
    vertices, faces = ball
    rough = vertices * (1.0 + 0.02 * np.random.default_rng(0).normal(size=(len(vertices), 1)))
    for share in (16, 64):
        coarse, left = decimate(rough, faces, len(faces) // share)
        assert len(left) == pytest.approx(len(faces) // share, abs=2)
        assert is_watertight(left)
        assert np.bincount(left.ravel()).min() >= 3
        assert euler(coarse, left) == 2


def test_a_hole_through_the_body_is_kept():
    given = torus()
    vertices, faces = decimate(*given, 600)
    assert is_watertight(faces)
    assert euler(*given) == euler(vertices, faces) == 0
    assert len(faces) <= 602


def test_frames_and_units_do_not_matter(ball):
    """A rough body in kilometres far from the origin gives the same mesh, moved."""
    rough = ball[0] * np.random.default_rng(0).uniform(0.99, 1.01, (len(ball[0]), 1))
    plain, faces = decimate(rough, ball[1], 2000)
    moved, same = decimate(1e-3 * rough + 50.0, ball[1], 2000)
    np.testing.assert_array_equal(faces, same)
    np.testing.assert_allclose(1e3 * (moved - 50.0), plain, atol=1e-6)


def test_a_mesh_that_is_coarse_enough_is_returned(ball):
    vertices, faces = decimate(*ball, len(ball[1]))
    np.testing.assert_allclose(vertices, ball[0], atol=1e-15)
    np.testing.assert_array_equal(faces, ball[1])


def test_a_mesh_ends_as_a_tetrahedron_at_most():
    _, faces = decimate(*icosahedron(), 1)
    assert len(faces) >= 4
    assert is_watertight(faces)


def test_open_meshes_are_refused(ball):
    with pytest.raises(InputError, match="open edges"):
        decimate(ball[0], ball[1][1:], 100)


@pytest.mark.skipif(not COMET.is_file(), reason="no ../shared/data/shapes/67p.obj beside the repository")
@pytest.mark.parametrize("share", [0.5, 0.1])
def test_a_concave_comet_stays_closed_and_near(share):
    given = read_obj(COMET)
    vertices, faces = decimate(*given, int(share * len(given[1])))
    assert is_watertight(faces)
    assert euler(vertices, faces) == 2
    radius = np.cbrt(0.75 / np.pi * signed_volume(*given))
    middles = vertices[faces].mean(1)
    distance = np.linalg.norm(middles - MeshSurface(*given, closed=True)(middles)[0], axis=1)
    assert np.sqrt(np.mean(distance**2)) < {0.5: 0.0012, 0.1: 0.006}[share] * radius


def test_the_nearest_point_of_a_mesh_has_weights(ball):
    surface = MeshSurface(*ball, closed=True)
    points = 1.1 * unit(np.random.default_rng(0).normal(size=(500, 3)))
    face, weight = surface.weights(points)
    np.testing.assert_allclose(weight.sum(1), 1.0, atol=1e-12)
    foot = np.einsum("nk,nki->ni", weight, ball[0][ball[1][face]])
    np.testing.assert_allclose(foot, surface(points)[0], atol=1e-12)
