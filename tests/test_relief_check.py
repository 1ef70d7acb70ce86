"""Relief beside parallax, and Suns that the estimate has moved."""

import logging
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from photoclinometry.adjust import AdjustOptions
from photoclinometry.model.geometry import angle_between, so3_exp
from photoclinometry.model.reflectance import published
from photoclinometry.model.warning import collected_warnings, warn
from photoclinometry.pipeline import checked_map
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.checked_map import CheckedMap
from photoclinometry.pipeline.checks import relief_check
from photoclinometry.pipeline.checks.moved_suns import warn_of_suns
from photoclinometry.pipeline.checks.relief_check import ReliefCheck, relief_by_parallax, warn_of_relief
from photoclinometry.pipeline.folder.run_folder import open_run
from photoclinometry.pipeline.folder.stage import Stage, Tools
from photoclinometry.pipeline.joint_estimate import EstimateSettings, JointEstimate
from photoclinometry.pipeline.response_check import ResponseCheck
from scenes import synthetic_scene

log = logging.getLogger("photoclinometry.tests")


@pytest.fixture(scope="module")
def scene():
    return synthetic_scene(size=60, views=5)


def flattened(scene, factor):
    """Heights times a factor."""
    position = scene.landmarks.position * [1.0, 1.0, factor]
    return replace(scene, landmarks=replace(scene.landmarks, position=position))


def matched(scene, noise_gsd=0.0, seed=0):
    """Positions as matches give them, in a frame of their own, and pixels, in another order, some missing."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(scene.landmarks))[:-200]
    noisy = scene.landmarks.position + noise_gsd * scene.gsd * rng.normal(size=(len(scene.landmarks), 3))
    moved = 3.0 * noisy @ so3_exp(np.array([0.3, -0.4, 0.5])).T + [100.0, 200.0, 300.0]
    return moved[order], scene.landmarks.pixel[order]


@pytest.mark.parametrize("factor", [1.0, 0.8, 1.3])
def test_relief_over_that_of_parallax_is_the_factor_of_the_heights(scene, factor):
    check = relief_by_parallax(flattened(scene, factor), *matched(scene))
    assert check.ratio == pytest.approx(factor, rel=0.02)


def test_noise_of_matches_neither_shrinks_the_relief_nor_hides_in_the_sigma(scene):
    """With noise of half a GSD the mean of 20 draws is 1; their scatter is as stated, to a factor of two."""
    checks = [relief_by_parallax(scene, *matched(scene, 0.5, seed), correlation_px=1.0) for seed in range(20)]
    ratios = np.array([check.ratio for check in checks])
    stated = np.sqrt(np.mean([check.sigma**2 for check in checks]))
    assert abs(ratios.mean() - 1.0) < 4.0 * ratios.std() / np.sqrt(20)
    assert 0.5 < stated / ratios.std() < 2.0


def test_where_matches_err_alike_a_small_map_says_less(scene):
    checks = [relief_by_parallax(scene, *matched(scene, 0.5), correlation_px=side) for side in (1.0, 5.0, 30.0)]
    assert checks[0].sigma < checks[1].sigma < checks[2].sigma
    assert checks[0].ratio == checks[2].ratio


def test_few_shared_points_say_nothing(scene):
    position, pixel = matched(scene)
    assert relief_by_parallax(scene, position[:50], pixel[:50]) is None


def test_relief_that_contradicts_parallax_is_warned_of_and_far_off_not_trusted():
    with collected_warnings() as warned:
        for check in (None, ReliefCheck(0.97, 0.001), ReliefCheck(0.8, 0.1), ReliefCheck(0.9, 0.01)):
            warn_of_relief(check)
    assert [warning.code for warning in warned] == ["relief-contradicts"]
    assert "0.90" in warned[0].words


@pytest.mark.parametrize(("ratio", "sigma"), [(1.0, 0.05), (0.95, 0.02), (0.78, 0.076), (1.3, 0.1), (0.5, 0.001)])
def test_evidence_is_the_ratio_of_the_densities_of_both_kinds_of_map(ratio, sigma):
    spoiled, sound = (
        norm.pdf(ratio, loc=1.0, scale=np.hypot(sigma, spread))
        for spread in (relief_check.SPOILED_SPREAD, relief_check.SOUND_SPREAD)
    )
    found = ReliefCheck(ratio, sigma).evidence
    assert found == pytest.approx(spoiled / sound) if sound > 0.0 else found > 1e100


def test_a_relief_is_wrong_where_parallax_says_so_and_not_where_it_says_little():
    assert ReliefCheck(0.78, 0.076).is_off(relief_check.FAR_OFF), "2.9 standard deviations"
    assert not ReliefCheck(0.78, 0.15).is_off()
    assert not ReliefCheck(0.97, 0.001).is_off(), "certain, and small"
    assert not ReliefCheck(0.9, 0.01).is_off(relief_check.FAR_OFF)


def test_suns_that_move_alike_or_alone_are_named(scene):
    views = replace(scene.views, sun_sigma=np.full(5, 1e-3), sun_common_sigma=np.full(5, 1e-2))

    def codes(moved, scene=scene):
        with collected_warnings() as warned:
            warn_of_suns(replace(scene, views=moved))
        return [(warning.code, warning.view) for warning in warned]

    assert codes(views) == []
    turned = replace(views, sun_measured=views.sun_measured @ so3_exp(np.array([0.08, 0.0, 0.0])).T)
    assert codes(turned) == [("suns-moved", "")]
    uncertain = replace(scene, uncertainty={"sun": np.full((5, 2), 0.05)})
    assert codes(turned, uncertain) == [], "4.6 degrees, and the estimate knows the Suns to 2.9"
    one = views.sun_measured.copy()
    one[2] = one[2] @ so3_exp(np.array([0.03, 0.0, 0.0])).T
    alone = replace(views, sun_measured=one, sun_common_sigma=np.zeros(5))
    assert codes(alone) == [("suns-moved", views.name[2])]
    one[2] = views.sun_measured[2] @ so3_exp(np.array([0.012, 0.0, 0.0])).T
    assert codes(replace(alone, sun_measured=one)) == [], "half a degree is what a reflectance model makes"


def test_a_map_that_contradicts_parallax_is_made_again_with_photometry_held(mapped, tmp_path, monkeypatch, no_figures):
    """Of the two the nearer one is kept; a run that goes on finds both."""
    folder = mapped.copy(tmp_path / "run")
    for held, is_kept in ((0.95, True), (0.6, False)):
        reliefs = [ReliefCheck(0.7, 0.01), ReliefCheck(held, 0.01)] * 2
        monkeypatch.setattr(checked_map, "relief_by_parallax", lambda *_, reliefs=reliefs: reliefs.pop(0))
        first = pipeline.run(mapped.site, folder)
        again = pipeline.run(mapped.site, folder)
        assert (folder / "stages" / "last_estimate_held.npz").is_file()
        codes = {warned.code for warned in first.warnings}
        assert ("photometry-held" in codes) == is_kept
        assert first.metrics["relief_over_parallax"] == (held if is_kept else 0.7)
        assert first.trusted == is_kept
        same = np.array_equal(first.scene.landmarks.position, mapped.result.scene.landmarks.position)
        assert same != is_kept
        np.testing.assert_array_equal(again.scene.landmarks.position, first.scene.landmarks.position)
        assert {warned.code for warned in again.warnings} == codes


@dataclass(frozen=True)
class Common:
    """Of both maps."""

    value: float


@dataclass(frozen=True, kw_only=True)
class Matching(Stage[Common]):
    """A stage that both maps are made from; it warns."""

    name = "matching"
    result = Common

    def make(self, tools: Tools) -> Common:
        warn(log, "view-unregistered", "c is left out", view="c")
        return Common(1.0)


@pytest.mark.parametrize("doubtful", [(), ("b",)])
def test_a_discarded_map_is_not_warned_of(tmp_path, monkeypatch, scene, doubtful):
    """Warnings of the map that is returned stay, and those that both maps share, and those about images, in a run that
    goes on, too. So does the response of the images."""

    def made(folder, *_, holds_photometry):
        folder.result_of(Matching())
        if holds_photometry:
            warn(log, "view-brightness", "a: 9 % off", view="a")
        else:
            warn(log, "suns-moved", "all Suns are off alike. The map takes that into account")
            warn(log, "suns-moved", "b: its Sun is off. The map takes that into account", view="b")
            warn(log, "view-brightness", "a: 5 % off", view="a")
            warn(log, "response-not-linear", "the images are not linear")
        relief = ReliefCheck(held if holds_photometry else 0.7, 0.01)
        adjustment = SimpleNamespace(scene=scene)
        finished = SimpleNamespace(value=SimpleNamespace(adjustment=adjustment))
        response = None if holds_photometry else ResponseCheck(gamma=2.0, is_clear=True)
        return CheckedMap(
            finished=finished, iterations=(), pose_priors={}, relief=relief, left_out={}, response=response
        )

    monkeypatch.setattr(checked_map, "_mapped", made)
    site = SimpleNamespace(choices=SimpleNamespace(reflectance=scene.reflectance))
    shared = {("view-unregistered", "c is left out"), ("response-not-linear", "the images are not linear")}
    undecided = "the Sun directions and the brightness of the views contradict each other (b)"
    of_held = {("view-brightness", "a: 9 % off"), *(("sun-undecided", undecided) for _ in doubtful)}
    moved = {("suns-moved", "all Suns are off alike"), ("suns-moved", "b: its Sun is off")}
    for held, stated in ((0.95, of_held | shared), (0.6, {("view-brightness", "a: 5 % off"), *moved} | shared)):
        for _ in range(2):
            folder = open_run(tmp_path)
            with collected_warnings() as folder.warned:
                kept = checked_map.checked_map(folder, site, SimpleNamespace(doubtful=doubtful), None)
            assert kept.relief.ratio == held or held == 0.6
            assert kept.response.gamma == 2.0, "without it, `phomo calibrate --response` finds nothing"
            found = {(warned.code, warned.words.split(". ")[0].split(", and ")[0]) for warned in folder.warnings}
            assert {row for row in found if row[0] != "photometry-held"} == stated
            assert any(code == "photometry-held" for code, _ in found) == (held == 0.95)


def test_held_photometry_stays_where_it_is_stated(scene):
    """Of a scene whose measured Suns are all off by 2 degrees, as its sigmas allow: they are followed, or not."""
    views = scene.views
    off = replace(
        views,
        sun_measured=views.sun_measured @ so3_exp(np.radians([2.0, 0.0, 0.0])).T,
        sun_common_sigma=np.full(len(views), np.radians(5.0)),
    )
    start, options = replace(scene, views=off), AdjustOptions(uncertainty=False)

    def turned(found):
        measured = np.einsum("kij,kj->ki", found.views.body_from_cam.rotation, off.sun_measured)
        return np.degrees(angle_between(found.views.sun, measured).max())

    model = scene.reflectance
    free, held = (
        JointEstimate(options=options, reflectance=model, holds_photometry=holds)(start, EstimateSettings()).scene
        for holds in (False, True)
    )
    assert turned(held) < 0.2 < 1.0 < turned(free)
    assert held.reflectance == model != free.reflectance
    np.testing.assert_array_equal(held.views.sun_common_sigma, off.sun_common_sigma)
    np.testing.assert_array_equal(held.views.sun_sigma, off.sun_sigma)


def test_a_tile_whose_photometry_is_held_finishes_with_the_model_of_its_body():
    known, chosen = published("mcewen", "vesta"), published("hapke", "vesta")
    choices = SimpleNamespace(reflectance=known, candidates=(), last_reflectance=chosen)
    assert checked_map._last_model(None, choices, None, holds_photometry=True) is chosen
    of_a_place = SimpleNamespace(reflectance=known, candidates=("hapke",), last_reflectance=None)
    assert checked_map._last_model(None, of_a_place, None, holds_photometry=True) is known
