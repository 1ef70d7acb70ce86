"""Gravity of polyhedra: a cube and a sphere in closed form, a sum of point masses, and Poisson's equation."""

import numpy as np
import pytest

from cubes import CUBE
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.registration.closest_points import MeshSurface
from photoclinometry.surface.closed_mesh import face_normals, icosahedron, refine, signed_volume, vertex_normals
from photoclinometry.surface.polyhedron_gravity import GRAVITATIONAL_CONSTANT as G
from photoclinometry.surface.polyhedron_gravity import Polyhedron
from photoclinometry.surface.surface_gravity import carried, ground_gravity, spin_rate

DENSITY, RADIUS = 1190.0, 250.0
FIELD_POINTS = unit(np.random.default_rng(0).normal(size=(40, 3)))


@pytest.fixture(scope="module")
def ball():
    vertices, faces = refine(*icosahedron(), 0.1, unit)
    return RADIUS * vertices, faces


def of_same_volume(vertices, faces):
    """Radius of the sphere of the same volume."""
    return np.cbrt(0.75 / np.pi * signed_volume(vertices, faces))


def test_a_cube_in_its_middle_in_closed_form():
    """Potential at the middle of a cube of side 2: G rho 4 (3 ln(2 + 3^0.5) - pi / 2), twice that at a corner."""
    potential, acceleration, laplacian = Polyhedron(*CUBE, 1.0 / G).field(np.array([[0.0, 0, 0], [1.0, 1, 1]]))
    middle = 4.0 * (3.0 * np.log(2.0 + 3.0**0.5) - 0.5 * np.pi)
    np.testing.assert_allclose(potential, [middle, 0.5 * middle], rtol=1e-12)
    np.testing.assert_allclose(acceleration[0], 0.0, atol=1e-12)
    assert laplacian[0] == pytest.approx(-4.0 * np.pi)


def test_a_cube_far_away_is_a_point():
    point = np.array([[300.0, 400.0, 0.0]])
    potential, acceleration, _ = Polyhedron(*CUBE, 1.0 / G).field(point)
    assert potential[0] == pytest.approx(8.0 / 500.0, rel=1e-6)
    np.testing.assert_allclose(acceleration[0], -8.0 / 500.0**3 * point[0], rtol=1e-6, atol=1e-15)


def test_a_cube_is_the_sum_of_fine_point_masses():
    """80^3 points in a cube, 0.4 of its side outside: the midpoint rule is good to 1e-4."""
    step = (np.arange(80) + 0.5) / 40.0 - 1.0
    masses = np.stack(np.meshgrid(step, step, step, indexing="ij"), -1).reshape(-1, 3)
    point = np.array([[1.8, 0.3, -0.5]])
    offset = masses - point
    distance = np.linalg.norm(offset, axis=1)
    mass = 8.0 / len(masses)
    potential, acceleration, laplacian = Polyhedron(*CUBE, 1.0 / G).field(point)
    assert potential[0] == pytest.approx(np.sum(mass / distance), rel=1e-5)
    np.testing.assert_allclose(acceleration[0], mass * (offset / distance[:, None] ** 3).sum(0), rtol=1e-4)
    assert abs(laplacian[0]) < 1e-10


def test_a_sphere_inside_and_outside(ball):
    """Outside G M / r, inside 2 pi G rho (R^2 - r^2 / 3), up to the sphere's facets."""
    radius, mass = of_same_volume(*ball), DENSITY * signed_volume(*ball)
    body = Polyhedron(*ball, DENSITY)
    potential, acceleration, laplacian = body.field(2.0 * RADIUS * FIELD_POINTS)
    np.testing.assert_allclose(potential, G * mass / (2.0 * RADIUS), rtol=1e-5)
    np.testing.assert_allclose(acceleration, -G * mass / (2.0 * RADIUS) ** 2 * FIELD_POINTS, atol=1e-5 * 8e-5)
    np.testing.assert_allclose(laplacian, 0.0, atol=1e-9 * G * DENSITY)
    potential, acceleration, laplacian = body.field(0.5 * RADIUS * FIELD_POINTS)
    np.testing.assert_allclose(
        potential, 2.0 * np.pi * G * DENSITY * (radius**2 - (0.5 * RADIUS) ** 2 / 3.0), rtol=1e-4
    )
    np.testing.assert_allclose(
        acceleration, -4.0 / 3.0 * np.pi * G * DENSITY * 0.5 * RADIUS * FIELD_POINTS, atol=1e-4 * 8e-5
    )
    np.testing.assert_allclose(laplacian, -4.0 * np.pi * G * DENSITY, rtol=1e-9)


def test_the_attraction_is_the_gradient_of_the_potential():
    """Central differences, inside, outside and near an edge."""
    body, step = Polyhedron(*CUBE, 1.0 / G), 1e-5
    for point in ([0.3, -0.2, 0.1], [1.5, 0.4, 2.0], [1.001, 1.002, 0.3]):
        around = np.array(point) + step * np.concatenate([np.eye(3), -np.eye(3)])
        potential, _, _ = body.field(around)
        _, acceleration, _ = body.field(np.array([point]))
        np.testing.assert_allclose(acceleration[0], (potential[:3] - potential[3:]) / (2.0 * step), rtol=1e-5)


def test_on_vertices_edges_and_faces_the_field_is_continuous():
    points = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 0.2], [1.0, 0.3, 0.2], [1.0, 0.5, 0.5]])
    body = Polyhedron(*CUBE, 1.0 / G)
    potential, acceleration, _ = body.field(points)
    near, attraction, _ = body.field(points * (1.0 + 1e-9))
    np.testing.assert_allclose(potential, near, rtol=1e-8)
    np.testing.assert_allclose(acceleration, attraction, atol=1e-6)


def test_open_meshes_have_no_gravity():
    with pytest.raises(InputError, match="open edges"):
        Polyhedron(CUBE[0], CUBE[1][1:], 1.0)


def test_a_still_sphere_is_level_and_at_elevation_zero(ball):
    gravity = ground_gravity(Polyhedron(*ball, DENSITY), 0.0)
    # Vertices stand 0.1^2 / 6 radii above the facets between them.
    assert np.abs(gravity.elevation).max() < 0.1**2 / 6.0 * RADIUS
    assert np.degrees(gravity.slope(unit(ball[0]))).max() < 0.1
    np.testing.assert_allclose(gravity.magnitude, 4.0 / 3.0 * np.pi * G * DENSITY * RADIUS, rtol=0.01)


def test_a_spinning_sphere_slopes_to_the_equator(ball):
    """At latitude 45 degrees the slope is atan(q / 2 / (1 - q / 2)), q the centrifugal share of gravity at the equator;
    elevations fall from the poles to the equator by w^2 R^2 / 2 / g."""
    spin = spin_rate(4.3)
    gravity = ground_gravity(Polyhedron(*ball, DENSITY), spin)
    share = spin**2 / (4.0 / 3.0 * np.pi * G * DENSITY)
    latitude = np.arcsin(ball[0][:, 2] / RADIUS)
    middle, pole, equator = (np.abs(np.abs(latitude) - at) < 0.03 for at in (np.pi / 4, np.pi / 2, 0.0))
    expected = np.arctan(0.5 * share / (1.0 - 0.5 * share))
    assert gravity.slope(unit(ball[0]))[middle].mean() == pytest.approx(expected, rel=0.01)
    fall = (gravity.potential[pole].mean() - gravity.potential[equator].mean()) / (0.5 * spin**2 * RADIUS**2)
    assert fall == pytest.approx(1.0, rel=0.02)


def test_gravity_is_carried_to_a_finer_mesh():
    """From 1,160 facets to the vertices of 16,640, mass for mass: slopes within 0.3 degrees, elevations within 0.15 %
    of the radius."""
    direction, faces = refine(*icosahedron(), 0.2, unit)
    fine, fine_faces = refine(direction, faces, 0.05, unit)

    def egg(d):
        return RADIUS * (1.0 + 0.2 * d[:, :1] + 0.1 * d[:, 1:2] * d[:, 2:] + 0.1 * d[:, 2:] ** 2) * d

    exact = Polyhedron(egg(fine), fine_faces, DENSITY)
    mass = DENSITY * signed_volume(exact.vertices, fine_faces)
    coarse = Polyhedron(egg(direction), faces, mass / signed_volume(egg(direction), faces))
    spin, points = spin_rate(4.3), exact.vertices
    chosen = np.arange(0, len(points), 50)
    face, weight = MeshSurface(coarse.vertices, coarse.faces, closed=True).weights(points[chosen])
    near = carried(ground_gravity(coarse, spin), coarse, points[chosen], face, weight)
    potential, acceleration, _ = exact.field(points[chosen])
    out = points[chosen] * [1.0, 1.0, 0.0]
    potential, acceleration = -potential - 0.5 * spin**2 * np.sum(out * out, -1), acceleration + spin**2 * out
    normals = vertex_normals(points, fine_faces)[chosen]
    up = unit(-acceleration)
    slope = np.arccos(np.clip(np.sum(normals * up, -1), -1, 1))
    assert np.degrees(np.abs(near.slope(normals) - slope)).mean() < 0.3
    error = (near.potential - potential) / np.linalg.norm(acceleration, axis=1)
    assert np.sqrt(np.mean(error**2)) < 1.5e-3 * RADIUS


def test_a_face_without_area_has_no_normal_and_attracts_nothing():
    """An edge whose middle is a corner of a face that lies on the edge: the body is the same."""
    vertices, faces = icosahedron()
    a, b, c = faces[0]
    split = np.vstack([vertices, 0.5 * (vertices[a] + vertices[b])])
    middle = len(vertices)
    sliver = np.vstack([faces[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
    assert not face_normals(split, sliver)[-1].any()
    here = np.array([[0.3, 2.0, 0.5]])
    whole, with_sliver = (Polyhedron(*mesh, 2000.0) for mesh in ((vertices, faces), (split, sliver)))
    for found, expected in zip(with_sliver.field(here), whole.field(here), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15)
