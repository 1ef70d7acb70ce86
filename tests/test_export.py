"""`phomo export`: every product read back with what its users read it with, and a folder that is whole or as it was."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from commands import phomo
from photoclinometry.io.meshes.ply import read_ply
from photoclinometry.io.models.sumfile import read_sumfile, sumfile_of_view
from photoclinometry.io.models.text_model import read_text_model
from photoclinometry.io.rasters.globe import geographic
from photoclinometry.io.scene_file import write_scene
from photoclinometry.io.similarity import write_similarity
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import so3_exp
from photoclinometry.model.mesh import landmark_faces
from photoclinometry.output.export import ExportOptions, export_scene
from photoclinometry.output.export.formats import FORMATS, Format
from photoclinometry.output.export.meshes import albedo_texture, srgb
from photoclinometry.output.export.sumfiles import sumfile_names, with_sigmas
from places import cratered_place
from scenes import synthetic_scene

rasterio = pytest.importorskip("rasterio")
trimesh = pytest.importorskip("trimesh")

MAPS = {"dtm.tif", "normals.tif", "slope.tif", "albedo.tif", "reflectance.tif"}
OTHERS = {"viewer.html", "mesh.obj", "mesh.mtl", "mesh.png", "mesh.glb", "landmarks.ply", "sparse", "model", "sumfiles"}
TABLES = {"landmarks.csv", "views.csv"}


@pytest.fixture(scope="module")
def place():
    return cratered_place(size=30)


@pytest.fixture(scope="module")
def exported(place, tmp_path_factory):
    """The folder of an export in the body-fixed frame, and the scene there."""
    from photoclinometry.registration.alignment import transform_scene

    folder = tmp_path_factory.mktemp("exported")
    transform = folder / "body_from_scene.toml"
    write_similarity(transform, place.body_from_scene)
    count = len(place.scene.landmarks)
    scene = replace(place.scene, uncertainty={"position": np.full(count, 0.1), "albedo": np.full(count, 0.01)})
    export_scene(scene, folder / "out", ExportOptions(transform=transform, body="vesta"))
    return folder / "out", transform_scene(place.body_from_scene, scene)


def rows_of(path):
    with open(path, newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_noise_below_zero_does_not_keep_a_map_from_being_exported(place, tmp_path):
    """The authors' format marks what is not lit by negative brightness; the whole export was refused for it."""
    tracks = place.scene.tracks
    brightness = tracks.brightness.copy()
    brightness[:3] = -1e-4
    scene = replace(place.scene, tracks=replace(tracks, brightness=brightness, lit=np.ones(len(brightness), bool)))
    files = export_scene(scene, tmp_path / "out", ExportOptions(products=("text-model",)))["files"]
    assert "3 keypoints of negative brightness are marked as not lit" in files["model"]
    assert (~read_text_model(tmp_path / "out" / "model").scene.tracks.lit).sum() == 3


def test_everything_that_there_is_is_written_and_named(exported):
    out, _ = exported
    expected = MAPS | OTHERS | TABLES | {"sigma_height.tif", "sigma_albedo.tif"}
    assert {path.name for path in out.iterdir()} == expected | {"export.json"}
    about = json.loads((out / "export.json").read_text())
    assert set(about["files"]) == expected
    assert about["frame"].startswith("body-fixed")
    assert about["options"]["body"] == "vesta"
    assert about["files"]["dtm.tif"].startswith("height above a sphere of 255000 m; Vesta (2015)")


def test_all_maps_have_one_grid(exported):
    out, _ = exported
    places = set()
    for path in out.glob("*.tif"):
        with rasterio.open(path) as file:
            places.add((file.crs.to_authority(), file.transform, file.shape))
            assert file.tags()["SCENE"] == "bumps"
    assert len(places) == 1
    assert places.pop()[0] == ("IAU_2015", "200000410")


def test_meshes_have_the_ground_where_it_is(exported):
    out, scene = exported
    marks, faces = scene.landmarks, landmark_faces(scene)
    obj = trimesh.load(out / "mesh.obj", process=False, maintain_order=True)
    np.testing.assert_array_equal(obj.vertices, marks.position)
    np.testing.assert_array_equal(obj.faces, faces)
    glb = trimesh.load(out / "mesh.glb", process=False).to_geometry()
    np.testing.assert_allclose(glb.vertices[:, [0, 2, 1]] * (1, -1, 1), marks.position, rtol=0, atol=1e-3)
    assert (np.sum(obj.face_normals * marks.normal[faces[:, 0]], -1) > 0).all()  # faces look outwards
    ply = read_ply(out / "landmarks.ply")
    np.testing.assert_array_equal(ply.position, marks.position)
    assert len(trimesh.load(out / "landmarks.ply", process=False).faces) == len(ply.faces)


def test_the_texture_is_the_albedo_at_every_vertex(exported):
    """Decoded from sRGB and multiplied with its peak; half a level of 255 is at most 0.5 % of the peak."""
    out, scene = exported
    obj = trimesh.load(out / "mesh.obj", process=False, maintain_order=True)
    image = np.array(obj.visual.material.image.convert("L")) / 255.0
    height, width = image.shape
    col, row = np.floor(obj.visual.uv * (width, -height) + (0, height)).astype(int).T
    linear = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
    albedo = scene.landmarks.albedo
    np.testing.assert_allclose(linear[row, col] * albedo.max(), albedo, atol=5e-3 * albedo.max())


def test_colmap_reads_the_model_with_every_landmark(exported):
    import pycolmap

    out, scene = exported
    model = pycolmap.Reconstruction(out / "sparse")
    assert model.num_points3D() == len(scene.landmarks)
    position = np.array([model.points3D[j + 1].xyz for j in range(len(scene.landmarks))])
    np.testing.assert_array_equal(position, scene.landmarks.position)
    for k, name in enumerate(scene.views.name):
        image = model.find_image_with_name(name)
        np.testing.assert_allclose(image.projection_center(), scene.views.body_from_cam.translation[k], rtol=1e-9)


def test_the_authors_model_reads_back(exported):
    out, scene = exported
    found = read_text_model(out / "model").scene
    np.testing.assert_array_equal(found.landmarks.position, scene.landmarks.position)
    np.testing.assert_array_equal(found.landmarks.albedo, scene.landmarks.albedo)
    np.testing.assert_allclose(found.views.sun, scene.views.sun, atol=1e-12)


def test_sumfiles_have_the_cameras_where_they_are(exported):
    out, scene = exported
    for k, name in enumerate(scene.views.name):
        found = read_sumfile(out / "sumfiles" / (name.split("/")[-1].replace(".fits", ".SUM")))
        assert (found.name, found.utc) == (f"{k:03d}", "UNKNOWN")
        np.testing.assert_allclose(found.sun, scene.views.sun[k], atol=1e-10)
        pose = found.body_from_axes
        x, y, z = pose.inverse()(scene.landmarks.position / 1e3).T
        u, v = found.focal_mm * x / z, found.focal_mm * y / z
        sample = found.center[0] + found.k_matrix[0] * u + found.k_matrix[1] * v
        line = found.center[1] + found.k_matrix[3] * u + found.k_matrix[4] * v
        expected = scene.views.project(k, scene.landmarks.position) + 0.5  # theirs count from 1 at pixel centres
        np.testing.assert_allclose(np.stack([sample, line], -1), expected, atol=1e-3)


def test_sumfiles_have_the_sigmas_that_the_run_states(place, tmp_path):
    """Per axis, in km and radians; where none are stated, or none are finite, SPC's usual 1 km and 1 mrad."""
    scene = place.scene
    blank = sumfile_of_view("a", scene.views.cameras[0], scene.views.body_from_cam[0], scene.views.sun[0], utc="-")
    assert with_sigmas(blank, scene, 0) == blank
    count = len(scene.views)
    center = np.tile(np.diag([4.0, 9.0, 16.0]), (count, 1, 1))
    stated = replace(scene, uncertainty={"center": center, "rotation": np.tile([1e-5, 2e-5, 3e-5], (count, 1))})
    found = with_sigmas(blank, stated, 1)
    assert found.position_sigma == pytest.approx((2e-3, 3e-3, 4e-3))
    assert found.pointing_sigma == pytest.approx((1e-5, 2e-5, 3e-5))
    loose = replace(scene, uncertainty={"center": np.full(count, np.inf), "rotation": np.full(count, 5e-5)})
    found = with_sigmas(blank, loose, 0)
    assert found.position_sigma == blank.position_sigma
    assert found.pointing_sigma == pytest.approx((5e-5, 5e-5, 5e-5))


def test_sumfiles_of_views_of_one_name_are_named_after_their_folders():
    assert sumfile_names(["a/1.fits", "a/2.fits"]) == ["1", "2"]
    assert sumfile_names(["a/1.fits", "b/1.fits"]) == ["a_1", "b_1"]
    assert len(set(sumfile_names(["a/x.png", "a/x.tif", "a_x.png"]))) == 3


def test_tables_hold_landmarks_and_views_exactly(exported):
    out, scene = exported
    landmarks, views = rows_of(out / "landmarks.csv"), rows_of(out / "views.csv")
    assert len(landmarks) == len(scene.landmarks)

    def column(rows, *names):
        return np.array([[float(row[name]) for name in names] for row in rows])

    np.testing.assert_array_equal(column(landmarks, "x_m", "y_m", "z_m"), scene.landmarks.position)
    np.testing.assert_array_equal(column(landmarks, "albedo")[:, 0], scene.landmarks.albedo)
    place = geographic_of(scene)
    np.testing.assert_allclose(column(landmarks, "longitude_deg", "latitude_deg", "height_m"), place, rtol=1e-12)
    sigma = column(landmarks, "sigma_x_m", "sigma_y_m", "sigma_z_m", "sigma_albedo")
    np.testing.assert_allclose(sigma, [[6.0, 6.0, 6.0, 0.01]] * len(landmarks))
    centers = column(views, "center_x_m", "center_y_m", "center_z_m")
    np.testing.assert_array_equal(centers, scene.views.body_from_cam.translation)
    assert [row["name"] for row in views] == list(scene.views.name)
    turned = column(views, *(f"body_from_cam_{axis}" for axis in "xyzw"))
    from scipy.spatial.transform import Rotation

    matrices = Rotation.from_quat(turned).as_matrix()
    np.testing.assert_allclose(matrices, scene.views.body_from_cam.rotation, atol=1e-12)


def geographic_of(scene):
    from photoclinometry.io.rasters.globe import find_globe

    return geographic(find_globe("vesta"), scene.landmarks.position)


def test_geometry_alone_has_neither_albedo_nor_texture(tmp_path):
    scene = synthetic_scene(size=8, views=3, reflectance=None)
    found = export_scene(scene, tmp_path / "out", ExportOptions(products=("dtm", "obj", "gltf", "csv")))
    assert set(found["files"]) == {"dtm.tif", "mesh.obj", "mesh.glb"} | TABLES
    assert "albedo" not in rows_of(tmp_path / "out" / "landmarks.csv")[0]
    for product, message in (("albedo", "geometry alone"), ("sigma", "no uncertainties"), ("sumfile", "--transform")):
        with pytest.raises(InputError, match=message):
            export_scene(scene, tmp_path / "none", ExportOptions(products=(product,)))
    assert not (tmp_path / "none").exists()


def test_gaps_in_the_texture_take_the_nearest_albedo():
    scene = synthetic_scene(size=6, views=3)
    marks = scene.landmarks
    names = ("position", "normal", "albedo", "pixel")
    holed = replace(scene, landmarks=replace(marks, **{n: np.delete(getattr(marks, n), 14, 0) for n in names}))
    texture = albedo_texture(holed)
    around = {int(texture.levels[row, col]) for row, col in ((2, 1), (2, 3), (1, 2), (3, 2))}
    assert int(texture.levels[2, 2]) in around
    assert srgb(np.array([0.0, 0.5, 2.0])) == pytest.approx([0.0, 0.735357, 1.0], abs=1e-6)


def test_an_export_into_the_current_folder_needs_no_other_name(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    export_scene(synthetic_scene(size=8, views=3), ".", ExportOptions(products=("csv",)))
    monkeypatch.chdir(tmp_path)
    assert {path.name for path in (tmp_path / "here").iterdir()} == TABLES | {"export.json"}


def test_an_export_into_a_linked_folder_keeps_the_link(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    export_scene(synthetic_scene(size=8, views=3), tmp_path / "link", ExportOptions(products=("csv",)))
    assert (tmp_path / "link").is_symlink()
    assert {path.name for path in (tmp_path / "there").iterdir()} == TABLES | {"export.json"}


def test_an_earlier_export_is_replaced_and_nothing_else(tmp_path):
    scene, out = synthetic_scene(size=8, views=3), tmp_path / "out"
    out.mkdir()
    export_scene(scene, out, ExportOptions(products=("csv", "obj")))
    export_scene(scene, out, ExportOptions(products=("csv",)))
    assert {path.name for path in out.iterdir()} == TABLES | {"export.json"}
    (out / "mine.txt").write_text("kept")
    with pytest.raises(RunFolderError, match=r"holds mine\.txt"):
        export_scene(scene, out, ExportOptions(products=("csv",)))
    assert (out / "mine.txt").read_text() == "kept"
    (tmp_path / "file").write_text("kept")
    with pytest.raises(RunFolderError, match="is a file"):
        export_scene(scene, tmp_path / "file", ExportOptions(products=("csv",)))
    (out / "mine.txt").unlink()
    for damaged in ("[]", "[" * 100_000):
        (out / "export.json").write_text(damaged)
        with pytest.raises(RunFolderError, match="which no earlier export wrote"):
            export_scene(scene, out, ExportOptions(products=("csv",)))


def test_an_export_of_another_map_is_replaced_only_where_that_is_asked_for(tmp_path):
    scene, out, csv = synthetic_scene(size=8, views=4), tmp_path / "out", ExportOptions(products=("csv",))
    views = scene.views
    again = replace(scene, name="renamed", views=replace(views, sun=views.sun @ so3_exp(np.array([0.1, 0.0, 0.0]))))
    other = replace(scene, views=replace(views, sun_measured=-views.sun_measured))
    export_scene(scene, out, csv)
    export_scene(again, out, csv)
    before = (out / "export.json").read_bytes()
    with pytest.raises(RunFolderError, match=r"out: holds an export of the map 'renamed' \(4 images\); this .*--ov"):
        export_scene(other, out, csv)
    assert (out / "export.json").read_bytes() == before
    export_scene(other, out, csv, overwrite=True)
    content = json.loads((out / "export.json").read_text())
    assert content["owner"]["name"] == scene.name
    (out / "export.json").write_text(json.dumps({key: content[key] for key in content if key != "owner"}))
    with pytest.raises(RunFolderError, match="holds an export, and not of what; this is the map"):
        export_scene(scene, out, csv)


def test_an_export_that_fails_half_way_leaves_what_was_there(tmp_path, monkeypatch):
    scene, out = synthetic_scene(size=8, views=3), tmp_path / "out"
    export_scene(scene, out, ExportOptions(products=("csv",)))
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("photoclinometry.output.export.formats.write_tables", full)
    with pytest.raises(RunFolderError, match="No space left"):
        export_scene(scene, out, ExportOptions(products=("obj", "csv")))
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_format_is_one_entry(tmp_path, monkeypatch):
    """Registered in six lines, it is written with all others, listed, and asked for by name."""

    def count(folder, framed, products, options):
        (folder / "count.txt").write_text(str(len(framed.scene.landmarks)))
        return {"count.txt": "number of landmarks"}

    monkeypatch.setitem(FORMATS, "count", Format(name="count", about="number of landmarks", write=count))
    export_scene(synthetic_scene(size=8, views=3), tmp_path / "out", ExportOptions(products=("count",)))
    assert (tmp_path / "out" / "count.txt").read_text() == "64"
    with pytest.raises(InputError, match=r"no export format 'dem'; known: dtm, .*, csv, count"):
        export_scene(synthetic_scene(size=8, views=3), tmp_path / "no", ExportOptions(products=("dem",)))


def test_a_format_whose_extra_is_not_installed_names_it(tmp_path, monkeypatch):
    def write(*_):
        raise ModuleNotFoundError("No module named 'pancakes'", name="pancakes")

    monkeypatch.setitem(FORMATS, "stack", Format(name="stack", about="-", write=write, extra="breakfast"))
    with pytest.raises(InputError, match=r"stack needs pancakes: pip install 'photoclinometry\[breakfast\]'"):
        export_scene(synthetic_scene(size=8, views=3), tmp_path / "out", ExportOptions(products=("stack",)))


def test_without_an_extra_the_rest_is_exported(tmp_path, monkeypatch):
    """Where products are not asked for by name, those whose package is missing are left out, and named."""
    wanted = {"csv": FORMATS["csv"], "dtm": replace(FORMATS["dtm"], package="pancakes", extra="breakfast")}
    for name in list(FORMATS):
        monkeypatch.delitem(FORMATS, name)
    for name, product in wanted.items():
        monkeypatch.setitem(FORMATS, name, product)
    about = export_scene(synthetic_scene(size=8, views=3), tmp_path / "out")
    assert set(about["files"]) == {"landmarks.csv", "views.csv"}
    assert about["left_out"] == {"dtm": "pancakes is not installed: pip install 'photoclinometry[breakfast]'"}


def test_the_help_lists_every_format(capsys):
    assert phomo("export", "--help") == 0
    said = capsys.readouterr().out
    for product in FORMATS.values():
        assert product.name in said
    assert "GeoTIFF of slopes" in said


def test_the_command_exports_a_run_and_says_what_and_where(place, tmp_path, capsys):
    run = tmp_path / "run"
    run.mkdir()
    write_scene(run / "scene.h5", place.scene)
    assert phomo("export", run, "--out", tmp_path / "out", "--products", "dtm", "csv", "--unit-m", 60) == 0
    said = capsys.readouterr()
    assert said.out.strip() == str(tmp_path / "out")
    assert "dtm.tif: height above the map's mean plane" in said.err
    assert "at an unknown place on the body, in metres" in said.err
