"""Ground from a file: the surface simulated is the one given, whatever its frame and unit, or it is refused."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.io.images import read_image
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import so3_exp, unit
from photoclinometry.simulate.given import given_relief
from photoclinometry.simulate.options import SimulationOptions
from photoclinometry.simulate.site import simulate_site
from photoclinometry.simulate.surface import sphere_drop
from photoclinometry.simulate.terrain import Grid
from photoclinometry.simulate.truth_file import read_truth

GRID = Grid(spacing=10.0, half=40)
GSD = 20.0


def bumps(x, y):
    return 60.0 * np.sin(x / 130.0) * np.cos(y / 170.0) + 0.05 * x


def grid_mesh(z, half=600.0, step=10.0):
    """Vertices and faces of z(x, y) over a square, counter-clockwise from above."""
    axis = np.arange(-half, half + 0.5 * step, step)
    n = len(axis)
    x, y = np.meshgrid(axis, axis)
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, 1:].ravel(), index[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    return np.stack([x, y, z(x, y)], -1).reshape(-1, 3), faces


def ball(radius=1500.0, parallels=150):
    """A closed sphere, outside out."""
    lat = np.linspace(-np.pi / 2, np.pi / 2, parallels + 1)[1:-1]
    lon = np.linspace(0.0, 2 * np.pi, 2 * parallels, endpoint=False)
    lon, lat = np.meshgrid(lon, lat)
    ring = radius * np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    rows, cols = lat.shape
    vertices = np.concatenate([ring.reshape(-1, 3), [[0, 0, -radius], [0, 0, radius]]])
    index = np.arange(rows * cols).reshape(rows, cols)
    east = np.roll(index, -1, axis=1)
    sides = [[index[:-1], east[:-1], east[1:]], [index[:-1], east[1:], index[1:]]]
    faces = [np.stack(side, -1).reshape(-1, 3) for side in sides]
    south, north = rows * cols, rows * cols + 1
    faces.append(np.stack([east[0], index[0], np.full(cols, south)], -1))
    faces.append(np.stack([index[-1], east[-1], np.full(cols, north)], -1))
    return vertices, np.concatenate(faces)


def write_obj(path, vertices, faces):
    lines = [f"v {x:.12g} {y:.12g} {z:.12g}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_ply(path, vertices, faces, albedo):
    header = "ply\nformat ascii 1.0\nelement vertex {}\n{}element face {}\nproperty list uchar int vertex_indices\n"
    names = "".join(f"property double {name}\n" for name in ("x", "y", "z", "albedo"))
    rows = [f"{x:.12g} {y:.12g} {z:.12g} {a:.9g}" for (x, y, z), a in zip(vertices, albedo, strict=True)]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces]
    path.write_text(header.format(len(vertices), names, len(faces)) + "end_header\n" + "\n".join(rows) + "\n")
    return path


def points_in_file(relief, grid=GRID):
    """The relief's samples (n, n, 3) in the file's coordinates."""
    x, y = np.meshgrid(grid.axis, grid.axis)
    return relief.body_from_file.inverse()(np.stack([x, y, relief.height], -1))


def test_a_mesh_in_another_frame_and_unit_keeps_its_ground(tmp_path):
    """Bumps somewhere on a body, in km: brought back into the file's frame, the relief lies on the bumps, to within
    the sagitta of a facet, 10^2 / 8 times the greatest curvature 0.0055 / m."""
    vertices, faces = grid_mesh(bumps)
    turn, shift = so3_exp(np.array([0.7, -1.1, 0.4])), np.array([90.0, -200.0, 110.0])
    outward = turn @ [0.0, 0.0, 1.0]
    shift = shift if outward @ shift > 0 else -shift
    path = write_obj(tmp_path / "bumps.obj", 1e-3 * vertices @ turn.T + shift, faces)
    relief = given_relief(path, GRID, GSD, "km", None)
    found = 1e3 * (points_in_file(relief) - shift) @ turn
    np.testing.assert_allclose(found[..., 2], bumps(found[..., 0], found[..., 1]), atol=0.08)
    assert relief.height[GRID.half, GRID.half] == pytest.approx(0.0, abs=1e-3)
    x, y = np.meshgrid(GRID.axis, GRID.axis)
    tilt = np.linalg.lstsq(np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3), relief.height.ravel(), rcond=None)[0]
    assert np.abs(tilt[:2]).max() < 0.1  # upright on the mean normal


def test_a_place_on_a_closed_shape_is_the_sphere_there_with_north_up(tmp_path):
    vertices, faces = ball()
    path = write_obj(tmp_path / "ball.obj", vertices, faces)
    towards = unit([0.5, 0.7, 0.4])
    relief = given_relief(path, GRID, GSD, "m", tuple(1500.0 * towards))
    x, y = np.meshgrid(GRID.axis, GRID.axis)
    np.testing.assert_allclose(relief.height, sphere_drop(x, y, 1500.0), atol=1.0)
    np.testing.assert_allclose(relief.body_from_file.rotation[2], towards, atol=0.01)
    assert relief.body_from_file.rotation[1] @ [0.0, 0.0, 1.0] > 0.9
    inside_out = write_obj(tmp_path / "inside_out.obj", vertices, faces[:, ::-1])
    np.testing.assert_array_equal(
        given_relief(inside_out, GRID, GSD, "m", tuple(1500.0 * towards)).height, relief.height
    )


def test_a_map_is_laid_on_its_sphere(tmp_path):
    """Cubic interpolation of the samples of a cosine of 40 pixels' period, plus the sphere of the map's ellipsoid."""
    rasterio = pytest.importorskip("rasterio")
    easting, northing = np.meshgrid(1000.0 + np.arange(120) * 15.0, 9000.0 - np.arange(110) * 15.0)
    height = 0.05 * np.cos(easting / 95.0) + 0.03 * np.sin(northing / 95.0)
    height[np.maximum(np.abs(easting - 1900.0), np.abs(northing - 8200.0)) > 430.0] = -32768.0  # not needed
    transform = rasterio.Affine(15.0, 0.0, 992.5, 0.0, -15.0, 9007.5)
    crs = "+proj=stere +lat_0=0 +lon_0=0 +R=262000 +units=m"
    shape = {"count": 1, "height": 110, "width": 120, "dtype": "float64", "nodata": -32768.0}
    with rasterio.open(tmp_path / "map.tif", "w", driver="GTiff", crs=crs, transform=transform, **shape) as file:
        file.write(height, 1)
    relief = given_relief(tmp_path / "map.tif", GRID, GSD, "km", (1900.0, 8200.0))
    x, y = np.meshgrid(GRID.axis, GRID.axis)
    expected = 50.0 * np.cos((1900.0 + x) / 95.0) + 30.0 * np.sin((8200.0 + y) / 95.0)
    expected += sphere_drop(x, y, 262_000.0) - expected[GRID.half, GRID.half]
    np.testing.assert_allclose(relief.height, expected, atol=0.2)  # 2 pixels from the gap, whose filling is guessed
    np.testing.assert_allclose(relief.height[8:-8, 8:-8], expected[8:-8, 8:-8], atol=0.01)


def test_albedo_of_a_mesh_is_kept_and_must_be_one(tmp_path):
    vertices, faces = grid_mesh(lambda x, y: 0 * x)
    albedo = 0.3 + 1e-4 * vertices[:, 0]
    relief = given_relief(write_ply(tmp_path / "a.ply", vertices, faces, albedo), GRID, GSD, "m", None)
    np.testing.assert_allclose(relief.albedo, np.broadcast_to(0.3 + 1e-4 * GRID.axis, GRID.shape), atol=1e-6)
    path = write_ply(tmp_path / "b.ply", vertices, faces, 100 * albedo)
    with pytest.raises(InputError, match="albedo from 24 to 36; give normal albedo"):
        given_relief(path, GRID, GSD, "m", None)


def cut(vertices, faces, keep):
    return vertices, faces[keep(vertices[faces].mean(1)[:, 0], vertices[faces].mean(1)[:, 1])]


def roof(vertices, faces):
    """A second floor, 100 m above a tenth of the ground."""
    above = faces[np.abs(vertices[faces].mean(1)[:, :2] - 100.0).max(1) < 100.0]
    return np.concatenate([vertices, vertices + [0, 0, 100.0]]), np.concatenate([faces, above + len(vertices)])


FLAT = grid_mesh(lambda x, y: 0 * x)
BAD = {
    "too small": (grid_mesh(lambda x, y: 0 * x, 200.0), {}, "only within 2.. m of the site.* need 400 m.*--gsd 1"),
    "in kilometres": ((1e-3 * FLAT[0], FLAT[1]), {}, "--surface-unit km"),
    "in metres, not kilometres": (
        FLAT,
        {"unit": "km"},
        "too coarse: its facets are 1e.04 m wide.*check --surface-unit",
    ),
    "coarse": (grid_mesh(lambda x, y: 0 * x, 640.0, 80.0), {}, "too coarse: its facets are 80 m.*--gsd 26.7 or more"),
    "with a hole": (cut(*FLAT, lambda x, y: np.hypot(x - 200, y) > 40), {}, "without gaps only within 1.. m"),
    "nothing in the middle": (
        cut(*FLAT, lambda x, y: np.hypot(x - 5, y - 5) > 90),
        {"center": (60.0, 70.0, 0.0)},
        "only within|no ground at the site",
    ),
    "an overhang": (roof(*FLAT), {}, "not a height field: .* % of the ground lies under other ground"),
    "upside down": ((FLAT[0], FLAT[1][:, ::-1]), {}, "look downwards.*reverse"),
    "closed": (ball(), {}, "closed shape; choose a place"),
    "a centre far away": (FLAT, {"center": (0.0, 0.0, 9e4)}, "9e.04 m from --surface-center"),
    "a centre of two numbers": (FLAT, {"center": (0.0, 0.0)}, "takes 3 numbers"),
    "all of a small body": (ball(500.0), {"center": (0.0, 0.0, 500.0)}, "within|all ways"),
}


@pytest.mark.parametrize(("mesh", "options", "message"), BAD.values(), ids=BAD)
def test_ground_that_cannot_serve_is_refused(tmp_path, mesh, options, message):
    path = write_obj(tmp_path / "bad.obj", *mesh)
    with pytest.raises(InputError, match=message):
        given_relief(path, GRID, GSD, options.get("unit", "m"), options.get("center"))


def test_a_cloud_of_points_is_no_surface(tmp_path):
    path = write_ply(tmp_path / "points.ply", FLAT[0], FLAT[1][:0], np.full(len(FLAT[0]), 0.3))
    with pytest.raises(InputError, match="points without faces"):
        given_relief(path, GRID, GSD, "m", None)


def test_a_site_of_given_ground(tmp_path):
    """Images, truth and site.toml are of the ground in the file; the same options give the same bytes."""
    vertices, faces = grid_mesh(bumps, 1300.0, 20.0)
    path = write_obj(tmp_path / "bumps.obj", vertices, faces)
    options = SimulationOptions(surface=path, gsd=20.0, views=3, image_size=48, supersampling=1, pointing_jitter_px=2.0)
    site = read_site(simulate_site(options, tmp_path / "site"))
    truth = read_truth(tmp_path / "site" / "truth.h5")
    assert (site.name, truth.name, site.body) == ("bumps", "bumps", "vesta")
    assert np.linalg.norm(truth.views.body_from_cam.translation, axis=1).min() > 0.9 * 20.0 * 10714.0
    assert truth.surface.spacing == 10.0
    assert truth.surface.albedo.std() > 0.02
    image = read_image(tmp_path / "site" / truth.views.name[0]).brightness
    assert 0.05 < image.mean() < 0.4
    saved = (tmp_path / "site" / "simulation.toml").read_text()
    assert "body_from_surface_file" in saved
    again = simulate_site(options, tmp_path / "again").parent
    for file in sorted((tmp_path / "site").rglob("*.*")):
        assert file.read_bytes() == (again / file.relative_to(tmp_path / "site")).read_bytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gsd": 10.0}, "go with --surface"),
        ({"surface_center": (0.0, 0.0)}, "go with --surface"),
        ({"surface_unit": "ft"}, "surface_unit"),
        ({"surface": "a.obj", "gsd": -1.0}, "gsd must be positive"),
    ],
)
def test_impossible_options_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(SimulationOptions(), **change)
