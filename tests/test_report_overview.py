"""The first screen of a report says what the scene and its figures say, in words."""

from dataclasses import replace

import numpy as np
import pytest

from photoclinometry.evaluate.evaluate import evaluate_scene
from photoclinometry.evaluate.illumination import sun_span_deg
from photoclinometry.evaluate.tables import digits
from photoclinometry.evaluate.verdict import CARE, SOUND, WRONG, Judgement
from photoclinometry.model.scene import BODY_FIXED
from photoclinometry.model.warning import Warned
from photoclinometry.output.report.facts import with_sigma
from photoclinometry.output.report.first_screen import first_screen
from photoclinometry.output.report.overview import light, overview
from photoclinometry.output.report.weak_places import BLOCKS, block_side, block_values, weak_places
from photoclinometry.surface.relief import local_frame
from scenes import synthetic_scene

WARNED = Warned("view-left-out", "a view is left out")
METRICS = {
    "height_sigma_median_gsd": 0.0512,
    "normal_sigma_median_deg": 1.234,
    "albedo_sigma_median_percent": 0.71,
    "psnr_mean_db": 41.26,
    "psnr_min_db": 38.11,
    "psnr_held_out_mean_db": 39.94,
    "completeness_percent": 97.31,
}


@pytest.fixture(scope="module")
def scene():
    """A map of 40 x 40 landmarks in 6 views, with even uncertainties."""
    bare = synthetic_scene(size=40, views=6, brightness_noise=0.01)
    stated = {"position": np.tile(9.0 * np.eye(3), (1600, 1, 1)), "normal": np.tile(1e-4 * np.eye(2), (1600, 1, 1))}
    return replace(bare, uncertainty=stated)


def facts(found):
    return {fact.name: fact.value for fact in (*found.what, *found.quality)}


def test_the_facts_are_those_of_the_scene_and_its_figures(scene):
    rows = [{"name": "a", "used": True}, {"name": "b", "held_out": True}, {"name": "c", "left_out": "no match"}]
    found = overview(scene, METRICS, rows)
    told = facts(found)
    width, height = (float(word) for word in told["Size"].removesuffix(" GSD").split(" x "))
    place = local_frame(scene).inverse()(scene.landmarks.position)[:, :2] / scene.gsd
    np.testing.assert_allclose([width, height], np.ptp(place, axis=0) * 40 / 39, rtol=0.03)
    assert told["GSD"] == "of unknown length"
    assert told["Views"] == "6 used, 1 held out, 1 left out"
    assert told["Heights"] == "± 0.051 GSD"
    assert told["Normals"] == "± 1.2°"
    assert told["Albedos"] == "± 0.71 %"
    assert told["PSNR, used"] == "41.3 dB"
    assert told["PSNR, held out"] == "39.9 dB"
    assert told["Completeness"] == "97.3 %"
    assert found.verdict == SOUND
    assert found.reasons == found.places == ()


def test_the_dark_level_of_uncalibrated_images_is_told(scene):
    """Of calibrated ones there is none to tell."""
    assert scene.brightness == "iof"
    assert "Dark level" not in facts(overview(scene, METRICS, ()))
    levels = {"unknown": np.zeros(6), "0 to 190": np.array([0.0, 135, 150, 190, 150, 150]), "20": np.full(6, 20.0)}
    for told, level in levels.items():
        raw = replace(scene, brightness="dn", views=replace(scene.views, dark_level=level))
        assert facts(overview(raw, METRICS, ()))["Dark level"] == told


def test_the_width_of_the_point_spread_function_is_told_where_it_was_used(scene):
    assert "Point-spread function" not in facts(overview(scene, METRICS, ()))
    assert facts(overview(scene, METRICS | {"psf_sigma_px": 0.614}, ()))["Point-spread function"] == "0.61 px"


def test_lengths_are_in_metres_where_these_are_known(scene):
    told = facts(overview(replace(scene, frame=BODY_FIXED), METRICS, ()))
    assert told["GSD"] == f"{scene.gsd:.1f} m"
    assert told["Heights"] == "± 0.051 GSD = 3.1 m"
    assert told["Size"].endswith(" km")


def test_figures_of_a_whole_scene_are_told(scene):
    """By the keys that `evaluate_scene` gives, which the page must know."""
    told = facts(overview(scene, evaluate_scene(scene), ()))
    assert told["Heights"] == f"± {3.0 / scene.gsd:.3f} GSD"
    assert told["Normals"] == f"± {np.degrees(np.sqrt(2e-4)):.2f}°"[:-2] + "1°"


def test_light_is_that_of_level_ground(scene):
    """Incidence and emission against the vertical, which the mean plane's normal is within a degree; phase exactly."""
    found = light(scene)
    up = np.array([0.0, 0.0, 1.0])
    camera = scene.views.body_from_cam.translation
    to_camera = camera / np.linalg.norm(camera, axis=1, keepdims=True)
    np.testing.assert_allclose(found["incidence"], np.degrees(np.arccos(scene.views.sun @ up)), atol=1.5)
    np.testing.assert_allclose(found["emission"], np.degrees(np.arccos(to_camera @ up)), atol=1.5)
    phase = np.degrees(np.arccos(np.sum(scene.views.sun * to_camera, -1)))
    np.testing.assert_allclose(found["phase"], phase, atol=0.1)
    pairs = np.degrees(np.arccos(np.clip(scene.views.sun @ scene.views.sun.T, -1, 1)))
    assert sun_span_deg(scene.views) == pytest.approx(pairs.max(), abs=1e-3)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"normal_sigma_median_deg": 9.0}, "normals are uncertain: 9.00°"),
        ({"height_sigma_median_gsd": 0.8}, "heights are uncertain: 0.800 GSD"),
        ({"completeness_percent": 60.0}, "40 % of the lit region are not mapped"),
        ({"relief_over_parallax": 0.9, "relief_over_parallax_sigma": 0.13}, "parallax checks the relief to 13 % only"),
        ({"psnr_held_out_mean_db": 30.0}, "predicted 11.3 dB worse"),
    ],
)
def test_doubtful_figures_make_a_map_one_to_take_care_of(scene, figures, words):
    found = overview(scene, METRICS | figures, ())
    assert found.verdict == CARE
    (reason,) = found.reasons
    assert words in reason


def test_few_views_and_even_light_make_a_map_one_to_take_care_of(scene):
    few = synthetic_scene(size=12, views=3)
    few = replace(few, views=replace(few.views, sun=np.tile(few.views.sun[:1], (3, 1))))
    found = overview(few, METRICS, ())
    assert [reason.split(":")[0] for reason in found.reasons[:2]] == ["few views", "the light hardly changes"]
    assert found.reasons[2] == "no uncertainties were computed"


def test_warnings_and_distrust_decide_the_verdict(scene):
    assert overview(scene, METRICS, (), Judgement(warnings=(WARNED,))).verdict == CARE
    wrong = overview(scene, METRICS, (), Judgement(warnings=(WARNED,), distrust=("not converged",)))
    assert wrong.verdict == WRONG
    assert wrong.reasons == ("not converged",)
    html = first_screen(wrong, "overview.png", "<caption>")
    assert html.index("Do not trust") < html.index("not converged") < html.index("1 warning") < html.index("What was")
    assert "&lt;caption&gt;" in html


def test_the_worst_places_are_where_the_map_is_bad(scene):
    """A block of large sigmas in the lower left, and one of views that see nothing in the upper right."""
    side, region = block_side(scene.region.grid_shape), scene.region
    assert side == 40 / BLOCKS
    row, col = scene.cells
    bad = (row >= 35) & (col < 5)
    position = scene.uncertainty["position"].copy()
    position[bad] *= 16.0
    rough = replace(scene, uncertainty={"position": position})
    unseen = (row < 5) & (col >= 35)
    kept = ~(unseen[rough.tracks.landmark] & (rough.tracks.view > 1))
    count = np.bincount(rough.tracks.landmark[kept], minlength=1600)
    tracks = replace(
        rough.tracks,
        start=np.concatenate([[0], np.cumsum(count)]),
        **{n: getattr(rough.tracks, n)[kept] for n in ("view", "keypoint", "keypoint_sigma", "brightness", "lit")},
    )
    views, heights = weak_places(replace(rough, tracks=tracks))
    assert views.corner == (region.col + 35.0, region.row + 0.0)
    assert views.where == f"upper right, around column {region.col + 37.5:.0f}, row {region.row + 2.5:.0f}"
    assert views.words == "fewest views: 2 in the mean, of the whole map 5.94"
    assert heights.corner == (region.col + 0.0, region.row + 35.0)
    assert heights.size == (5.0, 5.0)
    assert heights.where.startswith("lower left")
    assert heights.words == "largest uncertainty of heights: 0.2 GSD in the median, of the whole map 0.05 GSD"


def test_blocks_with_too_few_landmarks_are_not_judged():
    grid = np.full((8, 8), np.nan)
    grid[:4, :4] = np.arange(16.0).reshape(4, 4)
    grid[0, 4:7] = 100.0
    found = block_values(grid, 4, mean=True)
    assert found[0, 0] == 7.5
    assert np.isnan(found[0, 1])
    assert np.isnan(found[1]).all()


def test_numbers_have_their_digits():
    assert [digits(value) for value in (0.05123, 1.0, 181.4, 12345.0)] == ["0.0512", "1.00", "181", "12\u202f345"]
    assert digits(0.0512, 2) == "0.051"


def test_a_value_has_the_digits_of_its_sigma():
    assert with_sigma(3.06058, 0.00124) == "3.0606 ± 0.0012"
    assert with_sigma(123456.7, 210.0) == "123\u202f457 ± 210"
    assert with_sigma(3.06058, float("nan")) == "3.06"
