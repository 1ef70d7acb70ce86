"""GeoTIFF maps of a scene on a known place: reference system, scale and orientation, and every pixel's value."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from photoclinometry.evaluate.compare import evaluate_against_truth
from photoclinometry.io.rasters.geotiff import read_dtm, read_dtm_mesh
from photoclinometry.io.rasters.globe import find_globe, geographic, name_of, semi_axes
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import Similarity, align_similarity, unit
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.output.export import ExportOptions
from photoclinometry.output.export.frame import Framed
from photoclinometry.output.export.maps import write_maps
from photoclinometry.output.export.plane import height_gradient, map_plane
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.simulate.truth import nearest_surface
from photoclinometry.simulate.truth_file import read_truth
from places import CRATERS, GSD, IAU_RADIUS, RADIUS, axes_at, cratered_place, height
from scenes import synthetic_scene

rasterio = pytest.importorskip("rasterio")

PROJECTIONS = ("equirectangular", "orthographic", "polar-stereographic")
PLACES = [(15.6, -9.4), (180.0, 40.0), (-44.2, -60.0)]
"""Longitude and latitude; polar stereographic maps are refused at the first."""


def on_body(place, **uncertainty):
    scene = replace(place.scene, uncertainty=uncertainty)
    return Framed(scene=transform_scene(place.body_from_scene, scene), globe=find_globe("vesta"), metric=True)


@pytest.mark.parametrize(
    ("lon", "lat", "projection"),
    [(*at, name) for at in PLACES for name in PROJECTIONS if name != "polar-stereographic" or at != PLACES[0]],
)
def test_known_craters_are_where_their_longitudes_and_latitudes_say(tmp_path, projection, lon, lat):
    from rasterio.warp import transform

    place = cratered_place(lon, lat)
    write_maps(tmp_path, on_body(place), ["dtm"], ExportOptions(projection=projection, resolution=30.0))
    with rasterio.open(tmp_path / "dtm.tif") as file:
        assert semi_axes(file.crs) == (IAU_RADIUS, IAU_RADIUS)
        assert name_of(file.crs).startswith("Vesta (2015) - Sphere / Ocentric")
        heights, geographic_crs = file.read(1), find_globe("vesta").crs
        at = []
        for crater in place.craters_deg:
            (x,), (y,) = transform(geographic_crs, file.crs, [crater[0]], [crater[1]])
            row, col = file.index(x, y)
            near = heights[row - 5 : row + 6, col - 5 : col + 6]
            lowest = np.unravel_index(np.argmin(near), near.shape)
            assert np.abs(np.array(lowest) - 5).max() <= 1  # the deepest pixel is the predicted one, or next to it
            assert near.min() == pytest.approx(RADIUS - IAU_RADIUS - 120.0, abs=1.0)
            at.append((row, col))
    if projection != "polar-stereographic":  # there, north is up on the central meridian only
        (north_row, north_col), (_, east_col), (_, west_col) = at
        assert west_col < north_col < east_col
        assert all(north_row < row for row, _ in at[1:])


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_every_pixel_of_the_height_map_is_on_the_true_ground(tmp_path, projection):
    """The ground between exact landmarks is known; linear interpolation is up to 1.4 m off."""
    place = cratered_place(200.0, 55.0)
    write_maps(tmp_path, on_body(place), ["dtm"], ExportOptions(projection=projection))
    mesh = read_dtm_mesh(tmp_path / "dtm.tif")
    east_north_up = axes_at(200.0, 55.0)
    x, y, z = (mesh.position @ east_north_up.T).T
    off = z - RADIUS - height(np.stack([x, y], -1))
    assert len(off) > 2500
    assert np.abs(off).max() < 0.1
    assert np.sqrt(np.mean(off**2)) < 0.01


def on_triangles(framed, file, *values):
    """A map's first band, and values of the landmarks as another program interpolates them linearly on the map."""
    from matplotlib.tri import LinearTriInterpolator, Triangulation

    lon, lat, _ = geographic(framed.globe, framed.scene.landmarks.position).T
    triangles = Triangulation(IAU_RADIUS * np.radians(lon), IAU_RADIUS * np.radians(lat), landmark_faces(framed.scene))
    with rasterio.open(file) as opened:
        found = opened.read(1, masked=True)
        rows, cols = np.indices(found.shape)
        x, y = (np.reshape(v, found.shape) for v in opened.xy(rows.ravel(), cols.ravel()))
    return found, *(LinearTriInterpolator(triangles, value)(x, y) for value in values)


def test_every_pixel_of_a_sigma_map_is_that_of_the_landmarks(tmp_path):
    place = cratered_place()
    sigma = 0.1 * place.scene.landmarks.albedo
    framed = on_body(place, albedo=sigma)
    write_maps(tmp_path, framed, ["sigma"], ExportOptions())
    found, expected = on_triangles(framed, tmp_path / "sigma_albedo.tif", sigma)
    np.testing.assert_array_equal(np.ma.getmaskarray(found), np.ma.getmaskarray(expected))
    assert 0.5 < (~np.ma.getmaskarray(found)).mean() < 1.0
    np.testing.assert_allclose(found.compressed(), expected.compressed(), rtol=1e-6)


def test_every_pixel_of_the_albedo_map_is_on_a_spline_through_the_landmarks(tmp_path):
    """By another program's spline, whose edges bend otherwise; waves of four landmarks keep their amplitude between
    these, of which a line between two takes three tenths."""
    place = cratered_place()
    row, col = place.scene.cells
    wavy = replace(place.scene.landmarks, albedo=0.2 + 0.1 * np.sin(0.5 * np.pi * col + 0.7))
    framed = on_body(replace(place, scene=replace(place.scene, landmarks=wavy)))
    write_maps(tmp_path, framed, ["albedo"], ExportOptions())
    found, rows, cols = on_triangles(framed, tmp_path / "albedo.tif", row.astype(float), col.astype(float))
    side = framed.scene.region.grid_shape[0]
    spline = RectBivariateSpline(np.arange(side), np.arange(side), framed.scene.grid(wavy.albedo))
    inside = (np.minimum(rows, cols) > 9) & (np.maximum(rows, cols) < side - 10)
    inside = inside.filled(False) & ~np.ma.getmaskarray(found)
    assert inside.sum() > 1000
    np.testing.assert_allclose(found[inside], spline.ev(rows[inside], cols[inside]), rtol=1e-4)
    wave = 0.2 + 0.1 * np.sin(0.5 * np.pi * cols[inside] + 0.7)
    assert np.abs(found[inside] - wave).max() < 0.01


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_normals_look_east_north_and_up_and_slopes_are_their_angles(tmp_path, projection):
    """In a bowl the ground rises outwards, so that normals look inwards: on its east side, west."""
    place = cratered_place(15.6, 70.0)
    write_maps(tmp_path, on_body(place), ["normals", "slope"], ExportOptions(projection=projection, resolution=30.0))
    with rasterio.open(tmp_path / "normals.tif") as file, rasterio.open(tmp_path / "slope.tif") as slopes:
        from rasterio.warp import transform

        east, north, up = axes_at(15.6, 70.0)
        for offset, axis, sign in (([200, 0], 0, -1), ([-200, 0], 0, 1), ([0, 200], 1, -1), ([0, -200], 1, 1)):
            xy = CRATERS[0] + offset
            lon, lat, _ = geographic(find_globe("vesta"), (xy[0] * east + xy[1] * north + RADIUS * up)[None])[0]
            (x,), (y,) = transform(find_globe("vesta").crs, file.crs, [lon], [lat])
            normal = next(file.sample([(x, y)]))
            slope = 120.0 * 200.0 / 260.0**2 * np.exp(-0.5 * (200.0 / 260.0) ** 2)
            expected = np.zeros(3)
            expected[axis], expected[2] = sign * slope, 1.0
            np.testing.assert_allclose(normal, unit(expected), atol=0.04)
            assert next(slopes.sample([(x, y)]))[0] == pytest.approx(np.degrees(np.arctan(slope)), abs=1.5)
        assert file.descriptions == ("normal, east", "normal, north", "normal, up")
        length = np.linalg.norm(file.read(masked=True).filled(np.nan), axis=0)
        np.testing.assert_allclose(length[np.isfinite(length)], 1.0, atol=1e-6)


def test_uncertainties_of_positions_are_taken_along_the_vertical(tmp_path):
    place = cratered_place()
    up_in_scene = place.body_from_scene.rotation.T @ axes_at(15.6, -9.4)[2]
    count, scale = len(place.scene.landmarks), place.body_from_scene.scale
    along = (1e-6 * np.eye(3) + np.outer(up_in_scene, up_in_scene)) * (7.0 / scale) ** 2
    stated = {"position": np.tile(along, (count, 1, 1)), "normal": np.full((count, 2), 0.02), "albedo": np.ones(count)}
    files = write_maps(tmp_path, on_body(place, **stated), ["sigma"], ExportOptions())
    assert set(files) == {"sigma_height.tif", "sigma_normal.tif", "sigma_albedo.tif"}
    angle = np.degrees(0.02 * np.sqrt(2.0))  # of both axes
    for name, value, unit_name in (("height", 7.0, "m"), ("normal", angle, "degree"), ("albedo", 1.0, None)):
        with rasterio.open(tmp_path / f"sigma_{name}.tif") as file:
            np.testing.assert_allclose(file.read(1, masked=True).compressed(), value, rtol=1e-4)
            assert file.units == (unit_name,)


def test_a_missing_landmark_stays_a_gap(tmp_path):
    place = cratered_place()
    framed = on_body(place)
    row, col = (place.scene.landmarks.pixel - place.scene.landmarks.pixel.min(0)).T
    hole = (np.abs(row - 30) <= 3) & (np.abs(col - 20) <= 3)
    pixel = place.scene.landmarks.pixel
    marks = framed.scene.landmarks
    kept = replace(marks, **{name: getattr(marks, name)[~hole] for name in ("position", "normal", "albedo", "pixel")})
    scene = replace(framed.scene, landmarks=kept)
    write_maps(tmp_path, replace(framed, scene=scene), ["dtm"], ExportOptions(resolution=GSD))
    dtm = read_dtm(tmp_path / "dtm.tif")
    x, y, _ = map_plane(framed, ExportOptions()).place[hole & (row == 30) & (col == 20)][0]
    col, row = int((x - dtm.corner[0]) / dtm.pixel[0]), int((dtm.corner[1] - y) / dtm.pixel[1])
    assert not dtm.valid[row - 2 : row + 3, col - 2 : col + 3].any()
    assert dtm.valid[row - 8 : row - 5, col].all()
    assert len(pixel) == len(kept) + hole.sum()


def test_ground_that_was_never_lit_has_an_albedo_and_no_measured_reflectance(tmp_path):
    scene = synthetic_scene(size=30, views=3)
    lit = scene.tracks.lit.copy()
    lit[3 * 435 : 3 * 438] = False  # three landmarks in the middle
    scene = replace(scene, tracks=replace(scene.tracks, lit=lit))
    framed = Framed(scene=scene, globe=None, metric=True)
    write_maps(tmp_path, framed, ["albedo", "reflectance"], ExportOptions())
    with rasterio.open(tmp_path / "albedo.tif") as albedo, rasterio.open(tmp_path / "reflectance.tif") as measured:
        missing = albedo.read_masks(1).astype(int) - measured.read_masks(1)
    assert missing.min() == 0
    assert 3 <= (missing > 0).sum() <= 16  # no more than the cells around them


def test_without_a_place_on_a_body_the_map_is_of_the_mean_plane(tmp_path):
    """Turning and shifting the scene changes nothing then. In metres it has an engineering CRS, else none at all."""
    scene = synthetic_scene(size=30, views=3)
    for metric in (True, False):
        framed = Framed(scene=scene, globe=None, metric=metric)
        files = write_maps(tmp_path, framed, ["dtm", "normals"], ExportOptions())
        with rasterio.open(tmp_path / "normals.tif") as file:
            assert file.descriptions == ("normal, x", "normal, y", "normal, up")
        assert "not north" in files["dtm.tif"]
        with rasterio.open(tmp_path / "dtm.tif") as file:
            first = file.read(1)
            assert file.res[0] == pytest.approx(scene.gsd, rel=5e-3)
            assert file.units == ("m" if metric else None,)
            if metric:
                assert file.crs.to_dict(projjson=True)["type"] == "EngineeringCRS"
            else:
                assert file.crs is None
    turned = transform_scene(Similarity(1.0, axes_at(20.0, 30.0), np.array([5e3, -2e3, 1e3])), scene)
    write_maps(tmp_path, Framed(scene=turned, globe=None, metric=True), ["dtm"], ExportOptions())
    with rasterio.open(tmp_path / "dtm.tif") as file:
        np.testing.assert_allclose(file.read(1), first, atol=1e-3)


def test_the_upper_edge_of_a_local_map_is_that_of_the_reference_image(tmp_path):
    scene = synthetic_scene(size=30, views=3)
    plane = map_plane(Framed(scene=scene, globe=None, metric=True), ExportOptions())
    row, col = scene.landmarks.pixel.T
    assert np.corrcoef(plane.place[:, 0], col)[0, 1] > 0.99
    assert np.corrcoef(plane.place[:, 1], -row)[0, 1] > 0.99


def test_gradients_on_a_map_are_those_of_its_heights():
    """A sphere seen from above has no slope on a map of it; a plane has its own slope on its own map."""
    rng = np.random.default_rng(0)
    direction = unit(rng.normal(size=(50, 3)))
    globe = find_globe("vesta")

    def place_of(points):
        lon, lat, up = geographic(globe, points).T
        return np.stack([IAU_RADIUS * np.radians(lon), IAU_RADIUS * np.radians(lat), up], -1)

    found = height_gradient(place_of, 260e3 * direction, direction, 0.1)
    np.testing.assert_allclose(found, 0.0, atol=1e-6)
    normal = unit(np.stack([np.full(50, -0.3), np.full(50, 0.5), np.ones(50)], -1))
    np.testing.assert_allclose(height_gradient(lambda p: p, rng.normal(size=(50, 3)), normal, 0.1), [[0.3, -0.5]] * 50)
    upright = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.01], [0.0, 0.0, 1.0]])
    steep = height_gradient(lambda p: p, np.zeros((3, 3)), upright, 0.1)
    np.testing.assert_allclose(np.linalg.norm(steep, axis=-1), [0.0, np.tan(np.radians(70.0)), 0.0], atol=1e-6)


def test_the_height_map_of_a_mapped_site_is_as_near_the_truth_as_its_landmarks(tmp_path, mapped):
    """A simulated site, mapped from its images, put on its true place on Vesta, exported, and read again."""
    scene, truth = mapped.result.scene, read_truth(mapped.truth)
    aligned = evaluate_against_truth(scene, truth).aligned.landmarks.position
    here = Similarity(1.0, axes_at(15.6, -9.4).T, 262e3 * axes_at(15.6, -9.4)[2])
    body_from_scene = here @ align_similarity(scene.landmarks.position, aligned)
    framed = Framed(scene=transform_scene(body_from_scene, scene), globe=find_globe("vesta"), metric=True)
    write_maps(tmp_path, framed, ["dtm"], ExportOptions())
    on_map = here.inverse()(read_dtm_mesh(tmp_path / "dtm.tif").position)

    def rms(points):
        return np.sqrt(np.mean(nearest_surface(truth.surface, points)[0] ** 2))

    assert len(on_map) > 0.8 * len(aligned)
    assert rms(on_map) < 1.01 * rms(aligned)


def test_scattered_landmarks_make_no_map(tmp_path):
    framed = on_body(cratered_place())
    marks = framed.scene.landmarks
    few = replace(marks, **{n: getattr(marks, n)[::700] for n in ("position", "normal", "albedo", "pixel")})
    with pytest.raises(InputError, match="no surface to map"):
        write_maps(tmp_path, replace(framed, scene=replace(framed.scene, landmarks=few)), ["dtm"], ExportOptions())
    assert not list(tmp_path.iterdir())
