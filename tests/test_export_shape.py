"""Products of a whole body: every file is read back by another program or another way, and says the same."""

import json
from dataclasses import replace

import numpy as np
import pytest

from archives import SHARED
from commands import phomo
from eggs import egg_model
from photoclinometry.io.meshes.obj import read_obj
from photoclinometry.io.meshes.shape_ply import read_shape_ply, write_shape_ply
from photoclinometry.io.models.icq import icq_faces, read_icq
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import unit
from photoclinometry.model.owner import Owner
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.export.options import ExportOptions
from photoclinometry.output.export.shape import levels
from photoclinometry.output.export.shape.export import export_shape
from photoclinometry.output.export.shape.models import nearest_q
from photoclinometry.output.export.shape.options import ShapeOptions
from photoclinometry.surface.closed_mesh import is_watertight, signed_volume
from photoclinometry.surface.radial_rays import RadialRays

COMET = SHARED / "shapes" / "67p.obj"


@pytest.fixture(scope="module")
def egg():
    return egg_model()


@pytest.fixture(scope="module")
def exported(egg, tmp_path_factory):
    """The folder of all products of the egg, and what export.json holds."""
    pytest.importorskip("rasterio")
    pytest.importorskip("spiceypy")
    out = tmp_path_factory.mktemp("egg") / "out"
    return out, export_shape(egg, out, ExportOptions(body="bennu", resolution=20.0), ShapeOptions(icq_q=64))


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


def test_what_is_not_possible_is_told(egg, tmp_path):
    about = export_shape(replace(egg, unit=None), tmp_path / "out")
    assert set(about["files"]) == {"shape_4k.obj", "shape_4k.ply", "shape_4k.glb", "properties.json"}
    assert set(about["not_possible"]) == {"icq", "dsk", "maps", "fits"}
    assert about["not_possible"]["icq"] == "its unit of length is unknown; give --unit-m"


def test_a_body_that_spice_does_not_know_costs_the_dsk_alone(egg, tmp_path):
    pytest.importorskip("spiceypy")
    about = export_shape(egg, tmp_path / "out", ExportOptions(body="egg", resolution=40.0))
    assert "shape.bds" not in about["files"]
    assert "SPICE knows no body 'egg'; give its code with --naif-id" in about["not_possible"]["dsk"]
    with pytest.raises(InputError, match=r"cannot be exported as dsk: .* knows no body 'egg'"):
        export_shape(egg, tmp_path / "out", ExportOptions(body="egg", products=("dsk",)))


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


@pytest.mark.parametrize("given", [{"density_kg_m3": 1000.0}, {"correlation_m": 5.0}])
def test_what_is_in_metres_needs_a_model_in_metres(egg, tmp_path, given):
    with pytest.raises(InputError, match=r"body\.ply: its unit is not known: --.* goes with --unit-m"):
        export_shape(
            replace(egg, unit=None), tmp_path / "out", ExportOptions(products=("properties",)), ShapeOptions(**given)
        )
    assert not (tmp_path / "out").exists()


def test_maps_finer_than_memory_allows_are_refused(egg, tmp_path):
    pytest.importorskip("rasterio")
    with pytest.raises(InputError, match=r"--resolution 0\.001 m makes a map of more than .* pixels"):
        export_shape(egg, tmp_path / "out", ExportOptions(products=("maps",), resolution=0.001))


def test_names_outside_of_ascii_are_written_with_marks(egg, tmp_path):
    export_shape(egg, tmp_path / "out", ExportOptions(products=("fits",), body="Bénnu"), name="körper.ply")
    assert list((tmp_path / "out").glob("*.fits"))


def test_options_of_bodies_are_refused_for_places(tmp_path, capsys):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "scene.h5").write_bytes(b"-")
    assert phomo("export", tmp_path / "run", "--out", tmp_path / "out", "--density-kg-m3", 1000) == 2
    assert "--density-kg-m3 is for a whole body (a folder with body.ply)" in " ".join(capsys.readouterr().err.split())


def test_an_export_of_another_body_is_replaced_only_where_that_is_asked_for(egg, tmp_path):
    out, ply = tmp_path / "out", ExportOptions(products=("ply",))
    site, other = (Owner("site", "egg", None, "", (f"{name}0", f"{name}1")) for name in ("a", "b"))
    for _ in range(2):
        export_shape(egg, out, ply, owner=site)
    with pytest.raises(RunFolderError, match=r"holds an export of the site 'egg' \(2 images\); this is the site 'egg'"):
        export_shape(egg, out, ply, owner=other)
    with pytest.raises(RunFolderError, match=r"this is the body 'body\.ply'"):
        export_shape(egg, out, ply)
    export_shape(egg, out, ply, overwrite=True)
    export_shape(egg, out, ply)
