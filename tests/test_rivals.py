"""A run beside its rivals: what they are given, the same pixels and figures for all, and the command."""

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

import photoclinometry as pcm
from commands import phomo
from photoclinometry.io.held_out import write_held_out
from photoclinometry.io.options import write_options
from photoclinometry.io.run_files import PRODUCTS, read_config
from photoclinometry.model.image import Image
from photoclinometry.pipeline.folder.run_mark import MARK
from photoclinometry.pipeline.options import RelightOptions, RunOptions
from photoclinometry.rivals.compare import run_cost
from photoclinometry.rivals.measure import common_masks, exposed, image_figures
from photoclinometry.rivals.mvs import options_from
from photoclinometry.rivals.outcome import Outcome, costed, rendered_map
from photoclinometry.rivals.problem import Problem, read_problem
from photoclinometry.rivals.ssim import ssim, ssim_and_gradient
from scenes import synthetic_images, synthetic_scene


@pytest.fixture(scope="module")
def problem():
    scene = synthetic_scene(size=24, views=4)
    return Problem(scene=scene, images=synthetic_images(scene), held_out=None)


def test_similarity_of_a_picture_with_itself_is_one_and_with_its_negative_is_negative():
    picture = np.random.default_rng(0).uniform(0.2, 0.8, (40, 40))
    mask = np.ones(picture.shape, bool)
    assert ssim(picture, picture, mask) == pytest.approx(1.0, abs=1e-12)
    assert ssim(picture, 1.0 - picture, mask) < -0.5


def test_similarity_of_constant_pictures_is_that_of_their_means():
    """Wang et al. (2004), Eq. 6: without contrast only luminance is left, (2 x y + C1) / (x^2 + y^2 + C1)."""
    mask = np.ones((20, 20), bool)
    mask[5:8, 3:9] = False
    expected = (2 * 0.2 * 0.6 + 1e-4) / (0.2**2 + 0.6**2 + 1e-4)
    assert ssim(np.full((20, 20), 0.2), np.full((20, 20), 0.6), mask) == pytest.approx(expected, abs=1e-9)


def test_the_derivative_of_similarity_is_that_of_differences_and_zero_outside_the_mask():
    rng = np.random.default_rng(1)
    picture, other = rng.uniform(0.2, 0.8, (2, 18, 21))
    mask = rng.uniform(size=picture.shape) > 0.2
    value, gradient = ssim_and_gradient(picture, other, mask)
    assert value == pytest.approx(ssim(picture, other, mask))
    assert not gradient[~mask].any()
    for row, col in np.argwhere(mask)[::23]:
        moved = []
        for step in (1e-6, -1e-6):
            changed = picture.copy()
            changed[row, col] += step
            moved.append(ssim(changed, other, mask))
        assert gradient[row, col] == pytest.approx((moved[0] - moved[1]) / 2e-6, rel=1e-5, abs=1e-9)


def test_all_methods_are_compared_where_all_have_a_prediction(problem):
    rendered, covered = rendered_map(problem, problem.scene)
    half = [mask.copy() for mask in covered]
    for mask in half:
        mask[:, : mask.shape[1] // 2] = False
    whole = Outcome(name="whole", rendered=rendered, covered=covered, knows_light=True)
    part = Outcome(name="part", rendered=rendered, covered=half, knows_light=True)
    masks = common_masks(problem, [whole, part])
    assert all((mask <= other).all() and mask.any() for mask, other in zip(masks, half, strict=True))
    first, second = (image_figures(problem, outcome, masks) for outcome in (whole, part))
    assert first["psnr_mean_db"] == second["psnr_mean_db"] > 50
    assert first["coverage_percent"] == 100.0
    assert 40 < second["coverage_percent"] < 60


def test_the_best_exposure_is_given_to_those_alone_that_do_not_know_the_light():
    brightness = np.random.default_rng(2).uniform(0.1, 0.3, (12, 12)).astype(np.float32)
    image, mask = Image("a", brightness, np.ones((12, 12), bool)), np.ones((12, 12), bool)
    rendered = [3.0 + 2.0 * brightness.astype(float)]
    for knows, most in ((False, 1e-6), (True, np.inf)):
        outcome = Outcome(name="x", rendered=rendered, covered=[mask], knows_light=knows)
        off = np.abs(exposed(outcome, 0, image, mask) - brightness).max()
        assert off < most
    assert off > 3.0


def test_a_cost_is_that_of_the_method_alone():
    def method():
        values = np.ones(30_000_000)  # 0.22 GiB
        return Outcome(name="x", rendered=[values[:1]], covered=[], knows_light=True)

    found = costed(method)
    assert found.cpu_s >= 0
    assert found.peak_memory_gb is None or found.peak_memory_gb > 0.2
    resumed = costed(lambda: replace(method(), resumed=True))
    assert np.isnan(resumed.cpu_s)
    assert resumed.peak_memory_gb is None


def test_the_cost_of_a_run_is_that_of_its_stages_and_unknown_where_one_was_not_made():
    def stage(name, resumed, cpu_s):
        return {"stage": name, "resumed": resumed, "cpu_s": cpu_s, "peak_memory_gb": 0.1 * cpu_s}

    made = [stage("sparse", False, 2.0), stage("dense", False, 3.0), stage("dense", True, 0.5)]
    assert run_cost([*made, stage("report", False, 9.0)]) == {"cpu_s": 5.5, "peak_memory_gb": pytest.approx(0.3)}
    assert run_cost([*made, stage("relighting_1", True, 0.1)]) == {}
    assert run_cost([]) == {}


def test_options_of_a_run_come_back_as_they_were(tmp_path):
    options = RunOptions(reflectance="mcewen", hold_out=("a.fits",), relight=RelightOptions(iterations=1, direct=False))
    write_options(tmp_path / "config.toml", {"site": "site.toml", **asdict(options)})
    assert options_from(RunOptions, read_config(tmp_path)) == options


def test_a_view_that_the_run_has_used_cannot_be_predicted(mapped, tmp_path):
    run = mapped.copy(tmp_path / "run")
    name = mapped.result.scene.views.name[1]
    with pytest.raises(
        pcm.InputError, match=f"{name}: the run was made from it.*; the run held out none: run the site again"
    ):
        read_problem(run, None, [name])
    with pytest.raises(pcm.InputError, match=r"nothing\.fits: there is no such view"):
        read_problem(run, None, ["nothing.fits"])


def test_a_run_of_geometry_alone_has_nothing_to_compare(mapped, tmp_path):
    run = mapped.copy(tmp_path / "run")
    pcm.write_scene(run / "scene.h5", replace(mapped.result.scene, reflectance=None))
    with pytest.raises(pcm.InputError, match="run again with a reflectance model"):
        pcm.compare_rivals(run)


@pytest.mark.parametrize("methods", [("spk",), ()])
def test_a_method_that_there_is_not_is_refused(mapped, methods):
    with pytest.raises(pcm.InputError, match="known: spc, mvs, splat"):
        pcm.compare_rivals(mapped.run, methods=methods)


def test_the_command_compares_spc_and_geometry_alone_with_the_run(mapped, tmp_path, capsys):
    """One view is given to no rival but to the run, as if it had been held out, to see that it is predicted."""
    run = mapped.copy(tmp_path / "run")
    scene = mapped.result.scene
    write_held_out(run / "held_out.json", replace(scene.views[[2]], name=(scene.views.name[2],)))
    assert phomo("rivals", run, "--truth", mapped.truth, "--spc.iterations", 2, "--methods", "spc") == 0
    said = capsys.readouterr().out
    assert all(len(line) <= 80 for line in said.splitlines())
    written = json.loads((run / "rivals" / "rivals.json").read_text())["figures"]
    assert list(written) == ["phomo", "spc"]
    for figures in written.values():
        assert figures["psnr_mean_db"] > 30
        assert figures["psnr_held_out_mean_db"] > 30
        assert figures["surface_distance_mean_gsd"] < 0.5
        assert figures["normal_error_mean_deg"] < 6
    assert "| spc |" in (run / "rivals" / "rivals.md").read_text()
    assert (run / "rivals" / "rivals.png").stat().st_size > 10_000
    assert {path.name for path in run.iterdir()} <= PRODUCTS | {MARK, "lock"}


def test_a_rival_that_finds_no_map_or_no_surface_costs_the_others_nothing(mapped, tmp_path, monkeypatch, caplog):
    scene = mapped.result.scene
    scatter = 1e3 * scene.spacing * np.random.default_rng(0).normal(size=scene.landmarks.position.shape)
    far = replace(scene.landmarks, position=scene.landmarks.position + scatter)

    def finds_none(*_):
        raise pcm.ReconstructionError("no view was matched")

    def strays(problem, *_):
        rendered, covered = rendered_map(problem, problem.scene)
        astray = scene.with_estimate(scene.views, far)
        return Outcome(name="splat", rendered=rendered, covered=covered, knows_light=False, scene=astray)

    monkeypatch.setattr("photoclinometry.rivals.compare.run_spc", finds_none)
    monkeypatch.setattr("photoclinometry.rivals.compare.run_splat", strays)
    found = pcm.compare_rivals(mapped.run, methods=("spc", "splat"), truth=mapped.truth, out=tmp_path / "out")
    assert list(found.figures) == ["phomo", "splat"]
    assert found.figures["splat"]["psnr_mean_db"] > 30
    assert "surface_distance_mean_gsd" in found.figures["phomo"]
    assert "surface_distance_mean_gsd" not in found.figures["splat"]
    assert "spc finds no map, and is left out of the table: no view was matched" in caplog.text
    assert "splat: its surface is not compared: the map and the reference surface do not overlap" in caplog.text


@pytest.mark.slow
def test_geometry_alone_has_heights_and_normals_but_no_albedo(mapped, tmp_path):
    found = pcm.compare_rivals(mapped.run, methods=("mvs",), truth=mapped.truth, out=tmp_path / "out")
    own, mvs = found.figures["phomo"], found.figures["mvs"]
    assert "albedo_error_mean_percent" not in mvs
    assert own["normal_error_mean_deg"] < mvs["normal_error_mean_deg"]
    assert own["psnr_mean_db"] > mvs["psnr_mean_db"] > 25


def test_a_site_is_mapped_before_its_rivals_are_made(mapped, tmp_path, capsys):
    site = Path(shutil.copytree(mapped.site.parent, tmp_path / "site"))
    mapped.copy(site / "run")  # as a run that goes on: nothing is left to be done
    assert phomo("rivals", site, "--methods", "spc", "--spc.iterations", 1) == 0
    said = capsys.readouterr()
    assert "dense" in said.err
    assert "spc" in said.out
    assert (site / "run" / "rivals" / "rivals.json").is_file()
