"""The viewer of whole bodies in a real browser: brightness and shadows as by rays, layers, levels."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree

from browser import why_no_browser
from photoclinometry.body.products import reflectance_json
from photoclinometry.io.images import write_fits
from photoclinometry.io.meshes.shape_ply import write_shape_ply
from photoclinometry.io.models.colmap import write_colmap
from photoclinometry.io.scene_file import write_scene
from photoclinometry.io.site import Site, SiteView, read_site, write_site
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.reflectance import MODELS, starting_model
from photoclinometry.output.viewer import body_content as content
from photoclinometry.output.viewer import body_page, write_body_viewer
from photoclinometry.output.viewer.run_page import run_page
from photoclinometry.surface.closed_mesh import area_vectors
from scenes import synthetic_images, synthetic_scene
from viewer_bodies import RADIUS, body_of, by_rays, images_of, round_one
from viewer_data import data_of, unpacked
from viewer_pages import RENDERED, rows_of

pytest.importorskip("embreex")
needs_browser = pytest.mark.skipif(why_no_browser() is not None, reason=str(why_no_browser()))

LIMIT = 0.005
"""Of the mean brightness: largest mean difference from pictures by rays."""


@pytest.fixture(scope="module")
def body():
    return body_of()


@pytest.fixture(scope="module")
def file(body, folder):
    return write_body_viewer(folder / "viewer.html", body, images_of(body))


def rendered(page, body, view, sun):
    """The page's picture of a view under a Sun (unit vector) with cast shadows."""
    azimuth, elevation = np.degrees([np.arctan2(sun[0], sun[1]), np.arcsin(sun[2])])
    camera = body.views.cameras[view]
    got = page.run(RENDERED, view, azimuth, elevation, True)
    return np.array(got, float).reshape(camera.height, camera.width)


def test_vertices_come_back_in_another_order():
    """Neighbours in space are neighbours in the file; faces are the same triangles, with their orientation."""
    body = body_of(spacing=30.0)
    stored = content.body_content(body)
    position, faces = unpacked(stored["landmarks"]["position"]), unpacked(stored["faces"]).astype(int)
    vertices, triangles = body.shape.vertices, body.shape.faces
    off, same = cKDTree(position[faces].mean(1)).query(vertices[triangles].mean(1))
    assert off.max() < 1e-2
    assert sorted(same) == list(range(len(triangles)))
    np.testing.assert_allclose(area_vectors(position, faces)[same], area_vectors(vertices, triangles), atol=0.5)
    steps = np.linalg.norm(np.diff(position, axis=0), axis=-1)
    assert np.median(steps) < 60.0


def test_what_is_not_known_is_missing():
    stored = content.body_content(body_of(spacing=30.0))["landmarks"]
    south = unpacked(stored["position"])[:, 2] < -0.95 * RADIUS
    for name in ("albedo", "sigma_height", "sigma_normal", "sigma_albedo", "tile"):
        assert np.isnan(unpacked(stored[name])[south]).all()
        assert np.isfinite(unpacked(stored[name])[~south]).mean() > 0.9
    assert unpacked(stored["sigma_normal"])[~south][0] == pytest.approx(1.5, rel=1e-3)
    assert unpacked(stored["sigma_albedo"])[~south][0] == pytest.approx(2.0, rel=1e-3)


def test_lengths_without_a_unit_are_ground_samples_about_the_middle():
    """In the frame of the images alone the body may lie anywhere, in any unit."""
    body = body_of(round_one, spacing=30.0)
    away = np.array([1000.0, -400.0, 300.0])
    shape = replace(body.shape, vertices=body.shape.vertices + away, unit=None)
    poses = Rigid(body.views.body_from_cam.rotation, body.views.body_from_cam.translation + away)
    stored = content.body_content(replace(body, shape=shape, views=body.views.at_poses(poses), body_fixed=False))
    assert stored["unit"] == "GSD"
    radius = np.linalg.norm(unpacked(stored["landmarks"]["position"]), axis=-1)
    np.testing.assert_allclose(radius, RADIUS / body.gsd, rtol=2e-3)
    np.testing.assert_allclose(np.array(stored["place"]["origin"]) * body.gsd, away, atol=1.0)


def test_large_surfaces_are_made_coarser_and_have_a_level_for_moving(monkeypatch):
    monkeypatch.setattr(content, "MOST_FACETS", 4000)
    monkeypatch.setattr(content, "MOVING_FACETS", 1000)
    body = body_of(round_one, spacing=9.0)
    stored = content.body_content(body)
    assert stored["facets"] == len(body.shape.faces) > 6000
    faces, coarse = (unpacked(stored[name]).astype(int) for name in ("faces", "coarse_faces"))
    position = unpacked(stored["landmarks"]["position"])
    assert len(faces) == pytest.approx(4000, rel=0.01)
    assert len(coarse) == pytest.approx(1000, rel=0.05)
    for level in (faces, coarse):
        outward = np.sum(area_vectors(position, level) * position[level].mean(1), axis=-1)
        assert (outward > 0).mean() > 0.99
        assert outward.sum() / 3.0 == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.03)


def write_metrics(folder, views=(), **more):
    """metrics.json of a body, whose tiles were rendered with another model than each of them has."""
    stated = {"reflectance": reflectance_json(starting_model("hapke", "vesta"))} | more
    (folder / "metrics.json").write_text(json.dumps({"metrics": {"gsd": 3.5}, "views": list(views), **stated}))


@pytest.fixture
def body_folder(tmp_path):
    """What `phomo body` leaves without its report: an unknown sphere with one tile, in four views of its site."""
    scene = synthetic_scene(size=12, views=4)
    views = []
    for k, image in enumerate(synthetic_images(scene)):
        write_fits(tmp_path / image.name, image.brightness)
        camera, sun = scene.views.cameras[k], scene.views.sun_measured[k]
        views.append(SiteView(name=image.name, image=tmp_path / image.name, camera=camera, sun=sun))
    site, folder = tmp_path / "site.toml", tmp_path / "body"
    write_site(site, Site(scene.name, None, "iof", tuple(views), None, site))
    tile = folder / "tiles" / "0000"
    tile.mkdir(parents=True)
    write_scene(tile / "scene.h5", scene)
    write_colmap(folder / "sparse", scene)
    write_shape_ply(folder / "body.ply", replace(body_of(round_one, spacing=60.0).shape, unit=None))
    (folder / "config.toml").write_text(f"site = '{site}'\n")
    write_metrics(folder)
    return folder, scene


def test_a_body_whose_page_is_missing_gets_it(body_folder):
    folder, scene = body_folder
    path = folder / "report" / "viewer.html"
    assert run_page(folder) == path
    page = data_of(path.read_text(encoding="utf-8"))["scene"]
    assert page["kind"] == "body"
    assert page["gsd"] == 1.0  # lengths are in GSD, since the images alone tell none
    assert page["reflectance"]["name"] == "hapke" != scene.reflectance.name
    assert [view["name"] for view in page["views"]] == list(scene.views.name)
    assert all(picture is not None for picture in page["pictures"])
    poses = np.array([view["local_from_cam"] for view in page["views"]])
    np.testing.assert_allclose(poses, scene.views.body_from_cam.rotation, atol=1e-9)
    path.write_text("the page")
    assert run_page(folder) == path
    assert path.read_text() == "the page"  # it is made where it is missing


def test_a_page_without_images_says_nothing_of_them(body_folder):
    folder, scene = body_folder
    (folder.parent / scene.views.name[2]).unlink()
    assert not any(data_of(run_page(folder).read_text(encoding="utf-8"))["scene"]["pictures"])


@pytest.mark.parametrize("name", MODELS)
def test_the_reflectance_of_a_body_is_read_back_as_it_was_written(name):
    model = starting_model(name, "vesta")
    document = json.loads(json.dumps({"reflectance": reflectance_json(model)}))
    assert body_page.reflectance_of(Path("body"), document) == model
    assert body_page.reflectance_of(Path("body"), {"reflectance": reflectance_json(None)}) is None


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda folder: (folder.parent / "site.toml").unlink(), "is not there"),
        (lambda folder: (folder / "metrics.json").unlink(), "names no ground sample distance; run `phomo body`"),
        (lambda folder: write_metrics(folder, reflectance=[]), "names no reflectance model; run `phomo body`"),
        (lambda folder: write_metrics(folder, reflectance={"name": "x", "parameters": {}}), "no reflectance model 'x'"),
    ],
    ids=["site", "metrics", "reflectance", "an unknown model"],
)
def test_a_body_that_lacks_what_its_page_needs_says_so(body_folder, spoil, words):
    folder, _ = body_folder
    spoil(folder)
    with pytest.raises(InputError, match=words):
        run_page(folder)


def test_the_brightness_of_uncalibrated_images_is_that_of_the_folder(body_folder):
    """It is not made up where an earlier version has not kept it."""
    folder, scene = body_folder
    site = folder.parent / "site.toml"
    write_site(site, replace(read_site(site), brightness="dn"))
    with pytest.raises(RunFolderError, match="names no brightness of its images"):
        run_page(folder)
    rows = [{"name": name, "gain": gain} for name, gain in zip(scene.views.name, (2.0, 3.0, None, 5.0), strict=True)]
    write_metrics(folder, rows)
    page = data_of(run_page(folder).read_text(encoding="utf-8"))["scene"]
    assert [view["scale"] for view in page["views"]] == [2.0, 3.0, 1.0, 5.0]


@needs_browser
def test_it_asks_for_nothing_but_itself(window, file):
    window.open(file)
    window.settle()
    assert [address.split("#")[0] for address in window.requests()] == [file.as_uri()]
    assert window.messages() == []


@needs_browser
def test_every_layer_is_shown_and_no_two_are_alike(page):
    keys = page.run("return viewer.layers.map(layer => layer.key)")
    sigmas = ["sigma_height", "sigma_normal", "sigma_albedo"]
    assert keys == ["rendering", "relief", "albedo", "height", "slope", *sigmas, "views", "tile"]
    pictures = []
    page.run("viewer.free({ tilt: 120 })")
    for key in ("rendering", "relief", "albedo", "height", "slope", "views", "tile"):
        page.set("layer", key)
        pictures.append(page.picture())
    assert all((a != b).any(-1).mean() > 0.05 for i, a in enumerate(pictures) for b in pictures[:i])


@needs_browser
@pytest.mark.parametrize("model", ["lunar-lambert", "hapke"])
def test_brightness_and_shadows_are_those_of_rays(page, body, folder, model):
    """Under each view's own Sun, and under one that leaves the hollow in its own shadow.

    Two pixels inside the limb, since rays go to four places of a pixel.
    """
    seen = replace(body, reflectance=starting_model(model, "vesta"))
    page.open(write_body_viewer(folder / f"{model}.html", seen))
    shaded = []
    low = np.array([0.0, 0.8, 0.6])
    for view, sun in [*((k, body.views.sun[k]) for k in range(4)), (0, low), (2, low)]:
        wanted, got = by_rays(seen, view, sun), rendered(page, seen, view, sun)
        disk = np.isfinite(wanted)
        assert (disk != np.isfinite(got)).sum() < 0.05 * disk.sum()
        inside = binary_erosion(disk, iterations=2)
        off = np.abs(got - wanted)[inside] / wanted[disk].mean()
        assert off.mean() < LIMIT
        assert (off > 0.1).mean() < 0.01  # the edges of shadows, a pixel wide
        shaded.append((wanted[inside] == 0).mean())
    assert max(shaded) > 0.2


@needs_browser
def test_a_model_made_of_images_alone_has_no_longitudes(page, body, folder):
    names = "return ['azimuth-name', 'north', 'south'].map((id) => document.getElementById(id).textContent).join()"
    page.open(write_body_viewer(folder / "fixed.html", body))
    assert page.run(names) == "longitude,north,south"
    page.open(write_body_viewer(folder / "own.html", replace(body, body_fixed=False)))
    assert page.run(names) == "from x to y,+z,-z"


@needs_browser
def test_the_difference_of_a_body_and_its_exact_image_is_small(page):
    for view in ("0", "1"):
        page.set("camera-of", view)
        page.click("#compare [data-value=difference]")
        page.settle()
        picture = page.picture()
        inside = (picture.min(-1) > 100) & (picture.max(-1) > 200)
        assert inside.sum() > 10_000
        assert (picture[inside].min(-1) > 225).mean() > 0.85


@needs_browser
def test_values_under_the_cursor_are_those_of_a_vertex(page, body):
    page.set("layer", "height")
    page.hover(430.0, 400.0)
    shown = rows_of(page, "values")
    point = np.array([float(x) for x in shown["x, y, z"].removesuffix(" m").split(", ")])
    index = np.argmin(np.linalg.norm(body.shape.vertices - point, axis=-1))
    vertex = body.shape.vertices[index]
    np.testing.assert_allclose(point, vertex, atol=0.2)
    assert shown["radius"] == f"{np.linalg.norm(vertex):.2f} ± 0.50 m"
    longitude, latitude = (float(x.strip(" °E")) for x in shown["longitude, latitude"].split("° E,"))
    assert longitude == pytest.approx(np.degrees(np.arctan2(vertex[1], vertex[0])) % 360, abs=0.01)
    assert latitude == pytest.approx(np.degrees(np.arcsin(vertex[2] / np.linalg.norm(vertex))), abs=0.01)
    assert float(shown["albedo"].split(" ± ")[0]) == pytest.approx(body.shape.albedo[index], abs=6e-4)
    assert shown["tile"] == str(body.shape.tile[index])
    page.hover(5.0, 300.0)
    assert rows_of(page, "values") == {}


@needs_browser
def test_the_sun_has_longitude_and_latitude(page):
    sun = "const s = viewer.store.state; return viewer.sunFromAngles(s.azimuth, s.elevation)"
    page.set("azimuth", 30)
    page.set("elevation", -20)
    along = np.cos(np.radians(-20)) * np.array([np.cos(np.radians(30)), np.sin(np.radians(30))])
    np.testing.assert_allclose(page.run(sun), [*along, np.sin(np.radians(-20))], atol=1e-9)
    box = page.run(
        "const b = document.getElementById('sky').getBoundingClientRect(); return [b.x, b.y, b.width, b.height]"
    )
    page.drag((box[0] + 0.25 * box[2], box[1] + 0.5 * box[3]), (box[0] + 0.5 * box[2], box[1] + 0.25 * box[3]))
    np.testing.assert_allclose(page.run(sun), [-(0.5**0.5), 0.0, 0.5**0.5], atol=0.03)
    assert float(page.run("return document.getElementById('azimuth').value")) == pytest.approx(180, abs=2)


@needs_browser
def test_north_is_up_and_the_poles_can_be_seen(page):
    up = "const c = viewer.camera(); return [c.camFromLocal.slice(3, 6), c.camFromLocal.slice(6, 9)]"
    for look, forward in (("north", [0, 0, -1]), ("south", [0, 0, 1])):
        page.click(f"#{look}")
        np.testing.assert_allclose(page.run(up)[1], forward, atol=1e-9)
    page.click("#equator")
    np.testing.assert_allclose(page.run(up)[0], [0, 0, -1], atol=1e-9)


@needs_browser
def test_while_it_moves_a_slow_page_draws_the_coarse_level(window, folder, body, monkeypatch):
    monkeypatch.setattr(content, "MOVING_FACETS", 6000)
    window.open(write_body_viewer(folder / "levels.html", body))
    levels = window.run("return viewer.renderer.levels.map(level => level.indices)")
    assert levels[1] == pytest.approx(3 * 6000, rel=0.05)
    assert levels[0] > 5 * levels[1]
    window.settle()
    # The page notes what each frame drew, and takes the last change for recent: a busy computer may ask too late.
    window.run("""
        const { renderer } = viewer, tick = () => {
            drawn.push(renderer.levels.indexOf(renderer.mesh));
            requestAnimationFrame(tick);
        };
        window.drawn = [];
        Object.assign(viewer, { isSlow: true, drawnAt: performance.now() + 60_000 });
        viewer.store.update({ heading: 20 });
        requestAnimationFrame(tick);
    """)
    window.wait("drawn.includes(1)")
    window.wait("drawn.at(-1) === 0")  # at rest


@needs_browser
def test_a_permalink_restores_a_body(page, window, file):
    page.run("viewer.store.update({ layer: 'slope', azimuth: 123.4, elevation: -21, tilt: 150, heading: 200 })")
    page.settle()
    window.wait("location.hash.includes('slope')")
    fragment, picture = page.run("return location.hash"), page.picture()
    window.open(file, fragment)
    window.settle()
    assert (window.picture() != picture).any(-1).mean() < 1e-3
