"""The viewer in a real browser: it loads without errors or requests, and each control changes what it should."""

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import binary_erosion

import photoclinometry as pcm
from browser import why_no_browser
from photoclinometry.model.geometry import Rigid
from photoclinometry.model.pose_prior import PosePrior
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.output.viewer import write_viewer
from photoclinometry.photometry.render import render_view
from photoclinometry.surface.relief import angles_from_sun, local_frame
from scenes import synthetic_images, synthetic_scene
from viewer_pages import MIDDLE, box_of, differ, downloaded, page_of, rows_of, scene_of

pytestmark = pytest.mark.skipif(why_no_browser() is not None, reason=str(why_no_browser()))


@pytest.fixture(scope="module")
def scene():
    return scene_of()


@pytest.fixture(scope="module")
def file(scene, folder):
    return page_of(folder, scene)


def test_it_asks_for_nothing_but_itself(window, file):
    window.open(file)
    window.settle()
    assert [address.split("#")[0] for address in window.requests()] == [file.as_uri()]
    assert window.messages() == []
    assert window.run("return document.getElementById('message').textContent") == ""


def test_every_layer_is_shown_and_no_two_are_alike(page):
    keys = page.run("return viewer.layers.map(layer => layer.key)")
    sigmas = ["sigma_height", "sigma_position", "sigma_normal", "sigma_albedo"]
    assert keys == ["rendering", "relief", "albedo", "height", "slope", *sigmas, "views", "residual"]
    pictures = []
    for key in keys:
        page.set("layer", key)
        assert page.state("layer") == key
        pictures.append(page.picture())
    assert all(differ(a, b) > 0.05 for i, a in enumerate(pictures) for b in pictures[:i])


def test_layers_do_not_show_what_nothing_determines(window, file, scene, folder):
    """Renderings need all normals and albedos, and have them."""
    stated = {name: values.copy() for name, values in scene.uncertainty.items()}
    stated["normal"][:7] = np.inf
    stated["albedo_relative"] = np.where(np.arange(len(scene.landmarks)) < 5, 1.0, 0.01) * scene.landmarks.albedo
    pictures = []
    for opened in (file, page_of(folder, replace(scene, uncertainty=stated), "unknown.html")):
        window.open(opened)
        window.settle()
        window.set("layer", "rendering")
        pictures.append(window.picture())
    missing = (
        "return viewer.layers.find((l) => l.key === arguments[0]).values.filter((v) => !Number.isFinite(v)).length"
    )
    found = {key: window.run(missing, key) for key in ("slope", "sigma_normal", "albedo", "sigma_albedo", "height")}
    assert found == {"slope": 7, "sigma_normal": 7, "albedo": 5, "sigma_albedo": 5, "height": 0}
    assert differ(*pictures) == 0.0
    assert window.messages() == []


def test_layers_have_the_maps_values_under_the_cursor(page, scene):
    """At the landmark under the cursor: height with its sigma, albedo; and incidence, emission and phase."""
    page.set("layer", "height")
    page.hover(*MIDDLE)
    shown = rows_of(page, "values")
    col, row = (float(x) for x in shown["reference column, row"].removesuffix(" px").split(", "))
    index = np.argmin(np.hypot(*(scene.landmarks.pixel + 0.5 - (row, col)).T))
    local = local_frame(scene).inverse()(scene.landmarks.position[index]) / scene.gsd
    height, sigma = shown["height"].removesuffix(" GSD").split(" ± ")
    assert float(height) == pytest.approx(local[2], abs=0.3)
    assert 3.0 / 60.0 - 0.01 < float(sigma) < 9.0 / 60.0 + 0.01
    assert float(shown["albedo"].split(" ± ")[0]) == pytest.approx(scene.landmarks.albedo[index], rel=0.05)
    assert [float(x) for x in shown["x, y"].removesuffix(" GSD").split(", ")] == pytest.approx(local[:2], abs=0.8)
    incidence, emission, phase = (float(x.removesuffix("°")) for x in shown["incidence, emission, phase"].split(", "))
    assert abs(incidence - emission) <= phase <= incidence + emission
    assert shown["views"] == "4"
    page.hover(5.0, 300.0)
    assert rows_of(page, "values") == {}


CONTROLS = {
    "azimuth": (100, "azimuth", 100),
    "elevation": (15, "elevation", 15),
    "shadows": (False, "shadows", False),
    "layer": ("slope", "layer", "slope"),
    "contour": (0.05, "contour", 0.05),
    "shading": (False, "shading", False),
    "camera-of": ("2", "camera", "image"),
    "sun-of": ("3", "view", 3),
}


@pytest.mark.parametrize("control", CONTROLS)
def test_controls_change_the_picture_and_the_state(page, control):
    value, part, expected = CONTROLS[control]
    page.run("viewer.store.update({ azimuth: 250, elevation: 8 })")
    if control in ("contour", "shading"):
        page.set("layer", "height")
    before = page.picture()
    page.set(control, value)
    assert page.state(part) == expected
    assert differ(before, page.picture()) > 0.005


def test_contours_are_labelled_with_the_height_where_they_are(page):
    """At every label the height goes through its value from one pixel to the next."""
    page.set("layer", "height")
    page.set("contour", 0.4)
    found = page.run("""
        const heightAt = (x, y) => viewer.surfaceAt([x, y]).value;
        return viewer.contourLabels(0.4).map(({ x, y, number }) => [x, y, number, heightAt(x - 1, y), heightAt(x, y)]);
    """)
    x, y, number, before, here = np.array(found).T
    assert len(found) >= 5
    assert np.all(np.minimum(before, here) < 0.4 * number + 1e-6)
    assert np.all(np.maximum(before, here) >= 0.4 * number - 1e-6)
    assert np.all((np.diff(y) != 0) | (np.diff(x) >= 150))
    labelled = page.picture("overlay")
    page.set("contour", 0)
    assert differ(labelled, page.picture("overlay")) > 1e-3


def test_where_many_contours_are_only_every_fifth_is_labelled(page):
    numbers = page.run("""
        const crossings = Array.from({ length: 40 }, (_, i) => ({ x: 200 * i, y: 10, number: i - 20 }));
        const numbers = (some) => viewer.labelledCrossings(some, 150).map((one) => one.number);
        return [numbers(crossings), numbers(crossings.slice(0, 9))];
    """)
    assert numbers == [list(range(-20, 20, 5)), list(range(-20, -11))]


def test_cameras_are_marked_within_the_oblique_picture(page):
    page.click("#oblique")
    page.set("cameras", True)
    width, height = page.run("return viewer.size()")
    for x, y in page.run("return viewer.cameraMarks()"):
        assert 0 < x < width
        assert 0 < y < height


@pytest.mark.parametrize("mark", ["cameras", "footprints"])
def test_cameras_and_footprints_are_drawn_above_the_map(page, mark):
    page.click("#oblique")
    before = page.picture("overlay")
    page.set(mark, True)
    assert differ(before, page.picture("overlay")) > 1e-3


@pytest.mark.parametrize(("key", "part", "expected"), [
    ("s", "shadows", False), ("o", "cameras", True), ("f", "footprints", True), ("p", "tool", "profile"),
    ("a", "tool", "angle"), ("r", "tool", "area"), ("4", "layer", "height"), ("]", "view", 1), ("[", "view", 3),
    ("v", "camera", "image"), ("c", "compare", "image"),
])  # fmt: skip
def test_keys_do_what_the_help_says(page, key, part, expected):
    page.press(key)
    assert page.state(part) == expected


def test_arrow_keys_move_the_sun_and_plus_zooms(page):
    azimuth, elevation, distance = (page.state(name) for name in ("azimuth", "elevation", "distance"))
    page.press("\ue014", "\ue013", "\ue013", "+")
    assert page.state("azimuth") == pytest.approx((azimuth + 2) % 360)
    assert page.state("elevation") == pytest.approx(elevation + 4)
    assert page.state("distance") < distance
    page.press("0")
    assert page.state("distance") == pytest.approx(distance, rel=1e-6)


def test_help_opens_and_closes(page):
    page.press("?")
    assert page.run("return document.getElementById('help').open")
    page.click("#close-help")
    assert not page.run("return document.getElementById('help').open")


def test_the_mouse_turns_moves_and_zooms(page):
    page.drag(MIDDLE, (480.0, 330.0), (480.0, 250.0))
    assert page.state("heading") == pytest.approx(0.35 * 50)
    assert page.state("tilt") == pytest.approx(0.35 * 80)
    target = page.state("target")
    page.drag(MIDDLE, (450.0, 350.0), button="right")
    assert page.state("target") != target
    distance = page.state("distance")
    page.wheel(*MIDDLE, -300)
    assert page.state("distance") < 0.8 * distance


def test_the_sun_is_dragged_on_the_map_and_on_the_sky(page):
    azimuth = page.state("azimuth")
    page.drag(MIDDLE, (460.0, 330.0), alt=True)
    assert page.state("azimuth") == pytest.approx((azimuth + 0.35 * 30) % 360)
    box = page.run("const b = document.getElementById('sky').getBoundingClientRect(); return [b.x, b.y, b.width]")
    centre = (box[0] + box[2] / 2, box[1] + box[2] / 2)
    page.drag(centre, (centre[0] + 0.23 * box[2], centre[1]))
    assert page.state("azimuth") == pytest.approx(90.0, abs=1.0)
    assert page.state("elevation") == pytest.approx(45.0, abs=1.0)


def test_fingers_turn_zoom_and_move(page):
    x, y = MIDDLE
    page.touch([(x, y)], [(x + 40, y)])
    assert page.state("heading") == pytest.approx(14.0)
    distance, target = page.state("distance"), page.state("target")
    page.touch([(x - 40, y), (x + 40, y)], [(x - 80, y), (x + 40, y)], [(x - 80, y), (x + 80, y)])
    assert page.state("distance") == pytest.approx(distance / 2, rel=0.02)
    page.touch([(x - 40, y), (x + 40, y)], [(x - 40, y + 40), (x + 40, y)], [(x - 40, y + 40), (x + 40, y + 40)])
    assert page.state("target") != target


def test_a_day_moves_the_sun_and_leaves_nights_out(page):
    page.run("viewer.store.update({ azimuth: 271, elevation: 4 })")
    seen = set()
    page.run("viewer.play()")
    for _ in range(8):
        time.sleep(0.05)
        seen.add(tuple(page.run("return [viewer.store.state.azimuth, viewer.store.state.elevation]")))
    page.click("#play")
    assert len(seen) > 3
    assert all(elevation > 0 for _, elevation in seen)
    still = page.state("azimuth")
    time.sleep(0.2)
    assert page.state("azimuth") == still


def test_a_day_keeps_the_angle_between_sun_and_axis(page):
    cosines = page.run("""
        const found = [];
        for (let i = 0, sun = viewer.sunFromAngles(200, 40); i < 90; i++) {
            sun = viewer.laterSun([0, 1, 0], sun, 0.02);
            found.push(sun[1] / Math.hypot(...sun));
        }
        return found;
    """)
    assert np.ptp(cosines) < 1e-9


def test_as_in_an_image_takes_its_sun_and_its_camera(page, scene):
    page.set("camera-of", "2")
    azimuth, elevation = np.degrees(angles_from_sun(local_frame(scene), scene.views.sun[2]))
    assert page.state("azimuth") == pytest.approx(azimuth, abs=1e-6)
    assert page.state("elevation") == pytest.approx(elevation, abs=1e-6)
    assert page.run("return document.getElementById('sun-of').value") == "2"
    page.set("azimuth", 10)
    assert page.run("return document.getElementById('sun-of').value") == ""


def test_the_sun_of_an_image_leaves_the_camera_of_another(page):
    page.set("camera-of", "2")
    before = page.run("return viewer.camera().center")
    page.set("sun-of", "1")
    assert page.run("return viewer.camera().center") == before
    assert page.run("return document.getElementById('sun-of').value") == "1"


def shown_in_image_pixels(page, view, compare):
    """The picture of a view's camera, one pixel each of its image: (height, width) brightness, and its place."""
    page.set("camera-of", str(view))
    page.run("viewer.compare(arguments[0])", compare)
    page.run("""
        const [w, h] = viewer.size(), s = viewer.store.state;
        viewer.store.update({ zoom: 1, middle: s.middle.map((m, i) => Math.round(m) + ([w, h][i] % 2) / 2) });
    """)
    page.settle()
    limits = page.run("return viewer.drawn.shown.limits")
    picture = page.picture().astype(float)
    middle = page.state("middle")
    corner = [round(middle[i] - picture.shape[1 - i] / 2) for i in (0, 1)]
    return limits[0] + picture[..., 0] / 255 * (limits[1] - limits[0]), corner, limits


def test_the_picture_of_a_views_camera_is_render_and_image(page, scene):
    """Pixels of the canvas: the rendering is `render_view`'s, the image is the image, both to the screen's levels."""
    for view in (0, 2):
        camera = scene.views.cameras[view]
        rendered, mask = render_view(scene, view, cast_shadows=True)
        mask = binary_erosion(mask)
        image = synthetic_images(scene)[view].brightness
        for compare, wanted in (("map", rendered), ("image", image)):
            shown, (left, top), limits = shown_in_image_pixels(page, view, compare)
            height, width = shown.shape
            full = np.full((height, width), np.nan)
            rows, cols = slice(max(-top, 0), camera.height - top), slice(max(-left, 0), camera.width - left)
            full[rows, cols] = np.where(mask, wanted, np.nan)
            inside = np.isfinite(full) & (full > limits[0]) & (full < limits[1])
            assert inside.sum() > 1000
            off = np.abs(shown - full)[inside]
            assert off.mean() < 0.005 * np.nanmean(full)


def test_swipe_shows_the_image_left_of_its_edge(page):
    page.set("camera-of", "2")
    pictures = {}
    for compare in ("map", "image", "swipe"):
        page.click(f"#compare [data-value={compare}]")
        page.settle()
        pictures[compare] = page.picture()
    page.set("swipe", 0.3)
    swept, edge = page.picture(), round(0.3 * pictures["map"].shape[1])
    assert (swept[:, : edge - 2] == pictures["image"][:, : edge - 2]).all()
    assert (swept[:, edge + 2 :] == pictures["map"][:, edge + 2 :]).all()


def test_blinking_alternates_between_map_and_image(page):
    page.set("camera-of", "1")
    page.click("#compare [data-value=blink]")
    seen = set()
    for _ in range(40):
        time.sleep(0.05)
        seen.add(page.run("return viewer.drawn.shown.compare"))
    assert seen == {"map", "image"}


def test_differences_are_taken_at_the_images_own_pixels(page, scene):
    """Whatever the zoom: what is coloured is `render_view` less the image, to the levels of both."""
    for view, zoom in ((1, 1.3), (2, 5.0)):
        page.set("camera-of", str(view))
        page.click("#compare [data-value=difference]")
        page.settle()
        page.run("viewer.store.update({ zoom: arguments[0] })", zoom)
        page.picture()
        drawn = page.run(
            """
            const { gl, ofPicture } = viewer.renderer, { width, height, frame } = ofPicture;
            const read = new Float32Array(4 * width * height);
            gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
            gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, read);
            const picture = viewer.map.scene.pictures[arguments[0]];
            return [[picture.row, picture.col, height, width], Array.from(read)];
        """,
            view,
        )
        (row, col, rows, cols), values = drawn
        shown = np.array(values).reshape(rows, cols, 4)[::-1]
        wanted, mask = (
            part[row : row + rows, col : col + cols] for part in render_view(scene, view, cast_shadows=True)
        )
        both = binary_erosion(mask) & (shown[..., 3] > 0)
        assert both.sum() > 1000
        assert np.abs(shown[..., 0] - wanted)[both].mean() < 0.005 * wanted[both].mean()


def test_the_difference_of_a_rendering_and_its_exact_image_is_small(page):
    """Colours near the middle of the scale, white; and stronger ones on a narrower scale."""
    page.set("camera-of", "0")
    page.click("#compare [data-value=difference]")
    page.settle()
    wide = page.picture()
    inside = (wide.min(-1) > 100) & (wide.max(-1) > 200)
    assert (wide[inside].min(-1) > 225).mean() > 0.9
    page.set("difference", 0.05)
    assert (page.picture()[inside].min(-1) > 225).mean() < 0.9


def test_values_stand_on_the_picture_and_let_the_pointer_through(page):
    page.hover(*MIDDLE)
    left, top, right, _ = box_of(page, "values")
    assert right <= box_of(page, "stage")[2]
    heading = page.state("heading")
    page.drag((left + 20, top + 20), (left + 60, top + 20))
    assert page.state("heading") == pytest.approx(heading + 14)


def test_keys_turn_and_move_the_camera_set_points_and_step_through_layers(page):
    """All that the mouse does, without one."""
    heading, tilt, target = (page.state(name) for name in ("heading", "tilt", "target"))
    page.press("l", "i", "i", "k")
    assert page.state("heading") == pytest.approx(heading + 5)
    assert page.state("tilt") == pytest.approx(tilt + 5)
    page.press("p", "\ue007", "L", "\ue007")
    assert page.state("target") != target
    (ax, ay), (bx, by) = page.state("points")
    assert np.hypot(bx - ax, by - ay) > 1.0
    assert rows_of(page, "measures")["distance"]
    page.press("\ue00f")
    assert page.state("layer") == "relief"
    page.press("\ue00e", "\ue00e")
    assert page.state("layer") == "residual"
    page.press("v")
    middle = page.state("middle")
    page.press("l")
    assert page.state("middle") != middle


def test_sigmas_of_relative_albedos_have_a_layer(window, folder, scene):
    stated = {**scene.uncertainty, "albedo_relative": 0.5 * scene.uncertainty["albedo"]}
    window.open(page_of(folder, replace(scene, uncertainty=stated), "relative.html"))
    window.set("layer", "sigma_albedo")
    whole = window.picture()
    window.set("layer", "sigma_albedo_relative")
    assert window.state("layer") == "sigma_albedo_relative"
    assert window.run("return viewer.drawn.layer.title") == "sigma of relative albedo"
    assert differ(whole, window.picture("overlay")[..., :3]) > 0
    assert window.messages() == []


def test_a_permalink_restores_what_is_shown(page, window, file):
    page.run("""
        viewer.store.update({ layer: 'height', contour: 0.3, azimuth: 123.4, elevation: 21, shadows: false, tilt: 50,
            heading: 200, footprints: true, tool: 'profile', points: [[5, 5], [30, 22.5]] });
        viewer.play(); viewer.play();
    """)
    page.settle()
    time.sleep(0.5)
    fragment = page.run("return location.hash")
    state, picture = page.run("return viewer.store.state"), page.picture()
    window.open(file, fragment)
    window.settle()
    again = window.run("return viewer.store.state")
    for name, value in state.items():
        if isinstance(value, (str, bool)):
            assert again[name] == value
        else:
            np.testing.assert_allclose(again[name], value, rtol=1e-7, err_msg=name)
    assert differ(picture, window.picture()) < 1e-3
    assert rows_of(window, "measures")["azimuth from A to B"]


def test_a_link_to_a_view_alone_shows_its_image_under_its_sun(window, file, page):
    page.set("camera-of", "2")
    wanted = {name: page.state(name) for name in ("azimuth", "elevation", "zoom", "middle")}
    window.open(file, "#camera=image&view=2&compare=swipe")
    window.settle()
    assert window.state("compare") == "swipe"
    for name, value in wanted.items():
        assert window.state(name) == pytest.approx(value), name


@pytest.mark.parametrize("fragment", ["#layer=none&view=99&zoom=x&points=1;2", "#%%%", "#target=1,2&camera=boat", "#="])
def test_a_damaged_permalink_is_left_out(window, file, fragment):
    window.open(file, fragment)
    window.settle()
    assert window.state("layer") == "rendering"
    assert window.state("points") == []
    assert window.messages() == []


def test_the_picture_is_saved_with_its_legend(page, folder):
    page.click("#save-png")
    saved = cv2.imread(str(downloaded(folder, "*-rendering.png")))
    picture = page.picture()
    assert saved.shape == picture.shape
    assert 0.005 < differ(cv2.cvtColor(saved, cv2.COLOR_BGR2RGB), picture) < 0.2


def test_on_a_fine_screen_the_cursor_is_on_the_same_ground(page, window, file):
    page.hover(*MIDDLE)
    before, width = rows_of(page, "values"), page.run("return viewer.size()[0]")
    metrics = {"width": 0, "height": 0, "deviceScaleFactor": 2, "mobile": False}
    window.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    window.open(file)
    window.settle()
    window.hover(*MIDDLE)
    after, finer = rows_of(window, "values"), window.run("return viewer.size()[0]")
    window.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert finer == 2 * width
    for name in ("reference column, row", "x, y"):
        pairs = ([float(x) for x in rows[name].rstrip(" pxGSD").split(", ")] for rows in (before, after))
        np.testing.assert_allclose(*pairs, atol=0.2)


def test_a_map_of_geometry_alone_has_its_layers(window, folder):
    bare = synthetic_scene(size=16, views=3, reflectance=None)
    window.open(write_viewer(folder / "bare.html", bare, synthetic_images(bare)))
    window.settle()
    assert window.run("return viewer.layers.map(l => l.key)") == ["relief", "height", "slope", "views"]
    assert window.run("return document.getElementById('compare-section').hidden")
    window.set("camera-of", "1")
    assert window.messages() == []


def test_a_map_on_the_body_has_north_longitudes_and_metres(window, folder, scene):
    window.open(write_viewer(folder / "body.html", replace(scene, frame=BODY_FIXED)))
    window.hover(*MIDDLE)
    shown = rows_of(window, "values")
    assert shown["height"].endswith(" m")
    assert "longitude, latitude" in shown
    assert window.messages() == []


def test_a_notebooks_frame_shows_the_map(window, folder, scene):
    """As text of a frame, indented as documents indent it: it draws, asks for nothing, and has no link of its own."""
    frame = pcm.view(scene, height_px=500)._repr_html_()
    assert "\n" not in frame
    notebook = folder / "notebook.html"
    notebook.write_text(f"<!DOCTYPE html>\n<body>\n    {frame}\n</body>\n", encoding="utf-8")
    window.messages()
    window.requests()
    window.driver.get(notebook.as_uri())
    window.driver.switch_to.frame(0)
    window.wait("window.viewer !== undefined")
    before = window.picture()
    window.set("azimuth", 100)
    time.sleep(0.5)
    assert differ(before, window.picture()) > 0.05
    assert window.run("return innerHeight") == 500
    assert window.run("return document.getElementById('copy-link').hidden")
    window.driver.switch_to.default_content()
    assert window.messages() == []
    assert set(window.requests()) <= {notebook.as_uri(), "about:srcdoc"}


def moved_by(pose, offset, turn_deg):
    """A pose prior whose camera was `offset` (3,) away from a pose (`body_from_cam`), turned about its boresight."""
    angle = np.radians(turn_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return PosePrior(Rigid(pose.rotation @ turn, pose.translation + offset).inverse(), np.radians(0.02), 50.0)


def test_long_names_of_views_are_short_beside_their_marks_and_keep_the_panel_narrow(window, folder, scene):
    """Without what all have in common, up to a separator; figures of one view wrap."""
    stems = [f"hyb2_onc_20180710_09{k}000_tvf_l2d" for k in range(len(scene.views))]
    named = replace(scene, frame=BODY_FIXED, views=replace(scene.views, name=tuple(f"a/{stem}.fit" for stem in stems)))
    prior = moved_by(named.views.body_from_cam[0], np.ones(3), 0.1)
    window.open(write_viewer(folder / "long.html", named, (), {named.views.name[0]: prior}))
    assert window.run("return viewer.labels()") == [f"09{k}000" for k in range(len(stems))]
    window.run("viewer.store.update({ cameras: true, moves: true, tilt: 60 })")
    assert rows_of(window, "pose")["image"] == stems[0]
    panel = "const p = document.getElementById('panel'); return [p.scrollWidth, p.clientWidth]"
    assert len(set(window.run(panel))) == 1
    assert window.messages() == []


def test_pose_changes_are_told_and_drawn(window, folder, scene):
    """Of the chosen view in figures, of all as arrows; without priors there is no control for them."""
    placed = replace(scene, frame=BODY_FIXED)
    pose = placed.views.body_from_cam
    priors = {
        placed.views.name[1]: moved_by(pose[1], np.array([30.0, -40.0, 0.0]), 0.25),
        placed.views.name[2]: moved_by(pose[2], np.zeros(3), 0.0),
    }
    window.open(write_viewer(folder / "moves.html", placed, synthetic_images(placed), priors))
    window.run("viewer.store.update({ view: 1, tilt: 60 })")
    before = window.picture("overlay")
    window.press("m")
    assert window.state("moves")
    assert differ(before, window.picture("overlay")) > 1e-4
    shown = rows_of(window, "pose")
    name = Path(placed.views.name[1]).stem
    assert shown["image"] == name
    assert shown["moved"] == "50 m (prior ± 50)"
    assert shown["turned"] == "0.25° (prior ± 0.02)"
    camera, middle = placed.views.cameras[1], local_frame(placed).translation
    there = [
        camera.pixel_from_cam(each(middle)) for each in (pose[1].inverse(), priors[placed.views.name[1]].cam_from_body)
    ]
    shift = float(shown["moves the map in it by"].removesuffix(" px"))
    assert shift == pytest.approx(np.linalg.norm(there[0] - there[1]), rel=1e-3)
    window.run("viewer.store.update({ view: 0 })")
    assert rows_of(window, "pose")["pose prior"] == "none"
    window.set("moves", False)
    assert rows_of(window, "pose") == {}
    assert window.messages() == []
    window.open(page_of(folder, scene, "unmoved.html"))
    assert window.run("return document.getElementById('moves').parentElement.hidden")


def test_without_webgl_the_page_says_so(window, file):
    blocked = window.driver.execute_cdp_cmd(
        "Page.addScriptToEvaluateOnNewDocument", {"source": "HTMLCanvasElement.prototype.getContext = () => null"}
    )
    window.open(file)
    assert "WebGL" in window.run("return document.getElementById('message').textContent")
    window.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", blocked)
    window.messages()
