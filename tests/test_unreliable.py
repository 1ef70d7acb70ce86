"""Normals and albedos that nothing determines are no data in figures, exports and the viewer; the scene keeps them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.adjust.covariance.uncertainty import ENDLESS_RAD2, bounded_normals
from photoclinometry.evaluate.evaluate import evaluate_scene
from photoclinometry.evaluate.unreliable import albedo_is_known, known_sigmas, normal_is_known
from photoclinometry.model.sigma import largest_sigma
from photoclinometry.output.export import ExportOptions
from photoclinometry.output.export.frame import Framed
from photoclinometry.output.export.maps import write_maps
from photoclinometry.output.export.tables import landmark_columns
from photoclinometry.output.figures.layers import LAYERS, slope_deg
from photoclinometry.output.figures.maps import normal_colours
from photoclinometry.output.viewer.content import viewer_content
from photoclinometry.surface.relief import local_frame
from scenes import synthetic_scene
from viewer_data import unpacked

SIZE = 24
OVERHANGING, UNTOLD, NO_ALBEDO = SIZE * 5 + 5, SIZE * 5 + 18, SIZE * 18 + 12
"""Landmarks: one whose normal points below the mean plane, one whose normal nothing tells about one axis, and one of
unknown albedo."""


def spoilt():
    """A scene that states small uncertainties, but for the three landmarks."""
    scene = synthetic_scene(size=SIZE, views=4)
    count, normal = len(scene.landmarks), scene.landmarks.normal.copy()
    up, across = local_frame(scene).rotation[:, 2], local_frame(scene).rotation[:, 0]
    normal[OVERHANGING] = math.cos(math.radians(100.0)) * up + math.sin(math.radians(100.0)) * across
    of_normals = np.tile(np.radians(1.0) ** 2 * np.eye(2), (count, 1, 1))
    of_normals[UNTOLD] = [[np.radians(1.0) ** 2, 0.0], [0.0, np.inf]]
    albedo, share = scene.landmarks.albedo.copy(), np.full(count, 0.02)
    albedo[NO_ALBEDO], share[NO_ALBEDO] = 6.0 * albedo[NO_ALBEDO], 3.0
    stated = {
        "normal": bounded_normals(of_normals),
        "albedo": 1.1 * share * albedo,
        "albedo_relative": share * albedo,
    }
    return replace(scene, landmarks=replace(scene.landmarks, normal=normal, albedo=albedo), uncertainty=stated)


def missing(values):
    return set(np.flatnonzero(~np.isfinite(values).reshape(len(values), -1).all(1)))


def test_the_three_landmarks_are_told_from_the_others():
    scene = spoilt()
    assert set(np.flatnonzero(~normal_is_known(scene))) == {OVERHANGING, UNTOLD}
    assert set(np.flatnonzero(~albedo_is_known(scene))) == {NO_ALBEDO}
    silent = replace(scene, uncertainty={})
    assert set(np.flatnonzero(~normal_is_known(silent))) == {OVERHANGING}
    assert albedo_is_known(silent).all()


@pytest.mark.parametrize(("told_deg", "known"), [(42.0, True), (45.0, False), (90.0, False)])
def test_a_normal_is_untold_where_the_ground_says_more_of_it_than_measurements(told_deg, known):
    """What measurements alone tell about one axis: to 43 degrees is what all directions above the ground have."""
    scene = synthetic_scene(size=4, views=3)
    alone = np.tile(np.diag([1e-4, math.radians(told_deg) ** 2]), (len(scene.landmarks), 1, 1))
    scene = replace(scene, uncertainty={"normal": bounded_normals(alone)})
    assert normal_is_known(scene).all() == known
    assert normal_is_known(scene).any() == known


def test_the_largest_sigma_of_every_form():
    turned = np.array([[5.0, 4.0], [4.0, 5.0]])  # variances 9 and 1
    np.testing.assert_allclose(largest_sigma(np.array([0.5, -0.25])), [0.5, 0.25])
    np.testing.assert_allclose(largest_sigma(np.array([[3.0, 4.0], [1.0, np.inf]])), [4.0, np.inf])
    np.testing.assert_allclose(largest_sigma(np.array([turned, ENDLESS_RAD2 * np.eye(2), np.full((2, 2), np.inf)])),
                               [3.0, math.sqrt(ENDLESS_RAD2), np.inf])  # fmt: skip


def test_figures_show_no_data_there_and_the_scene_keeps_all():
    scene = spoilt()
    for name, gone in {
        "slope": {OVERHANGING, UNTOLD},
        "normals": {OVERHANGING, UNTOLD},
        "relief": {OVERHANGING, UNTOLD},
        "normal-sigma": {OVERHANGING, UNTOLD},
        "albedo": {NO_ALBEDO},
        "albedo-sigma": {NO_ALBEDO},
        "height": set(),
        "views": set(),
    }.items():
        assert missing(LAYERS[name].shown(scene)) == gone, name
    assert slope_deg(scene)[OVERHANGING] == pytest.approx(100.0)
    assert np.nanmax(LAYERS["slope"].shown(scene)) < 90.0
    assert set(np.flatnonzero(normal_colours(scene)[..., 3].ravel() == 0.0)) == {OVERHANGING, UNTOLD}


def test_figures_of_sigmas_are_of_what_is_known():
    """One albedo of 300 % would make the mean of 576 half a per cent larger."""
    scene = spoilt()
    metrics = evaluate_scene(scene)
    assert metrics["landmarks_without_normal"] == 2
    assert metrics["landmarks_without_albedo"] == 1
    assert metrics["albedo_relative_sigma_mean_percent"] == pytest.approx(2.0)
    assert metrics["normal_sigma_mean_deg"] == pytest.approx(math.sqrt(2.0), rel=1e-3)
    assert missing(known_sigmas(scene)["albedo_sigma_percent"]) == {NO_ALBEDO}


def test_maps_and_tables_have_no_data_there(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    scene = spoilt()
    framed = Framed(scene=scene, globe=None, metric=False)
    products = ["dtm", "albedo", "normals", "slope", "sigma"]
    place = local_frame(scene).inverse()(scene.landmarks.position)
    write_maps(tmp_path, framed, products, ExportOptions(resolution=scene.gsd / 4.0))
    gone = {
        "dtm": (),
        "albedo": (NO_ALBEDO,),
        "sigma_albedo": (NO_ALBEDO,),
        "sigma_albedo_relative": (NO_ALBEDO,),
        "normals": (OVERHANGING, UNTOLD),
        "slope": (OVERHANGING, UNTOLD),
        "sigma_normal": (OVERHANGING, UNTOLD),
    }
    for name, landmarks in gone.items():
        with rasterio.open(tmp_path / f"{name}.tif") as file:
            values = file.read(1, masked=True)
            for j in (OVERHANGING, UNTOLD, NO_ALBEDO):
                row, col = file.index(*place[j, :2])
                assert bool(np.ma.getmaskarray(values)[row, col]) == (j in landmarks), (name, j)
            if name == "slope":
                assert values.max() < 60.0
            if name == "albedo":
                assert values.max() < 1.5 * np.delete(scene.landmarks.albedo, NO_ALBEDO).max()
    columns = landmark_columns(framed)
    for name in ("normal_x", "normal_y", "normal_z", "sigma_normal_deg"):
        assert missing(columns[name]) == {OVERHANGING, UNTOLD}
    for name in ("albedo", "sigma_albedo", "sigma_albedo_relative"):
        assert missing(columns[name]) == {NO_ALBEDO}


def test_a_map_of_slopes_against_the_vertical_has_none_of_90_degrees(tmp_path):
    """Normals that are not told to be wrong, interpolated between."""
    rasterio = pytest.importorskip("rasterio")
    scene = replace(spoilt(), uncertainty={})
    write_maps(tmp_path, Framed(scene=scene, globe=None, metric=False), ["slope"], ExportOptions())
    with rasterio.open(tmp_path / "slope.tif") as file:
        assert file.read(1, masked=True).max() < 90.0


def test_the_viewer_is_told_which_values_not_to_show():
    scene = spoilt()
    stored = viewer_content(scene)["landmarks"]
    assert set(np.flatnonzero(unpacked(stored["unknown_normal"]))) == {OVERHANGING, UNTOLD}
    assert set(np.flatnonzero(unpacked(stored["unknown_albedo"]))) == {NO_ALBEDO}
    assert np.isfinite(unpacked(stored["normal"])).all(), "renderings need every normal"
    assert missing(unpacked(stored["sigma_albedo"])) == {NO_ALBEDO}
    assert "unknown_albedo" not in viewer_content(synthetic_scene(size=6, views=3))["landmarks"]
