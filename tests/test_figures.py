"""Pictures of maps show the scene's numbers, in true directions and sizes; figures for publication are as asked."""

import base64
import re
import zlib
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

import photoclinometry as pcm
from commands import phomo
from photoclinometry.io.scene_file import write_scene
from photoclinometry.model.geometry import Similarity, sphere_step, unit
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.output.figures.draw import colour_map, limits
from photoclinometry.output.figures.journal import draw_figure, style_of
from photoclinometry.output.figures.layers import LAYERS, slope_deg, slope_sigma_deg
from photoclinometry.output.figures.maps import contour_levels, normal_colours
from photoclinometry.output.figures.marks import ground_per_pixel, north_in_image, scale_bar, sun_in_image
from photoclinometry.output.figures.profile import profile
from photoclinometry.output.figures.residuals import residuals
from photoclinometry.registration.alignment import transform_scene
from photoclinometry.surface.relief import heights, local_frame
from scenes import GSD, bumpy_surface, synthetic_scene, thinned, with_landmarks

RADIUS = 2.6e5
"""Of the body that a map is placed on [m]."""
SVG = {"svg": "http://www.w3.org/2000/svg"}


def with_sigmas(scene):
    """Uncertainties that differ from landmark to landmark and from axis to axis."""
    rng, count = np.random.default_rng(3), len(scene.landmarks)
    root = rng.normal(size=(count, 3, 3))
    angle = 0.02 * rng.normal(size=(count, 2, 2))
    stated = {
        "position": 4.0 * root @ np.swapaxes(root, 1, 2),
        "normal": angle @ np.swapaxes(angle, 1, 2),
        "albedo": rng.uniform(0.001, 0.01, count),
    }
    return replace(scene, uncertainty=stated)


def placed(scene, lon_deg, lat_deg):
    """A local map (x east, y north, z up) on a body."""
    lon, lat = np.radians([lon_deg, lat_deg])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    rotation = np.stack([east, np.cross(up, east), up], -1)
    return replace(transform_scene(Similarity(1.0, rotation, RADIUS * up), scene), frame=BODY_FIXED)


@pytest.fixture(scope="module")
def scene():
    """A map of 40 x 40 with a hole and stated uncertainties."""
    whole = with_sigmas(synthetic_scene(size=40, views=4, keypoint_noise_px=0.1, brightness_noise=0.01))
    row, col = whole.cells
    there = (np.abs(row - 10) > 3) | (np.abs(col - 30) > 4)
    holed = with_landmarks(whole, there)
    return replace(holed, uncertainty={name: values[there] for name, values in whole.uncertainty.items()})


@pytest.fixture
def ax():
    return Figure().subplots()


@pytest.mark.parametrize("name", sorted(set(LAYERS) - {"height", "normals"}))
def test_the_values_drawn_are_those_of_the_scene_and_holes_are_blank(scene, ax, name):
    assert pcm.plot(scene, name, ax=ax) is ax
    drawn = ax.images[0].get_array()
    expected = scene.grid(LAYERS[name].values(scene))
    np.testing.assert_array_equal(np.ma.getmaskarray(drawn), ~np.isfinite(expected))
    np.testing.assert_array_equal(drawn.compressed(), expected[np.isfinite(expected)])
    assert ax.images[0].cmap(np.nan)[3] == 0.0
    assert drawn.mask.sum() >= 63


def test_layers_are_the_landmarks_in_their_units(scene):
    """Metres where the frame is body-fixed, GSD elsewhere."""
    np.testing.assert_array_equal(LAYERS["albedo"].values(scene), scene.landmarks.albedo)
    np.testing.assert_allclose(LAYERS["height"].values(scene) * scene.gsd, heights(scene))
    metres = placed(scene, 10.0, 20.0)
    np.testing.assert_allclose(LAYERS["height"].values(metres), heights(scene), atol=1e-6 * GSD)
    assert LAYERS["height"].label(scene) == "height [GSD]"
    assert LAYERS["height-sigma"].label(metres) == "sigma of the height [m]"
    up = local_frame(metres).rotation[:, 2]
    variance = np.einsum("i,nij,j->n", up, metres.uncertainty["position"], up)
    np.testing.assert_allclose(LAYERS["height-sigma"].values(metres), np.sqrt(variance))


def test_contours_are_where_the_heights_are(scene, ax):
    """Every point of a contour of level c lies between landmarks of height c, as linear interpolation has it."""
    pcm.plot(scene, "height", ax=ax, clim=(-2.0, 2.0))
    (contours,) = ax.collections
    levels = contour_levels((-2.0, 2.0))
    spacing, points = levels[1] - levels[0], 0
    assert ax.get_title() == f"Height, contours {spacing:.3g} GSD"
    assert ax.child_axes[0].get_ylabel() == "height [GSD]"
    middle = (scene.region.col + 20.0, scene.region.row + 20.0)
    for level, path in zip(levels, contours.get_paths(), strict=True):
        for x, y in path.vertices[:: max(1, len(path.vertices) // 20)]:
            found = profile(scene, LAYERS["height"], (x, y), middle).value[0]
            assert found == pytest.approx(level, abs=1e-6)
            points += 1
    assert points > 30


def test_normals_differ_in_lightness_and_in_blue_against_yellow(scene):
    """People who confuse red with green tell all four directions apart."""
    frame = local_frame(scene).rotation
    facing = {"right": [0.4, 0, 1], "left": [-0.4, 0, 1], "up": [0, 0.4, 1], "down": [0, -0.4, 1]}
    count = len(scene.landmarks)
    colours = {}
    for k, way in enumerate(facing.values()):
        normal = np.broadcast_to(frame @ unit(np.array(way)), (count, 3)).copy()
        colours[list(facing)[k]] = normal_colours(replace(scene, landmarks=replace(scene.landmarks, normal=normal)))[
            0, 0
        ]
    lightness = {way: colour[:3] @ [0.299, 0.587, 0.114] for way, colour in colours.items()}
    assert lightness["up"] - lightness["down"] > 0.5
    assert abs(lightness["right"] - lightness["left"]) < 0.1
    assert colours["left"][2] - colours["right"][2] > 0.5
    holes = normal_colours(scene)[..., 3] == 0.0
    np.testing.assert_array_equal(holes, ~np.isfinite(scene.grid(scene.landmarks.albedo)))


def test_the_scale_bar_is_as_long_as_it_says(scene):
    """The mean distance of neighbouring columns of landmarks along the mean plane, and the bar's own words."""
    across, along, _ = np.moveaxis(scene.grid(local_frame(scene).inverse()(scene.landmarks.position)), -1, 0)
    measured = np.nanmean(across[:, -1] - across[:, 0]) / 39, np.nanmean(along[0] - along[-1]) / 39
    np.testing.assert_allclose(ground_per_pixel(scene), measured, rtol=0.01)
    for shown, unit_length in ((scene, scene.gsd), (placed(scene, 0.0, 0.0), 1.0)):
        pixels, words = scale_bar(shown)
        length, name = words.split()
        assert name == ("GSD" if shown is scene else "m")
        assert pixels * ground_per_pixel(shown)[0] == pytest.approx(float(length) * unit_length)
        assert 0.1 * 40 < pixels < 0.4 * 40


def test_north_is_the_direction_of_the_pole(scene):
    """Where the map's y is north, its arrow is that of y in the image; in a frame of its own nobody knows."""
    middle = local_frame(scene).translation
    before, after = scene.views.project(scene.reference, middle + np.array([[0, -1.0, 0], [0, 1.0, 0]]))
    found = north_in_image(placed(scene, 130.0, -35.0))
    assert found is not None
    np.testing.assert_allclose(found, unit(after - before), atol=2e-3)
    assert north_in_image(scene) is None
    assert north_in_image(placed(scene, 0.0, 90.0)) is None


def test_shadows_fall_away_from_the_arrow_to_the_sun(scene):
    """The shadow of a pole's top on the mean plane lies, as seen from its foot, opposite to the arrow."""
    frame = local_frame(scene)
    for view in range(len(scene.views)):
        sun = scene.views.sun[view]
        foot = frame.translation
        top = foot + 0.5 * scene.gsd * frame.rotation[:, 2]
        shadow = top - sun * ((top - foot) @ frame.rotation[:, 2]) / (sun @ frame.rotation[:, 2])
        at_foot, at_shadow = scene.views.project(scene.reference, np.stack([foot, shadow]))
        found = sun_in_image(scene, view)
        assert found is not None
        np.testing.assert_allclose(found, -unit(at_shadow - at_foot), atol=1e-4)
    overhead = np.tile(frame.rotation[:, 2], (len(scene.views), 1))
    assert sun_in_image(replace(scene, views=replace(scene.views, sun=overhead)), 0) is None


@pytest.mark.parametrize("stride", [1, 3])
def test_a_profile_has_the_landmarks_values_sigmas_and_distances(stride):
    """Along a row of the grid: the landmarks themselves; distances are those of their places on the mean plane."""
    scene = with_sigmas(synthetic_scene(size=40, views=3))
    if stride > 1:
        scene = with_sigmas(thinned(scene, stride))
    region, (rows, cols) = scene.region, scene.region.grid_shape
    y = region.row + 0.5 + stride * 4
    ends = (region.col + 0.5, y), (region.col + 0.5 + stride * (cols - 1), y)
    found = profile(scene, LAYERS["height"], *ends)
    assert rows > 5
    np.testing.assert_allclose(found.value, scene.grid(LAYERS["height"].values(scene))[4], atol=1e-9)
    assert found.sigma is not None
    np.testing.assert_allclose(found.sigma, scene.grid(LAYERS["height-sigma"].values(scene))[4], atol=1e-9)
    place = scene.grid(local_frame(scene).inverse()(scene.landmarks.position)[:, :2])[4] / scene.gsd
    assert found.distance[-1] - found.distance[0] == pytest.approx(np.linalg.norm(place[-1] - place[0]), rel=1e-4)
    assert (np.diff(found.distance) > 0).all()


def test_a_profile_follows_the_true_ground():
    """Between landmarks, too: heights of the analytic surface over the plane, to what linear interpolation leaves."""
    scene = synthetic_scene(size=40, views=3)
    frame = local_frame(scene)
    region = scene.region
    start, end = (region.col + 3.2, region.row + 5.9), (region.col + 35.1, region.row + 30.4)
    found = profile(scene, LAYERS["height"], start, end)
    camera, pose = scene.views.cameras[0], scene.views.body_from_cam[0]
    point = bumpy_surface().hit(
        np.broadcast_to(pose.translation, (len(found.pixel), 3)), camera.ray_in_cam(found.pixel) @ pose.rotation.T
    )
    local = frame.inverse()(point) / scene.gsd
    np.testing.assert_allclose(found.value, local[:, 2], atol=0.03)
    along = (local[:, :2] - local[0, :2]) @ unit(local[-1, :2] - local[0, :2])
    np.testing.assert_allclose(found.distance - found.distance[0], along, atol=0.02)
    assert found.sigma is None


def test_a_profile_begins_where_its_first_end_is_and_not_where_the_map_is(scene, ax):
    """From 21 px beside the map: its first landmark is 21 px along, and A is at the end."""
    region, y = scene.region, scene.region.row + 5.5
    near, far = (profile(scene, LAYERS["albedo"], (region.col - x, y), (region.col + 39.5, y)) for x in (0.5, 21.5))
    first = [float(each.distance[np.isfinite(each.distance)][0]) for each in (near, far)]
    assert first[1] - first[0] == pytest.approx(21.0, abs=0.5)
    assert far.length - near.length == pytest.approx(21.0, abs=0.5)
    pcm.plot_profile(scene, (region.col - 21.5, y), (region.col + 39.5, y), layer="albedo", ax=ax)
    assert ax.get_xlim() == (0.0, pytest.approx(far.length))


def test_a_profile_has_a_gap_where_the_map_has_a_hole(scene):
    region = scene.region
    y = region.row + 10.5
    found = profile(scene, LAYERS["albedo"], (region.col + 0.5, y), (region.col + 39.5, y))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.value)), np.arange(26, 35))


def test_the_sigma_of_slopes_is_that_of_normals_moved_downhill(scene):
    """Against differences: the slope's derivatives by the two components of the normal's error, and its covariance."""
    step = 1e-6
    moved = []
    for axis in np.eye(2):
        normal = sphere_step(scene.landmarks.normal, np.broadcast_to(step * axis, (len(scene.landmarks), 2)))
        moved.append(slope_deg(replace(scene, landmarks=replace(scene.landmarks, normal=normal))))
    derivative = (np.stack(moved, -1) - slope_deg(scene)[:, None]) / step
    covariance = scene.uncertainty["normal"]
    expected = np.sqrt(np.einsum("ni,nij,nj->n", derivative, covariance, derivative))
    sloping = slope_deg(scene) > 1.0
    np.testing.assert_allclose(slope_sigma_deg(scene)[sloping], expected[sloping], rtol=1e-3)


def test_residuals_are_of_the_views(scene, ax):
    """The boxes' middles are the medians; the map of a view has the residuals of its landmarks."""
    found = residuals(scene, "brightness")
    tracks = scene.tracks
    predicted = pcm.render(scene, view="002", geometry="reference")
    pcm.plot_residuals(scene, ax=ax)
    middles = sorted(line.get_ydata()[0] for line in ax.lines if len(line.get_ydata()) == 2 and line.get_color() != "k")
    medians = [np.median(found[tracks.view == k]) for k in range(len(scene.views))]
    assert all(np.abs(np.array(middles) - median).min() < 1e-12 for median in medians)
    beside = Figure().subplots()
    pcm.plot_residuals(scene, view="002", ax=beside)
    drawn = beside.images[0].get_array()
    measured = scene.grid(tracks.brightness[tracks.view == 2])
    expected = 100.0 * (predicted.brightness - measured) / np.nanmean(measured)
    np.testing.assert_allclose(drawn[~drawn.mask], expected[np.isfinite(expected)], atol=1e-4)
    with pytest.raises(pcm.InputError, match="no residuals 'colour'"):
        residuals(scene, "colour")


def test_plots_make_their_own_axes_where_none_are_given(scene):
    axes = pcm.plot(scene, "slope")
    assert axes.figure in map(plt.figure, plt.get_fignums())
    plt.close(axes.figure)


@pytest.mark.parametrize(
    ("layer", "message"),
    [("colour", "no layer 'colour'; known: albedo, relief"), ("height-sigma", "states no uncertainty of the height")],
)
def test_layers_that_there_are_not_are_refused(scene, layer, message):
    with pytest.raises(pcm.InputError, match=message):
        pcm.plot(replace(scene, uncertainty={}), layer)


@pytest.fixture(scope="module")
def run(scene, tmp_path_factory):
    """The folder of a run whose map is `scene`."""
    folder = tmp_path_factory.mktemp("run")
    write_scene(folder / "scene.h5", scene)
    return folder


PROFILE = ("--profile", 42, 45, 60, 62)


def test_a_pdf_has_its_size_its_fonts_and_its_text(run, tmp_path):
    out = tmp_path / "figure.pdf"
    assert phomo("figure", run, "--out", out, "--layers", "albedo", "height", *PROFILE, "--width-mm", 150) == 0
    data = out.read_bytes()
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", data)
    assert box is not None
    assert float(box[1]) == pytest.approx(150 * 72 / 25.4, abs=1e-3)
    assert data.count(b"/FontFile2") == data.count(b"/Type /FontDescriptor") >= 2  # plain, and bold for the letters
    streams = [found[1] for found in re.finditer(rb"stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL)]
    page = b"".join(_inflated(stream) for stream in streams)
    text = b"".join(re.findall(rb"\((.*?)\)", page)).replace(b"\0", b"")  # of the operators TJ and Tj, without kerning
    for words in (b"Albedo", b"Height, contours", b"normal albedo", b"distance"):
        assert words in text
    again = tmp_path / "again.pdf"
    assert phomo("figure", run, "--out", again, "--layers", "albedo", "height", *PROFILE, "--width-mm", 150) == 0
    assert again.read_bytes() == data


def _inflated(stream: bytes) -> bytes:
    try:
        return zlib.decompress(stream)
    except zlib.error:
        return b""


def test_an_svg_has_its_size_its_fonts_its_text_and_the_maps_values(run, scene, tmp_path):
    """Text is text, the letters' shapes lie in the file, and the map's picture is the albedo at the stated dpi."""
    out = tmp_path / "figure.svg"
    assert phomo("figure", run, "--out", out, "--layers", "albedo", "--dpi", 254, "--width-mm", 90) == 0
    text = out.read_text(encoding="utf-8")
    root = ElementTree.fromstring(text)
    assert float(root.attrib["width"].removesuffix("pt")) == pytest.approx(90 * 72 / 25.4, abs=1e-3)
    words = ["".join(element.itertext()) for element in root.iterfind(".//svg:text", SVG)]
    assert {"Albedo", "normal albedo [I/F]"} <= set(words)
    assert text.count("src:url(data:font/ttf;base64,") == 2
    element = next(e for e in root.iterfind(".//svg:image", SVG) if float(e.attrib["width"]) > 40)
    data = base64.b64decode(element.attrib["{http://www.w3.org/1999/xlink}href"].split(",")[1])
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert "scale(1 -1)" in element.attrib["transform"]
    picture, side = picture[::-1], len(picture)
    assert side == pytest.approx((90 - 1.0 - 12.5) / 1.065 * 254 / 25.4, abs=2)
    middles = ((np.arange(40) + 0.5) * side / 40).astype(int)
    albedo = scene.grid(scene.landmarks.albedo)
    low, high = limits(albedo)
    expected = 255 * colour_map("gray")(np.clip((albedo - low) / (high - low), 0, 1))
    there = np.isfinite(albedo)
    shown = picture[np.ix_(middles, middles)].astype(float)
    assert np.abs(shown[there][:, 0] - expected[there][:, 0]).max() < 4
    assert (shown[~there][:, 3] == 0).all()


def test_labels_of_colour_bars_leave_the_next_map_free(scene):
    """Albedos of a dark body, whose values need three decimals."""
    dark = replace(scene.landmarks, albedo=np.linspace(0.0318, 0.0532, len(scene.landmarks)))
    options = pcm.FigureOptions(layers=("albedo", "height", "slope"), columns=2, across=3)
    with matplotlib.rc_context(style_of(options)):
        found = draw_figure(replace(scene, landmarks=dark), options)
        found.canvas.draw()
        first, second = found.axes[:2]
        gap = second.get_window_extent().x0 - first.child_axes[0].get_tightbbox().x1
    assert gap > 0.03 * found.dpi  # a thirtieth of an inch


def test_a_png_has_the_pixels_of_its_size(run, tmp_path):
    out = tmp_path / "figure.png"
    assert phomo("figure", run, "--out", out, "--columns", 2, "--dpi", 100, "--no-letters") == 0
    picture = cv2.imread(str(out))
    assert picture.shape[1] == pytest.approx(190 * 100 / 25.4, abs=1)


def test_a_figure_is_refused_with_exit_code_2_and_leaves_nothing(run, tmp_path, capsys):
    assert phomo("figure", run, "--out", tmp_path / "a.pdf", "--layers", "colour") == 2
    assert "albedo" in capsys.readouterr().err
    with pytest.raises(pcm.InputError, match="layers='colour': must be one of 'albedo'"):
        pcm.figure(run, tmp_path / "a.pdf", layers=("colour",))
    with pytest.raises(pcm.InputError, match="has no profile"):
        pcm.figure(run, tmp_path / "a.pdf", profile=(42, 45, 60, 62), profile_layer="normals")
    assert list(tmp_path.iterdir()) == []
