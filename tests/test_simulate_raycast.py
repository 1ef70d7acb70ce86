import numpy as np
import pytest

from photoclinometry.simulate.raycast import Raycaster, bound_pyramid
from photoclinometry.simulate.surface import Surface
from rough_ground import inner_points, rough_surface

UP = np.array([0.0, 0.0, 1.0])


def direction(elevation_deg, azimuth_deg):
    """Unit vector; azimuth from x (east) towards y (north)."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def fan(surface, origin, count=2000, seed=3):
    """Directions (count, 3) from `origin` (3,) to points over the surface, at mean height."""
    xy = inner_points(surface, count, seed)
    return np.concatenate([xy, np.full((count, 1), surface.height.mean())], -1) - origin


def flat_with(height, spacing=1.0):
    return Surface(height, np.full(height.shape, 0.3), spacing, (0.0, 0.0))


def shadow_along_x(surface, y, x, sun):
    """lit (n,) at points (x, y), seen from straight above."""
    rows = []
    caster = Raycaster(surface)
    for value in x:
        origin = np.array([value, y, 1e4])
        rows.append(caster.trace(origin, -UP[None], sun).lit[0])
    return np.array(rows)


def test_bounds_hold_everywhere():
    surface = rough_surface()
    bound, levels = bound_pyramid(surface.height)
    uv = np.random.default_rng(0).uniform(0, 39, (20_000, 2))
    height = surface.height_at(uv * surface.spacing + surface.origin)
    for level, (offset, rows, cols) in enumerate(levels):
        grid = bound[offset : offset + rows * cols].reshape(rows, cols)
        j, i = (uv.astype(int) >> level).T
        assert (grid[i, j] >= height).all()


def test_hits_lie_on_the_surface_and_on_the_ray():
    surface = rough_surface()
    origin = np.array([30.0, 400.0, 5000.0])
    rays = fan(surface, origin)
    hits = Raycaster(surface).trace(origin, rays, UP)
    assert hits.hit.all()
    point = origin + hits.distance[:, None] * rays
    np.testing.assert_allclose(surface.height_at(point[:, :2]), point[:, 2], atol=1e-5)
    np.testing.assert_allclose(hits.normal, surface.normal_at(point[:, :2]), atol=1e-6)
    np.testing.assert_allclose(hits.albedo, surface.albedo_at(point[:, :2]), atol=1e-7)


@pytest.mark.parametrize("elevation", [12.0, 35.0, 80.0])
def test_hits_agree_with_dense_marching(elevation):
    """The first of 20,000 points along each ray that lies below the surface is within a step of the hit."""
    surface = rough_surface(amplitude=8.0)
    towards = direction(elevation, 200.0)
    target = np.concatenate([inner_points(surface, 60, margin=4), np.zeros((60, 1))], -1)
    caster, length = Raycaster(surface), 3.0 / np.sin(np.radians(elevation)) * 20.0
    for point in target:
        origin = point + length * towards
        t = np.linspace(0.0, 2.0 * length, 20_001)
        path = origin - t[:, None] * towards
        x0, x1, y0, y1 = surface.extent
        inside = (path[:, 0] > x0) & (path[:, 0] < x1) & (path[:, 1] > y0) & (path[:, 1] < y1)
        above = path[:, 2] - surface.height_at(path[:, :2])
        first = np.flatnonzero(inside)[0]
        hits = caster.trace(origin, -towards[None], UP)
        if above[first] < 0:
            assert not hits.hit[0]  # it comes in beneath the edge of the grid
            continue
        below = np.flatnonzero(inside & (above < 0))
        assert hits.hit[0] == (len(below) > 0)
        if len(below):
            assert t[below[0] - 1] - 1e-6 <= hits.distance[0] <= t[below[0]] + 1e-6


def test_hits_and_shadows_agree_with_a_mesh_ray_tracer():
    """Embree on a mesh eight times finer than the grid: the rest is the mesh's facets."""
    embreex = pytest.importorskip("embreex.rtcore_scene")
    from embreex.mesh_construction import TriangleMesh

    surface = rough_surface(amplitude=6.0)
    sun = direction(25.0, 70.0)
    n = 39 * 8 + 1
    x0, x1, y0, y1 = surface.extent
    grid = np.stack(np.meshgrid(np.linspace(x0, x1, n), np.linspace(y0, y1, n)), -1)
    vertex = np.concatenate([grid, surface.height_at(grid)[..., None]], -1).reshape(-1, 3)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + n], -1), np.stack([corner + 1, corner + n + 1, corner + n], -1)]
    )
    scene = embreex.EmbreeScene()
    TriangleMesh(scene, vertex[faces].astype(np.float32))

    origin = np.array([40.0, 200.0, 400.0])
    rays = fan(surface, origin)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    mesh = scene.run(np.tile(origin, (len(rays), 1)).astype(np.float32), rays.astype(np.float32), query="DISTANCE")
    hits = Raycaster(surface).trace(origin, rays, sun)
    assert hits.hit.all()
    distance = hits.distance
    assert np.quantile(np.abs(mesh - distance), 0.99) < 0.01 * surface.spacing

    point = origin + distance[:, None] * rays
    faces_sun = hits.normal @ sun > 0.02
    start = (point + 0.02 * hits.normal).astype(np.float32)
    blocked = scene.run(start, np.tile(sun, (len(rays), 1)).astype(np.float32)) >= 0
    assert 0.1 < blocked.mean() < 0.9
    assert np.mean((~blocked == hits.lit)[faces_sun]) > 0.995


@pytest.mark.parametrize("elevation", [20.0, 40.0])
def test_shadow_of_a_wall_has_the_length_of_the_sun_s_cotangent(elevation):
    height = np.zeros((21, 200))
    height[:, :40] = 12.0
    x = np.arange(41.0, 160.0, 0.25) + 0.01
    lit = shadow_along_x(flat_with(height), 10.0, x, direction(elevation, 180.0))
    end = x[np.argmax(lit)]
    assert not lit[x < end].any()
    assert lit[x >= end].all()
    assert end - 39.0 == pytest.approx(12.0 / np.tan(np.radians(elevation)), abs=0.5)


def lit_on_plane(height, sun, margin=1.5):
    """lit (n,) at plane points xy (n, 2) around a body in the middle of a grid, and those points from the middle."""
    half = len(height) // 2
    surface = Surface(height, np.full(height.shape, 0.3), 1.0, (-half, -half))
    xy = np.random.default_rng(0).uniform(-0.95 * half, 0.95 * half, (20_000, 2))
    xy = xy[np.hypot(*xy.T) > 40.0 + margin]
    origin = np.array([300.0, -200.0, 1e5])
    return Raycaster(surface).trace(origin, np.pad(xy, ((0, 0), (0, 1))) - origin, sun).lit, xy


def check_shadow(lit, shadow, size):
    """Everything farther than `size` inside or outside of the shadow's edge, in multiples of the body, agrees."""
    inside, outside = shadow < 1.0 - size, shadow > 1.0 + size
    assert inside.sum() > 200
    assert not lit[inside].any()
    assert lit[outside].all()


@pytest.mark.parametrize(("elevation", "azimuth"), [(20.0, 180.0), (25.0, 75.0)])
def test_shadow_of_a_cone_on_a_plane(elevation, azimuth):
    """Height and base radius 40. At height 40 k it is a disk of radius 40 (1 - k), and that disk's shadow is shifted by
    k times the tip's; outside the base a point is in shadow if it is in one of them."""
    x, y = np.meshgrid(np.arange(-160.0, 161.0), np.arange(-160.0, 161.0))
    sun = direction(elevation, azimuth)
    lit, xy = lit_on_plane(np.maximum(40.0 - np.hypot(x, y), 0.0), sun)
    tip = -40.0 * sun[:2] / sun[2]
    k = np.linspace(0.0, 0.99, 400)[:, None]
    off = [np.hypot(*(xy - at * tip).T) / (40.0 * (1.0 - at)) for at in k]
    check_shadow(lit, np.min(off, 0), 0.05)


@pytest.mark.parametrize(("elevation", "azimuth"), [(25.0, 180.0), (35.0, 75.0)])
def test_shadow_of_a_half_sphere_on_a_plane(elevation, azimuth):
    """Radius 40. The line from a point towards the Sun passes the centre at |point x sun|; behind the sphere, that is
    a shadow if it is less than the radius."""
    x, y = np.meshgrid(np.arange(-160.0, 161.0), np.arange(-160.0, 161.0))
    sun = direction(elevation, azimuth)
    lit, xy = lit_on_plane(np.sqrt(np.maximum(40.0**2 - x**2 - y**2, 0.0)), sun)
    passes = np.linalg.norm(np.cross(np.pad(xy, ((0, 0), (0, 1))), sun), axis=1) / 40.0
    check_shadow(lit, np.where(xy @ sun[:2] < 0, passes, np.inf), 0.02)


def test_ground_turned_away_from_the_sun_is_not_lit_and_open_ground_is():
    x, _ = np.meshgrid(np.arange(50.0), np.arange(50.0))
    slope = flat_with(-x)  # falls towards the east at 45 degrees
    origin, down = np.array([25.3, 25.1, 100.0]), -UP[None]
    assert Raycaster(slope).trace(origin, down, direction(50.0, 180.0)).lit.all()
    assert not Raycaster(slope).trace(origin, down, direction(40.0, 180.0)).lit.any()


def test_vertical_rays_and_the_sun_overhead():
    surface = rough_surface()
    xy = inner_points(surface, 20)
    caster = Raycaster(surface)
    for x, y in xy:
        hits = caster.trace(np.array([x, y, 100.0]), -UP[None], UP)
        assert hits.hit[0]
        assert hits.lit[0]
        assert 100.0 - hits.distance[0] == pytest.approx(float(surface.height_at([x, y])), abs=1e-5)


def test_rays_beside_the_grid_hit_nothing():
    surface = rough_surface()
    away = np.array([[0.0, 1.0, -0.1], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    hits = Raycaster(surface).trace(np.array([30.0, 30.0, 500.0]), away, UP)
    assert not hits.hit.any()
    assert not hits.lit.any()
