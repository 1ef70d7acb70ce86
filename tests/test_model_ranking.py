"""Reflectance models, ranked by how they predict views kept out."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import photoclinometry as pcm
from commands import phomo
from fault_place import small_disk
from photoclinometry.adjust.graph.sun_directions import common_turns
from photoclinometry.cli import main
from photoclinometry.evaluate.cross_validation import Predictions, is_larger
from photoclinometry.evaluate.model_ranking import RankingOptions, rank_models
from photoclinometry.io.run_files import PRODUCTS
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import so3_exp
from photoclinometry.model.progress import no_progress
from photoclinometry.model.reflectance import published
from photoclinometry.model.robust import jackknife_sigma
from photoclinometry.pipeline import model_choice
from photoclinometry.pipeline.folder.stage import Keyed, Tools
from photoclinometry.pipeline.map_stages import IntermediateMap
from photoclinometry.pipeline.model_choice import ChooseModel
from scenes import synthetic_scene

NOISE = 0.003
MODELS = ("lunar-lambert", "hapke", "minnaert")
OPTIONS = RankingOptions(models=MODELS, landmarks=300, folds=4)


def scene_of(model, body="vesta", **options):
    """A scene with noise of NOISE of the mean brightness."""
    scene = synthetic_scene(size=24, views=8, reflectance=published(model, body), brightness_noise=NOISE, **options)
    return replace(scene, body=body)


@pytest.fixture(scope="module")
def scene():
    return scene_of("lunar-lambert")


@pytest.fixture(scope="module")
def ranking(scene):
    return rank_models(scene, OPTIONS)


def test_the_model_of_the_ground_is_the_best_and_misses_little_more_than_the_noise(scene, ranking):
    """Seven lit views fit three unknowns a landmark, so that predictions have about sqrt(1 + 3 / 6) of the noise."""
    assert ranking.best.reflectance.name == "lunar-lambert"
    level = np.mean(scene.tracks.brightness[scene.tracks.lit])
    by_view = np.array([scene.tracks.brightness[scene.tracks.view == k].mean() for k in range(8)])
    assert ranking.best.error_percent == pytest.approx(100 * NOISE * 1.25 * np.mean(level / by_view), rel=0.3)
    assert ranking.best.level_percent < 0.5


def test_errors_of_a_model_are_those_without_its_parameters_by_all_views(scene, ranking):
    (alone,) = rank_models(scene, replace(OPTIONS, models=("lunar-lambert",)), with_parameters=False).fits
    np.testing.assert_array_equal(alone.error, ranking.best.error)
    np.testing.assert_array_equal(alone.reflectance.parameters, published("lunar-lambert", "vesta").parameters)
    assert not np.array_equal(ranking.best.reflectance.parameters, alone.reflectance.parameters)


def test_other_models_are_told_from_it(ranking):
    """Hapke's is; Minnaert's disk function, with a limb darkening of its own, explains the same ground."""
    pattern = {fit.reflectance.name: np.mean(fit.pattern) for fit in ranking.fits}
    assert pattern["minnaert"] < 1.05 * pattern["lunar-lambert"]
    assert ranking.is_as_good(ranking.best)
    assert ranking.fits[-1].reflectance.name == "hapke"
    assert not ranking.is_as_good(ranking.fits[-1])


def test_another_ground_has_another_best_model():
    assert rank_models(scene_of("hapke"), OPTIONS).best.reflectance.name == "hapke"


def test_parameters_are_those_of_the_ground_within_their_sigmas(scene, ranking):
    truth = published("lunar-lambert", "vesta")
    off = np.abs(ranking.best.reflectance.parameters - truth.parameters)
    assert np.all(off < 4.0 * np.maximum(ranking.best.parameter_sigma, 1e-3 * np.abs(truth.parameters)))


def test_the_model_that_a_map_was_made_with_does_not_count(scene):
    """Estimated Suns, exposures and parameters are forgotten."""
    views = replace(scene.views, scale=np.full(8, 1.1), sun=scene.views.sun @ so3_exp(np.array([0.02, 0.0, 0.0])).T)
    other = replace(scene, views=views, reflectance=published("minnaert", "vesta"))
    options = replace(OPTIONS, models=("lunar-lambert",), landmarks=100)
    found, same = (rank_models(each, options).best for each in (other, scene))
    assert found.error_percent == pytest.approx(same.error_percent, rel=1e-6)


def test_suns_that_err_together_are_turned_back_for_views_kept_out(scene):
    turn = so3_exp(np.radians([2.0, -1.0, 1.0]))
    views = replace(
        scene.views, sun_measured=scene.views.sun_measured @ turn.T, sun_common_sigma=np.full(8, np.radians(3.0))
    )
    options = replace(OPTIONS, models=("lunar-lambert",))
    together, alone = (
        rank_models(replace(scene, views=each), options).best.level_percent
        for each in (views, replace(views, sun_common_sigma=np.zeros(8)))
    )
    assert together < 0.5 < 1.5 < alone


def test_the_common_turn_takes_measured_suns_to_the_estimated_ones(scene):
    turn = np.radians([0.3, -0.2, 0.1])
    sun = (scene.views.body_from_cam.rotation @ (so3_exp(turn) @ scene.views.sun_measured[..., None]))[..., 0]
    views = replace(scene.views, sun=sun, sun_common_sigma=np.full(8, 0.1))
    np.testing.assert_allclose(common_turns(views, views.arc), np.tile(turn, (8, 1)), atol=2e-4)
    assert not common_turns(replace(views, sun_common_sigma=np.zeros(8)), views.arc).any()


def predictions(measured, predicted):
    count = len(measured)
    return Predictions(
        view=np.zeros(count, int), measured=measured, predicted=predicted, angles_deg=np.zeros((count, 3))
    )


def test_residuals_are_after_the_exposure_of_their_view():
    measured = np.array([1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(predictions(measured, 2.0 * measured).residual(1, free_bias=False), 0.0, atol=1e-12)
    shifted = predictions(measured, 2.0 * measured + 1.0)
    np.testing.assert_allclose(shifted.residual(1, free_bias=True), 0.0, atol=1e-12)
    assert np.abs(shifted.residual(1, free_bias=False)).max() > 0.05
    ones = predictions(measured, np.ones(4))
    np.testing.assert_allclose(ones.residual(1, free_bias=False), (2.5 - measured) / 2.5)


def test_the_jackknife_of_a_mean_is_its_standard_error():
    values = np.random.default_rng(0).normal(size=12)
    without_one = (values.sum() - values) / 11
    assert jackknife_sigma(without_one) == pytest.approx(values.std(ddof=1) / np.sqrt(12))


def test_few_views_tell_models_apart_only_by_large_differences():
    """Student's t: a difference of 3 standard errors counts of nine views, not of three."""
    for views, told in ((9, True), (3, False)):
        spread = np.resize([-1.0, 0.0, 1.0], views)
        spread = 1.0 + (spread - spread.mean()) / spread.std(ddof=1) * np.sqrt(views) / 3.0
        assert is_larger(np.exp(spread), np.ones(views)) == told
    assert not is_larger(np.ones(9), np.ones(9))
    assert not is_larger(np.full(1, 9.0), np.ones(1))


def test_what_cannot_be_compared_is_refused(scene):
    with pytest.raises(InputError, match="holds geometry alone"):
        rank_models(replace(scene, reflectance=None))
    with pytest.raises(InputError, match="0 landmarks are lit in 5 views or more, 50 are needed"):
        rank_models(replace(scene, tracks=replace(scene.tracks, lit=np.zeros(len(scene.tracks), bool))))
    with pytest.raises(InputError, match="no reflectance model 'lambert'"):
        rank_models(scene, RankingOptions(models=("lambert",)))
    with pytest.raises(InputError, match=r"none of the models can be fitted: minnaert: no values .* body 'bennu'"):
        rank_models(replace(scene, body="bennu"), RankingOptions(models=("minnaert",)))


def test_models_without_values_for_the_body_are_left_out_and_named(scene):
    found = rank_models(replace(scene, body="bennu"), RankingOptions(models=("minnaert", "akimov"), landmarks=100))
    assert [fit.reflectance.name for fit in found.fits] == ["akimov"]
    assert "no values" in found.left_out["minnaert"]
    assert found.best.level_percent == 0.0, "without a phase function exposures are free"


def test_of_calibrated_images_only_models_that_predict_their_brightness_compare(scene):
    found = rank_models(scene, RankingOptions(landmarks=60, folds=2))
    assert set(found.left_out) == {"akimov", "mcewen"}
    assert {"lunar-lambert", "hapke"} <= {fit.reflectance.name for fit in found.fits}
    everything = rank_models(replace(scene, brightness="dn"), RankingOptions(landmarks=60, folds=2))
    assert not everything.left_out
    assert all(fit.level_percent == 0.0 for fit in everything.fits)


def chosen(scene, known, candidates, tmp_path):
    stage = ChooseModel(relit=Keyed(IntermediateMap(scene=scene), "k"), known=known, candidates=candidates)
    return stage.make(Tools(progress=no_progress, scratch=tmp_path)).reflectance


def test_a_run_takes_the_better_model_and_keeps_its_own_where_none_is(tmp_path):
    """Of Hapke's ground; where nothing can be compared it keeps its own, too."""
    known, scene = published("lunar-lambert", "vesta"), scene_of("hapke")
    scene = replace(scene, reflectance=known)
    assert chosen(scene, known, ("lunar-lambert", "hapke"), tmp_path) == published("hapke", "vesta")
    own = scene_of("lunar-lambert")
    assert chosen(own, known, ("lunar-lambert", "hapke"), tmp_path) == known
    few = replace(scene, tracks=replace(scene.tracks, lit=scene.tracks.view < 4))
    assert chosen(few, known, ("lunar-lambert", "hapke"), tmp_path) == known


def test_a_model_that_misses_only_levels_of_views_kept_out_is_not_passed_over(ranking, scene, tmp_path, monkeypatch):
    """Of Lunar-Lambert with a phase function that extrapolates badly and Hapke with a pattern a fifth worse in each
    view, the map takes the first; where patterns differ by chance, the second."""
    fits = {fit.reflectance.name: fit for fit in ranking.fits}
    far = np.array([0.0, 0.3, 0.0, 0.5, 0.4, 0.2, 0.6, 0.3])
    shape = replace(fits["lunar-lambert"], level=far)
    worse = shape.pattern * (1.2 + 0.1 * np.cos(np.arange(8)))
    by_chance = shape.pattern * (1.0 + 0.2 * np.cos(np.pi * np.arange(8)))
    known = published("lunar-lambert", "vesta")
    for pattern, taken in ((worse, "lunar-lambert"), (by_chance, "hapke")):
        level = replace(fits["hapke"], pattern=pattern, level=np.zeros(8))
        found = replace(ranking, fits=(level, shape))
        assert found.best is level
        assert not found.is_as_good(shape)
        monkeypatch.setattr(model_choice, "rank_models", lambda *_, found=found, **__: found)
        assert chosen(scene, known, ("lunar-lambert", "hapke"), tmp_path).name == taken


def test_the_command_writes_a_table_and_a_figure(tmp_path, scene, capsys):
    from PIL import Image

    pcm.write_scene(tmp_path / "scene.h5", scene)
    main(["photometry", str(tmp_path / "scene.h5"), "--landmarks", "100", "--models", "lunar-lambert", "akimov"])
    assert {path.name for path in tmp_path.iterdir()} <= PRODUCTS  # of a run folder: `phomo run --overwrite` goes on
    content = json.loads(Path(tmp_path / "photometry" / "photometry.json").read_text())
    first, second = content["models"]
    assert (first["name"], second["name"]) == ("lunar-lambert", "akimov")
    assert first["as_good_as_the_best"]
    assert not second["as_good_as_the_best"]
    assert [parameter["name"] for parameter in first["parameters"]] == list(scene.reflectance.parameter_names)
    assert [view["name"] for view in first["views"]] == list(scene.views.name)
    assert second["level_percent"] == 0.0
    low, high = content["phase_seen_deg"]
    assert 0.0 < low < high < 90.0
    with Image.open(tmp_path / "photometry" / "photometry.png") as picture:
        assert picture.size[0] > 1000
    printed = capsys.readouterr().out
    assert "lunar-lambert *" in printed
    assert f"Phases seen: {low:.0f} to {high:.0f} degrees" in printed


def test_a_full_disk_ends_the_command_with_one_line(tmp_path, scene, ranking, capsys):
    """`ranking` compiles and caches the kernels, whose files would not fit on the small disk, either."""
    file = tmp_path / "scene.h5"
    pcm.write_scene(file, scene)
    arguments = ["--landmarks", "100", "--models", "lunar-lambert"]
    with small_disk(300):
        assert phomo("photometry", file, "--out", tmp_path / "out", *arguments) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"phomo: {tmp_path}/out/photometry.png: cannot be written: File too large")
    assert not (tmp_path / "out").exists()
