"""The viewer's page: arrays come back, nothing is asked for, nothing breaks out of the data, and every run has one."""

import re
import webbrowser
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

import photoclinometry as pcm
from browser import why_no_browser
from commands import phomo
from photoclinometry.io.scene_file import write_scene
from photoclinometry.model.image import Image
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.reflectance import MODELS, Reflectance
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.output.export import ExportOptions, export_scene
from photoclinometry.output.viewer.arrays import packed, three_digits
from photoclinometry.output.viewer.colours import ENTRIES, colour_tables
from photoclinometry.output.viewer.content import viewer_content
from photoclinometry.output.viewer.page import ASSETS, SCRIPTS, SHADERS, viewer_page, write_viewer
from scenes import synthetic_images, synthetic_scene, with_landmarks
from viewer_data import data_of, unpacked

LONGEST_FILE = 300
"""Lines of a file of the page's program: one idea each."""


def test_arrays_come_back_to_half_a_step():
    rng = np.random.default_rng(0)
    for values in (rng.normal(size=500), rng.normal(size=(200, 3)) * 1e6, np.arange(7), np.zeros((0, 3)), np.zeros(4)):
        stored = packed(values, 1e-3)
        assert np.abs(unpacked(stored) - values).max(initial=0.0) <= 0.5 * stored["step"] * (1 + 1e-9)


def test_values_that_are_not_finite_are_missing():
    values = np.array([1.0, np.nan, -2.0, np.inf, -np.inf, 3.0])
    np.testing.assert_array_equal(unpacked(packed(values, 0.5)), [1.0, np.nan, -2.0, np.nan, np.nan, 3.0])


def test_a_step_that_is_too_fine_for_whole_numbers_is_made_coarser():
    values = np.array([0.0, 1e9])
    np.testing.assert_allclose(unpacked(packed(values, 1e-6)), values, atol=1.0)


def test_steps_of_sigmas_follow_their_median():
    assert three_digits(np.array([1.0, 2.0, 3.0, np.inf, np.nan])) == pytest.approx(2e-3)
    assert three_digits(np.full(3, np.nan)) == 1.0


def test_the_page_holds_the_map_to_a_thousandth_of_a_sample():
    scene = synthetic_scene(size=24, views=4)
    stored = viewer_content(scene)["landmarks"]
    position = unpacked(stored["position"]) * scene.gsd  # of an own frame: in ground samples
    distances = (np.linalg.norm(p - p[0], axis=-1) for p in (position, scene.landmarks.position))
    np.testing.assert_allclose(*distances, atol=2e-3 * scene.gsd)
    np.testing.assert_allclose(unpacked(stored["albedo"]), scene.landmarks.albedo, rtol=1e-4)
    assert np.linalg.norm(unpacked(stored["normal"]), axis=-1) == pytest.approx(1.0, abs=1e-4)
    np.testing.assert_array_equal(unpacked(stored["views"]), 4)


def test_lengths_are_metres_where_these_are_known():
    scene = synthetic_scene(size=16, views=3)
    assert viewer_content(scene)["unit"] == "GSD"
    assert viewer_content(scene)["gsd"] == pytest.approx(1.0)
    known = viewer_content(replace(scene, frame=BODY_FIXED))
    assert known["unit"] == "m"
    assert known["gsd"] == pytest.approx(60.0, rel=0.01)


def test_the_page_names_no_other_file_and_forbids_requests():
    html = viewer_page(viewer_content(synthetic_scene(size=12, views=3)))
    program = re.sub(r'id="data">.*?</script>', "", html, flags=re.S)
    assert not re.search(r"https?://|\bsrc=|\bhref=\"|@import|url\(|fetch\(|XMLHttpRequest", program)
    assert "default-src 'none'" in html


def test_a_notebook_is_given_the_page_of_a_run_or_of_a_scene(tmp_path):
    scene = synthetic_scene(size=12, views=3)
    assert data_of(pcm.view(scene).page)["scene"]["name"] == scene.name
    write_scene(tmp_path / "run" / "scene.h5", scene)
    assert data_of(pcm.view(tmp_path / "run" / "scene.h5").page) == data_of(pcm.view(scene).page)
    write_viewer(tmp_path / "run" / "report" / "viewer.html", scene, synthetic_images(scene))
    for given in (tmp_path / "run", str(tmp_path / "run")):
        assert any(data_of(pcm.view(given).page)["scene"]["pictures"])
    frame = pcm.view(scene, height_px=321)._repr_html_()
    assert "height: 321px" in frame
    assert unescape(re.search('srcdoc="([^"]*)"', frame)[1]) == pcm.view(scene).page
    with pytest.raises(pcm.InputError):
        pcm.view(tmp_path / "nothing")


def test_pose_priors_are_of_maps_in_their_frame(tmp_path):
    scene = synthetic_scene(size=12, views=3)
    name, pose = scene.views.name[1], scene.views.body_from_cam[1]
    known = {name: PosePrior(pose.inverse(), np.inf, 20.0)}
    assert [view["prior"] for view in viewer_content(scene, (), known)["views"]] == [None] * 3
    views = viewer_content(replace(scene, frame=BODY_FIXED), (), known)["views"]
    assert views[0]["prior"] is None
    assert views[1]["prior"]["center"] == pytest.approx(views[1]["center"])
    assert (views[1]["prior"]["center_sigma"], views[1]["prior"]["rotation_sigma"]) == (20.0, None)
    viewer_page(viewer_content(replace(scene, frame=BODY_FIXED), (), known))  # JSON takes it


def test_names_cannot_break_out_of_the_data():
    """Neither elements nor comments of HTML, nor the page's own places for text, begin within the data."""
    name = "</script><script>alert(1)</script><!--<script><!--PROGRAM-->\u2028&amp;"
    html = viewer_page(viewer_content(replace(synthetic_scene(size=12, views=3), name=name)))
    assert data_of(html)["scene"]["name"] == name
    assert html.count("<script") == 2
    assert html.count("</script>") == 2


def test_every_model_can_be_shown():
    """A model of the package without a statement for the graphics processor would be missing in the viewer."""
    assert [name for name, model in MODELS.items() if model.shader is None] == []


def test_a_model_beyond_its_bounds_is_not_rendered():
    scene = synthetic_scene(size=12, views=3)
    beyond = replace(scene, reflectance=Reflectance("hapke", (2.0, 0.3, 0.2, 1.0, 1.0, 0.1)))
    assert viewer_content(beyond)["reflectance"] is None


def test_every_file_of_the_program_is_used_and_short():
    assert {path.stem for path in (ASSETS / "js").iterdir()} == set(SCRIPTS)
    assert {path.name for path in (ASSETS / "glsl").iterdir()} == set(SHADERS)
    for path in ASSETS.rglob("*.*"):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST_FILE, path


def test_regions_and_bodies_answer_the_same_questions():
    """What differs between them is named in both: a name that one of them lacks would be undefined in its page."""
    names = {}
    for kind in ("region", "body"):
        stated = re.search(r"const [A-Z]+ = \{\n(.*?)\n\};", (ASSETS / "js" / f"{kind}.js").read_text(), re.S)
        assert stated
        names[kind] = set(re.findall(r"^  (\w+)(?=[:(,])", stated[1], re.M))
    assert names["region"] == names["body"]
    assert len(names["body"]) > 20


def test_pictures_are_the_images_around_the_map():
    scene = synthetic_scene(size=24, views=4)
    images = synthetic_images(scene)
    for image, picture in zip(images, viewer_content(scene, images)["pictures"], strict=True):
        rows, cols = (slice(picture[k], picture[k] + picture[f"{k}s"]) for k in ("row", "col"))
        shown = unpacked(picture["brightness"]).reshape(picture["rows"], picture["cols"])
        peak = image.brightness[rows, cols].max()
        np.testing.assert_allclose(shown, image.brightness[rows, cols], atol=2.1e-3 * peak)


def test_invalid_pixels_and_missing_images_are_missing():
    scene = synthetic_scene(size=24, views=4)
    first, *others = synthetic_images(scene)
    blind = Image(first.name, first.brightness, np.zeros_like(first.valid))
    pictures = viewer_content(scene, [blind, *others[1:]])["pictures"]
    assert np.isnan(unpacked(pictures[0]["brightness"])).all()
    assert pictures[1] is None
    assert pictures[2] is not None


def test_many_pixels_are_averaged(monkeypatch):
    monkeypatch.setattr("photoclinometry.output.viewer.pictures._MOST_PIXELS", 1000)
    scene = synthetic_scene(size=24, views=4)
    images = synthetic_images(scene)
    picture = viewer_content(scene, images)["pictures"][0]
    block = picture["block"]
    assert block > 1
    corner = images[0].brightness[picture["row"] :, picture["col"] :][:block, :block]
    assert unpacked(picture["brightness"])[0] == pytest.approx(corner.mean(), rel=5e-3)


def test_a_map_of_geometry_alone_and_one_with_gaps_have_pages(tmp_path):
    bare = synthetic_scene(size=16, views=3, reflectance=None)
    content = data_of(write_viewer(tmp_path / "bare.html", bare).read_text(encoding="utf-8"))["scene"]
    assert content["reflectance"] is None
    assert "albedo" not in content["landmarks"]
    there = np.arange(256) % 7 > 0
    content = viewer_content(with_landmarks(synthetic_scene(size=16, views=3), there))
    np.testing.assert_array_equal(unpacked(content["landmarks"]["cell"]), np.flatnonzero(there))


def test_sigmas_are_in_the_units_of_their_layers():
    scene = synthetic_scene(size=12, views=3)
    count = len(scene.landmarks)
    stated = {"position": np.tile(np.eye(3) * 9.0, (count, 1, 1)), "normal": np.full((count, 2), 0.01)}
    stored = viewer_content(replace(scene, uncertainty=stated, frame=BODY_FIXED))["landmarks"]
    np.testing.assert_allclose(unpacked(stored["sigma_height"]), 3.0, rtol=1e-3)
    np.testing.assert_allclose(unpacked(stored["sigma_normal"]), np.degrees(0.01 * np.sqrt(2)), rtol=1e-3)
    assert "sigma_albedo" not in stored


def test_the_viewer_is_a_product_of_the_export(tmp_path):
    scene = synthetic_scene(size=16, views=3)
    exported = export_scene(scene, tmp_path / "maps", ExportOptions(products=("viewer",)))
    assert set(exported["files"]) == {"viewer.html"}
    content = data_of((tmp_path / "maps" / "viewer.html").read_text(encoding="utf-8"))["scene"]
    assert content["pictures"] == [None] * 3


@pytest.fixture
def run(tmp_path):
    """A run folder without a report."""
    write_scene(tmp_path / "run" / "scene.h5", synthetic_scene(size=16, views=3))
    return tmp_path / "run"


def test_view_opens_the_page_of_a_run_and_prints_its_path(run, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or True)
    assert phomo("view", run) == 0
    page = run / "report" / "viewer.html"
    assert capsys.readouterr().out.strip() == str(page)
    assert opened == [page.resolve().as_uri()]
    page.write_text("an earlier page")
    assert phomo("view", run, "--no-browser") == 0
    assert page.read_text() == "an earlier page"
    assert len(opened) == 1


def test_view_says_so_where_there_is_no_browser(run, monkeypatch, capsys):
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    assert phomo("view", run) == 0
    assert "no browser" in capsys.readouterr().err


def test_view_refuses_a_folder_without_a_map(tmp_path, capsys):
    assert phomo("view", tmp_path) == 2
    assert "holds no scene.h5; give a folder that `phomo run` has finished" in capsys.readouterr().err


def test_colours_keep_their_order_by_lightness_alone():
    """What colour-blind people and prints in grey see: lightness rises along every table, or falls from its middle."""
    for name, text in colour_tables().items():
        rgb = np.array([int(text[i : i + 2], 16) for i in range(0, len(text), 2)]).reshape(ENTRIES, 3) / 255.0
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        rises = np.diff(linear @ (0.2126, 0.7152, 0.0722))
        if name == "RdBu_r":
            assert (rises[: ENTRIES // 2 - 1] > 0).all()
            assert (rises[ENTRIES // 2 :] < 0).all()
        else:
            assert (rises > 0).all(), name


def test_tests_in_a_browser_are_skipped_with_the_reason_or_not_at_all(monkeypatch):
    """Where continuous integration has installed a browser, its absence is an error."""
    monkeypatch.delenv("PHOTOCLINOMETRY_NEEDS_BROWSER", raising=False)
    monkeypatch.setattr("browser.find_spec", lambda name: object())
    monkeypatch.setattr("browser.shutil.which", lambda name: None)
    assert "chromium" in (why_no_browser() or "")
    monkeypatch.setenv("PHOTOCLINOMETRY_NEEDS_BROWSER", "1")
    with pytest.raises(RuntimeError, match="cannot run: none of chromium"):
        why_no_browser()
