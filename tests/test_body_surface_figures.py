"""Figures of a body's merged surface are those of an ellipsoid whose size and sigmas are known."""

import numpy as np
import pytest

from photoclinometry.body.merge import MergedSurface
from photoclinometry.body.surface_figures import surface_figures
from photoclinometry.surface.closed_mesh import icosahedron, refine, vertex_normals

SEMI_AXES = np.array([30.0, 20.0, 15.0])
GSD, HEIGHT_SIGMA = 2.0, 0.5


def ellipsoid(points):
    """Points taken to an ellipsoid along the rays from its middle."""
    return points / np.linalg.norm(points / SEMI_AXES, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def surface():
    """Turned about z and moved; its southern half has no map."""
    corners, faces = icosahedron()
    vertices, faces = refine(ellipsoid(corners), faces, 1.0, ellipsoid)
    normals, count = vertex_normals(vertices, faces), len(vertices)
    known = vertices[:, 2] > 0.0
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    return MergedSurface(
        vertices=vertices @ turn.T + (100.0, 0.0, -40.0),
        faces=faces,
        normals=normals @ turn.T,
        albedo=np.where(known, 0.1, np.nan),
        height_sigma=np.where(known, HEIGHT_SIGMA, np.nan),
        normal_sigma=np.where(known, np.radians(3.0), np.nan),
        albedo_sigma=np.where(known, 0.02, np.nan),
        views=np.where(known, 7, 0),
        tile=np.where(known, 0, -1),
        step=np.full(count, np.nan),
        gsd=GSD,
        albedo_factor=np.ones(1),
        sigma_factor=np.array([1.5, 1.2, 1.0]),
    )


def test_size_is_that_of_the_ellipsoid(surface):
    found = surface_figures(surface)
    volume = 4.0 / 3.0 * np.pi * SEMI_AXES.prod()
    assert found["volume"] == pytest.approx(volume, rel=0.01)
    assert found["mean_radius"] == pytest.approx(np.cbrt(SEMI_AXES.prod()), rel=0.01)
    extents = [found[f"{name}_extent"] for name in ("longest", "middle", "shortest")]
    assert extents == pytest.approx(2.0 * SEMI_AXES, rel=0.01)


def test_the_volume_is_known_as_the_heights_are(surface):
    """Errors are common to patches of 2 pi L^2, the area under their correlation, and independent between these."""
    found = surface_figures(surface)
    length = 0.1 * found["mean_radius"]
    patches = found["area"] / (2.0 * np.pi * length**2)
    assert found["volume_sigma"] == pytest.approx(found["area"] * HEIGHT_SIGMA / np.sqrt(patches), rel=0.1)


def test_medians_are_of_what_is_known(surface):
    found = surface_figures(surface)
    assert found["height_sigma_median_gsd"] == pytest.approx(HEIGHT_SIGMA / GSD)
    assert found["normal_sigma_median_deg"] == pytest.approx(3.0)
    assert found["albedo_sigma_median_percent"] == pytest.approx(2.0)
    assert found["mapped_percent"] == pytest.approx(50.0, abs=3.0)
    assert [found[f"{name}_sigma_factor"] for name in ("height", "normal", "albedo")] == [1.5, 1.2, 1.0]
    assert not any(key.startswith("step_between_tiles") for key in found)
