"""Maps, planes, gravity and mass properties of a whole body: read back, they say what the model does."""

import json

import numpy as np
import pytest

from eggs import RADIUS, egg_model
from photoclinometry.io.rasters.globe import find_globe, semi_axes
from photoclinometry.io.rasters.projection import body_projections
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import unit
from photoclinometry.output.export.options import ExportOptions
from photoclinometry.output.export.shape.export import export_shape
from photoclinometry.output.export.shape.maps import directions, map_grids
from photoclinometry.output.export.shape.options import ShapeOptions
from photoclinometry.surface.closed_mesh import signed_volume
from photoclinometry.surface.polyhedron_gravity import GRAVITATIONAL_CONSTANT as G
from photoclinometry.surface.radial_rays import RadialRays

DENSITY = 1190.0


@pytest.fixture(scope="module")
def egg():
    return egg_model()


@pytest.fixture(scope="module")
def exported(egg, tmp_path_factory):
    """The folder of the egg's maps, planes and properties, and what export.json holds."""
    pytest.importorskip("rasterio")
    out = tmp_path_factory.mktemp("egg") / "out"
    options = ExportOptions(products=("maps", "fits", "properties"), body="bennu", resolution=10.0)
    return out, export_shape(egg, out, options, ShapeOptions(density_kg_m3=DENSITY, spin_period_h=4.3))


@pytest.mark.parametrize("radii", [(245.0,), (280.0, 240.0)])
def test_directions_of_pixels_are_those_of_proj(radii):
    pytest.importorskip("rasterio")
    projections = body_projections(find_globe("egg", radii))
    for name, grid in map_grids(radii[0], np.pi * radii[0] / 36).items():
        d, shown = directions(name, grid, radii[0])
        at = np.concatenate([grid.pixel_centers()[shown], np.zeros((shown.sum(), 1))], -1)
        np.testing.assert_allclose(d[shown], unit(projections[name].to_body(at)), atol=1e-9)


@pytest.mark.parametrize("name", ["cylindrical", "north", "south"])
def test_maps_read_back_show_the_surface(exported, egg, name):
    """At pixels, by the file's own reference system: radius, height above the sphere, albedo, standard deviation."""
    rasterio = pytest.importorskip("rasterio")
    out, _ = exported
    with rasterio.open(out / "maps" / f"radius_{name}.tif") as file:
        radius, transform, sphere = file.read(1), file.transform, file.crs
    row, col = np.nonzero(np.isfinite(radius))
    chosen = np.random.default_rng(0).choice(len(row), 200, replace=False)
    row, col = row[chosen], col[chosen]
    x, y = (
        transform @ (col + 0.5, row + 0.5) if hasattr(transform, "__matmul__") else transform * (col + 0.5, row + 0.5)
    )
    projection = body_projections(find_globe("bennu", _sphere_of(sphere)))[name]
    d = unit(projection.to_body(np.stack([x, y, np.zeros(len(x))], -1)))
    expected, face, weight = RadialRays(egg.vertices, egg.faces).outermost(d)
    np.testing.assert_allclose(radius[row, col], expected, rtol=1e-6)

    def at(quantity):
        with rasterio.open(out / "maps" / f"{quantity}_{name}.tif") as file:
            assert file.crs == sphere
            return file.read(1)[row, col]

    np.testing.assert_allclose(at("height"), expected - projection.globe.radii_m[0], atol=1e-4)
    corner = egg.faces[face]
    np.testing.assert_allclose(at("albedo"), np.einsum("nk,nk->n", weight, egg.albedo[corner]), rtol=1e-6)
    np.testing.assert_allclose(
        at("sigma_height"), np.einsum("nk,nk->n", weight, egg.sigma["height"][corner]), rtol=1e-6
    )
    np.testing.assert_allclose(at("sigma_normal"), np.degrees(0.02), rtol=1e-6)
    np.testing.assert_allclose(at("sigma_albedo"), 3.0, rtol=1e-6)
    assert set(at("views")) <= set(egg.views)
    assert (at("slope") >= 0).all()


def _sphere_of(crs):
    return (semi_axes(crs)[0],)


def test_the_reference_sphere_is_that_of_the_volume(exported, egg):
    """Bennu is not in IAU_2015."""
    _, about = exported
    radius = np.cbrt(0.75 / np.pi * signed_volume(egg.vertices, egg.faces))
    assert f"on a sphere of {radius:.4g} m" in about["files"]["maps"]


def test_planes_are_named_as_altwg_names_them(exported, egg):
    from astropy.io import fits

    out, _ = exported
    with fits.open(out / "global.fits") as hdus:
        header, cube = hdus[0].header, hdus[0].data.astype(float)
    names = [header[f"PLANE{n}"] for n in range(1, len(cube) + 1)]
    assert names[:9] == [
        *("Latitude of vertices", "Longitude of vertices", "Radius of vertices"),
        *(f"{axis} coordinate of vertices" for axis in "XYZ"),
        *(f"Normal vector {axis}" for axis in "XYZ"),
    ]
    assert names[9:16] == [
        *(f"Gravity vector {axis}" for axis in "XYZ"),
        *("Gravitational magnitude", "Gravitational potential", "Elevation", "Slope"),
    ]
    assert header.comments["PLANE3"] == "[km]"
    plane = dict(zip(names, cube, strict=True))
    assert header["MINLAT"] == pytest.approx(plane["Latitude of vertices"][0, 0], abs=1e-4)
    assert plane["Longitude of vertices"][0, 0] == pytest.approx(header["MINLON"], abs=1e-4)
    lat, lon = np.radians(plane["Latitude of vertices"]), np.radians(plane["Longitude of vertices"])
    d = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    position = np.stack([plane[f"{axis} coordinate of vertices"] for axis in "XYZ"], -1)
    np.testing.assert_allclose(position, plane["Radius of vertices"][..., None] * d, atol=1e-6)
    radius, _, _ = RadialRays(egg.vertices, egg.faces).outermost(unit(position.reshape(-1, 3)))
    np.testing.assert_allclose(1e3 * plane["Radius of vertices"].ravel(), radius, rtol=1e-5)
    vector = np.stack([plane[f"Gravity vector {axis}"] for axis in "XYZ"], -1)
    np.testing.assert_allclose(np.linalg.norm(vector, axis=-1), plane["Gravitational magnitude"], rtol=1e-5)
    np.testing.assert_allclose(
        plane["Elevation"],
        (plane["Gravitational potential"] - header["REF_POT"]) / plane["Gravitational magnitude"],
        atol=0.01,
    )
    assert header["DENSITY"] == DENSITY
    assert header["ROT_RATE"] == pytest.approx(2.0 * np.pi / (4.3 * 3600.0))


def test_the_table_of_facets_has_the_same_quantities(exported, egg):
    from astropy.io import fits

    out, _ = exported
    with fits.open(out / "facets.fits") as hdus:
        table, header = hdus[1].data, hdus[1].header
        names = hdus[1].columns.names
        middle = np.stack([table[f"{axis} coordinate of vertices"] for axis in "XYZ"], -1)
        potential, area = np.array(table["Gravitational potential"]), np.array(table["Facet Area"])
    assert names[0] == "Facet number"
    np.testing.assert_allclose(1e3 * middle, egg.vertices[egg.faces].mean(1), atol=1e-9)
    assert header["REF_POT"] == pytest.approx((area * potential).sum() / area.sum(), rel=1e-3)
    assert (potential < 0).all()


def test_gravity_of_a_still_ball_is_that_of_a_sphere(tmp_path):
    from astropy.io import fits

    ball = egg_model(growth=(0.0, 0.0, 0.0))
    export_shape(ball, tmp_path / "out", ExportOptions(products=("fits",)), ShapeOptions(density_kg_m3=DENSITY))
    with fits.open(tmp_path / "out" / "facets.fits") as hdus:
        table = hdus[1].data
        np.testing.assert_allclose(
            table["Gravitational magnitude"], 4.0 / 3.0 * np.pi * G * DENSITY * RADIUS, rtol=0.01
        )
        potential = -4.0 / 3.0 * np.pi * G * DENSITY * RADIUS**2
        np.testing.assert_allclose(table["Gravitational potential"], potential, rtol=0.005)
        assert np.max(table["Slope"]) < 2.0


def test_properties_state_their_assumption(exported, egg):
    out, _ = exported
    found = json.loads((out / "properties.json").read_text())
    assert found["volume_m3"] == pytest.approx(signed_volume(egg.vertices, egg.faces))
    assert found["mass_kg"] == pytest.approx(DENSITY * found["volume_m3"])
    independent, stated, common = (
        found[name]["volume_m3"]
        for name in ("sigma_if_errors_are_independent", "sigma", "sigma_if_all_share_one_error")
    )
    assert independent < stated < common
    assert found["sigma"]["correlation_length_m"] == pytest.approx(0.1 * found["mean_radius_m"])
    assert "correlation" in found["assumption"]


def test_without_density_nothing_is_said_of_gravity(egg, tmp_path):
    pytest.importorskip("rasterio")
    about = export_shape(egg, tmp_path / "out", ExportOptions(products=("maps", "fits"), resolution=40.0))
    names = {path.name.split("_cyl")[0] for path in (tmp_path / "out" / "maps").glob("*_cylindrical.tif")}
    assert names == {"radius", "height", "tilt", "albedo", "sigma_height", "sigma_normal", "sigma_albedo", "views"}
    assert "not_possible" in about
    with pytest.raises(InputError, match="SPICE needs to know which body"):
        export_shape(egg, tmp_path / "dsk", ExportOptions(products=("dsk",)))
