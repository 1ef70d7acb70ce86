"""Rays from the origin: radii in closed form, the outermost surface of concave bodies, and Embree's answers."""

import numpy as np
import pytest

from archives import SHARED
from cubes import CUBE
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.model.geometry import unit
from photoclinometry.surface.closed_mesh import icosahedron, refine
from photoclinometry.surface.radial_rays import RadialRays, is_star_shaped

COMET = SHARED / "shapes" / "67p.obj"


def directions(count, seed=0):
    return unit(np.random.default_rng(seed).normal(size=(count, 3)))


def test_a_cube_in_closed_form():
    """The radius is 1 / max |d|, also along edges, diagonals and axes."""
    d = np.concatenate([directions(2000), np.eye(3), -np.eye(3), unit(CUBE[0]), unit([[1.0, 1.0, 0.0], [0, -1, 1]])])
    radius, face, weight = RadialRays(*CUBE).outermost(d)
    np.testing.assert_allclose(radius, 1.0 / np.abs(d).max(1), rtol=1e-12)
    np.testing.assert_allclose(np.einsum("nk,nki->ni", weight, CUBE[0][CUBE[1][face]]), radius[:, None] * d, atol=1e-12)


def test_every_vertex_of_a_sphere_is_met():
    vertices, faces = refine(*icosahedron(), 0.1, unit)
    radius, _, _ = RadialRays(vertices, faces).outermost(vertices)
    np.testing.assert_allclose(radius, 1.0, rtol=1e-12)


def test_the_lists_of_cells_are_short():
    """Triangles about the great circles between the sides are not listed in all cells of a side."""
    vertices, faces = refine(*icosahedron(), 0.02, unit)
    rays = RadialRays(vertices, faces)
    assert rays.listed < 4 * len(faces)


def test_the_outermost_of_two_spheres_counts():
    vertices, faces = icosahedron()
    both = np.concatenate([vertices, 2.0 * vertices])
    radius, face, _ = RadialRays(both, np.concatenate([faces, faces + len(vertices)])).outermost(directions(500))
    assert radius.min() > 1.5
    assert (face >= len(faces)).all()


def test_directions_without_surface_are_told():
    """A body beside the origin is in few directions only."""
    vertices, faces = icosahedron()
    d = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    radius, face, _ = RadialRays(vertices + [10.0, 0.0, 0.0], faces).outermost(d)
    assert radius[0] > 10.0
    assert np.isnan(radius[1:]).all()
    assert (face[1:] == -1).all()


def test_star_shape_is_told_of_the_origin():
    vertices, faces = icosahedron()
    assert is_star_shaped(vertices, faces)
    assert is_star_shaped(vertices + [0.7, 0, 0], faces)
    assert not is_star_shaped(vertices + [1.5, 0, 0], faces)


@pytest.mark.skipif(not COMET.is_file(), reason="no ../shared/data/shapes/67p.obj beside the repository")
def test_a_concave_comet_is_met_where_embree_meets_it():
    pytest.importorskip("embreex")
    from photoclinometry.surface.mesh_rays import MeshRays

    vertices, faces = read_obj(COMET)
    assert not is_star_shaped(vertices, faces)
    d = directions(5000)
    radius, _, _ = RadialRays(vertices, faces).outermost(d)
    triangle, weight = MeshRays(vertices, faces, 0.01).first_hit(100.0 * d, -d)
    point = np.einsum("nk,nki->ni", weight, vertices[faces[triangle]])
    error = np.abs(np.sum(point * d, -1) - radius)
    assert np.isfinite(radius).all()
    # A ray in a thousand grazes an edge that single precision passes by.
    assert np.mean(error < 1e-5) > 0.999
