"""Products of a whole body: every file is read back by another program or another way, and says the same."""

import json
from dataclasses import replace

import numpy as np
import pytest

from archives import SHARED
from commands import phomo
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.io.meshes.shape_ply import read_shape_ply, write_shape_ply
from photoclinometry.io.models.icq import icq_faces, read_icq
from photoclinometry.io.rasters.globe import find_globe
from photoclinometry.io.rasters.projection import body_projections
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import unit
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.export.options import ExportOptions
from photoclinometry.output.export.shape import levels
from photoclinometry.output.export.shape.export import export_shape
from photoclinometry.output.export.shape.maps import directions, map_grids
from photoclinometry.output.export.shape.models import nearest_q
from photoclinometry.output.export.shape.options import ShapeOptions
from photoclinometry.surface.closed_mesh import icosahedron, is_watertight, refine, signed_volume
from photoclinometry.surface.polyhedron_gravity import GRAVITATIONAL_CONSTANT as G
from photoclinometry.surface.radial_rays import RadialRays

COMET = SHARED / "shapes" / "67p.obj"
DENSITY, RADIUS = 1190.0, 250.0
GEO = ("maps", "dsk")


def egg_like(direction, faces, growth=(0.25, 0.15, 0.1)):
    a, b, c = growth
    x, y, z = direction.T
    return ShapeModel(
        vertices=RADIUS * (1.0 + a * x + b * x * y + c * z * z)[:, None] * direction,
        faces=faces,
        normals=None,
        albedo=0.04 + 0.01 * x,
        sigma={"height": 0.1 + 0.05 * y, "normal": np.full(len(x), 0.02), "albedo": np.full(len(x), 0.03)},
        views=(10 * (z + 1)).astype(np.int32),
        tile=np.zeros(len(x), np.int32),
        unit="m",
    )


@pytest.fixture(scope="module")
def egg():
    return egg_like(*refine(*icosahedron(), 0.1, unit))


@pytest.fixture(scope="module")
def ball():
    return egg_like(*refine(*icosahedron(), 0.1, unit), growth=(0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def exported(egg, tmp_path_factory):
    """The folder of all products of the egg, and what export.json holds."""
    pytest.importorskip("rasterio")
    pytest.importorskip("spiceypy")
    out = tmp_path_factory.mktemp("egg") / "out"
    about = export_shape(
        egg,
        out,
        ExportOptions(body="bennu", resolution=10.0),
        ShapeOptions(density_kg_m3=DENSITY, spin_period_h=4.3, icq_q=64),
    )
    return out, about


def test_all_products_are_there_and_named(exported):
    out, about = exported
    assert set(about["files"]) | {"export.json"} == {path.name for path in out.iterdir()}
    assert {"shape_4k.obj", "SHAPE.TXT", "shape.bds", "maps", "global.fits", "properties.json"} <= set(about["files"])
    assert json.loads((out / "export.json").read_text())["files"] == about["files"]
    assert about["not_possible"] == {}


def test_coarser_levels_are_closed_and_carry_what_is_known(egg, monkeypatch):
    """Of 4,640 facets 1,000: albedo and standard deviations are those of the place, and normals those of the egg."""
    monkeypatch.setattr(levels, "LEVELS", (1000, 100_000))
    coarse, whole = levels.levels_of(replace(egg, normals=unit(egg.vertices)))
    assert whole.shape.faces is egg.faces
    assert coarse.name == "1k"
    assert len(coarse.shape.faces) == pytest.approx(1000, abs=2)
    assert is_watertight(coarse.shape.faces)
    direction = unit(coarse.shape.vertices)
    np.testing.assert_allclose(coarse.shape.albedo, 0.04 + 0.01 * direction[:, 0], atol=2e-4)
    np.testing.assert_allclose(coarse.shape.sigma["height"], 0.1 + 0.05 * direction[:, 1], atol=1e-3)
    np.testing.assert_allclose(np.sum(coarse.shape.normals * direction, -1), 1.0, atol=1e-3)
    assert np.abs(coarse.shape.views - 10 * (direction[:, 2] + 1)).max() < 2.0
    assert signed_volume(coarse.shape.vertices, coarse.shape.faces) == pytest.approx(
        signed_volume(egg.vertices, egg.faces), rel=0.01
    )


def test_meshes_are_those_of_the_model(exported, egg):
    out, _ = exported
    vertices, faces = read_obj(out / "shape_4k.obj")
    np.testing.assert_array_equal(vertices, egg.vertices)
    np.testing.assert_array_equal(faces, egg.faces)
    read = read_shape_ply(out / "shape_4k.ply")
    np.testing.assert_array_equal(read.vertices, egg.vertices)
    np.testing.assert_allclose(read.sigma["height"], egg.sigma["height"], rtol=1e-6)
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.load(out / "shape_4k.glb")
    mesh = scene.to_geometry() if hasattr(scene, "to_geometry") else scene.dump(concatenate=True)
    assert mesh.volume == pytest.approx(signed_volume(egg.vertices, egg.faces), rel=1e-5)
    data = (out / "shape_4k.glb").read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    assert set(attributes) == {"POSITION", "NORMAL", "_ALBEDO", "COLOR_0"}


def test_the_icq_model_lies_on_the_surface(exported, egg):
    out, _ = exported
    vertices = 1e3 * read_icq(out / "SHAPE.TXT")
    radius, _, _ = RadialRays(egg.vertices, egg.faces).outermost(unit(vertices.reshape(-1, 3)))
    np.testing.assert_allclose(np.linalg.norm(vertices.reshape(-1, 3), axis=1), radius, atol=1e-4)
    # Its chords cut the edges of the model.
    volume = signed_volume(vertices.reshape(-1, 3), icq_faces(64))
    assert volume == pytest.approx(signed_volume(egg.vertices, egg.faces), rel=1e-3)


@pytest.mark.parametrize(("facets", "q"), [(10, 64), (49_152, 64), (120_000, 128), (3_145_728, 512), (10**7, 512)])
def test_q_is_that_of_the_facets(facets, q):
    assert nearest_q(facets) == q


def test_spice_finds_the_surface_of_the_kernel(exported, egg):
    spice = pytest.importorskip("spiceypy")
    out, _ = exported
    d = unit(np.random.default_rng(0).normal(size=(50, 3)))
    spice.furnsh(str(out / "shape.bds"))
    points, _ = spice.dskxv(False, "BENNU", [], 0.0, "IAU_BENNU", 2.0 * d, -d)
    spice.kclear()
    radius, _, _ = RadialRays(egg.vertices, egg.faces).outermost(d)
    np.testing.assert_allclose(points, 1e-3 * radius[:, None] * d, atol=1e-9)


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
    from photoclinometry.io.rasters.globe import semi_axes

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


def test_gravity_of_a_still_ball_is_that_of_a_sphere(ball, tmp_path):
    from astropy.io import fits

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


def test_what_is_not_possible_is_told(egg, tmp_path):
    about = export_shape(replace(egg, unit=None), tmp_path / "out")
    assert set(about["files"]) == {"shape_4k.obj", "shape_4k.ply", "shape_4k.glb", "properties.json"}
    assert set(about["not_possible"]) == {"icq", "dsk", "maps", "fits"}
    assert about["not_possible"]["icq"] == "its unit of length is unknown; give --unit-m"


def test_a_model_in_kilometres_is_exported_in_metres(egg, tmp_path):
    small = replace(egg, vertices=1e-3 * egg.vertices, unit=None)
    export_shape(small, tmp_path / "out", ExportOptions(products=("ply",), unit_m=1000.0))
    np.testing.assert_allclose(read_shape_ply(tmp_path / "out" / "shape_4k.ply").vertices, egg.vertices, rtol=1e-12)
    with pytest.raises(InputError, match="in m already: leave out --unit-m"):
        export_shape(egg, tmp_path / "no", ExportOptions(unit_m=1000.0))


@pytest.mark.skipif(not COMET.is_file(), reason="no ../shared/data/shapes/67p.obj beside the repository")
def test_a_concave_body_has_no_icq_model(tmp_path):
    vertices, faces = read_obj(COMET)
    comet = ShapeModel(1e3 * vertices, faces, unit="m")
    with pytest.raises(InputError, match=r"67p.*cannot be exported as icq: some directions .* more than once"):
        export_shape(comet, tmp_path / "out", ExportOptions(products=("icq",)), name="67p")
    about = export_shape(comet, tmp_path / "out", ExportOptions(products=("fits", "ply")), name="67p")
    assert set(about["files"]) == {"global.fits", "facets.fits", "shape_18k.ply"}


def test_a_body_beside_its_origin_has_no_maps(egg, tmp_path):
    beside = replace(egg, vertices=egg.vertices + [1e4, 0.0, 0.0])
    with pytest.raises(InputError, match="the origin is not inside"):
        export_shape(beside, tmp_path / "out", ExportOptions(products=("fits",)))


def test_open_and_inward_meshes_are_refused(egg, tmp_path):
    with pytest.raises(InputError, match="not a closed mesh"):
        export_shape(replace(egg, faces=egg.faces[1:]), tmp_path / "out")
    with pytest.raises(InputError, match="look inwards"):
        export_shape(replace(egg, faces=egg.faces[:, ::-1]), tmp_path / "out")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (ExportOptions(products=("dtm",)), "dtm is a product of the map of a place; of a whole body: obj, ply"),
        (ExportOptions(projection="orthographic"), "--projection is for the map of a place"),
        (ExportOptions(body_fixed=True), "--body-fixed is for the map of a place"),
    ],
)
def test_options_of_places_are_refused(egg, tmp_path, options, says):
    with pytest.raises(InputError, match=says):
        export_shape(egg, tmp_path / "out", options)


def test_folders_of_others_are_left_alone(egg, tmp_path):
    (tmp_path / "thesis.txt").write_text("-")
    with pytest.raises(RunFolderError, match=r"holds thesis.txt, which no earlier export wrote"):
        export_shape(egg, tmp_path, ExportOptions(products=("ply",)))


def test_the_command_takes_a_body_folder(egg, tmp_path, capsys):
    write_shape_ply(tmp_path / "body" / "body.ply", egg)
    given = ("--products", "ply", "properties", "--density-kg-m3", 1190, "--correlation-m", 50, "--gravity-facets", 500)
    assert phomo("export", tmp_path / "body", "--out", tmp_path / "out", *given) == 0
    said = capsys.readouterr()
    assert said.out.strip() == str(tmp_path / "out")
    assert "shape_4k.ply: 4,640 facets" in said.err
    assert json.loads((tmp_path / "out" / "properties.json").read_text())["sigma"]["correlation_length_m"] == 50.0
    assert phomo("export", tmp_path / "body" / "body.ply", "--out", tmp_path / "two", "--products", "ply") == 0


def test_options_of_bodies_are_refused_for_places(tmp_path, capsys):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "scene.h5").write_bytes(b"-")
    assert phomo("export", tmp_path / "run", "--out", tmp_path / "out", "--density-kg-m3", 1000) == 2
    assert "--density-kg-m3 is for a whole body (a folder with body.ply)" in " ".join(capsys.readouterr().err.split())
