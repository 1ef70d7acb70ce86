"""The command `phomo`: exit codes, what it says and where, and the files it leaves."""

import json
import logging
import subprocess
import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from commands import phomo
from photoclinometry.io.images import read_image
from photoclinometry.model.errors import ImageError, ReconstructionError
from photoclinometry.pipeline import run as pipeline
from runs import draw_no_figures
from sites import write_small_site


@pytest.fixture
def site(tmp_path):
    return write_small_site(tmp_path / "site")


@pytest.fixture
def fails(monkeypatch):
    """Makes the pipeline raise."""

    def set_error(error):
        def stand_in(*_):
            raise error

        monkeypatch.setattr(pipeline, "run", stand_in)

    return set_error


def test_a_reader_that_has_gone_is_not_complained_about():
    """As in `phomo fetch --help | head -0`."""
    command = [sys.executable, "-c", "from photoclinometry.cli import main; main(['fetch', '--help'])"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    complaints = process.stderr.read()
    process.stderr.close()
    assert process.wait() == 141
    assert complaints == b""


def test_help_of_run_explains_options(capsys):
    phomo("run", "--help-all")
    help_text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for said in ("--reflectance", "--densify.min-views", "--adjust.smooth-sigma-rad", "Folder for the run", "Lowe's"):
        assert said in help_text


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ImageError("images/2.fits: is dark; remove this view"), 2),
        (ReconstructionError("2 of 9 views registered; add views"), 1),
    ],
)
def test_an_error_is_one_line_and_an_exit_code(site, tmp_path, capsys, fails, error, code):
    fails(error)
    assert phomo("run", site, "--out", tmp_path / "run") == code
    said = capsys.readouterr()
    assert said.err.strip().splitlines()[-1] == f"phomo: {error}"
    assert "Traceback" not in said.err + said.out
    assert str(error) in (tmp_path / "run" / "log").read_text()


def test_an_interrupted_run_says_that_it_can_go_on(site, tmp_path, capsys, fails):
    fails(KeyboardInterrupt())
    assert phomo("run", site, "--out", tmp_path / "run") == 130
    assert "goes on from what is finished" in capsys.readouterr().err
    assert "stopped: KeyboardInterrupt" in (tmp_path / "run" / "log").read_text()


def test_our_own_mistakes_keep_their_traceback(site, tmp_path, fails):
    fails(ZeroDivisionError("a bug"))
    with pytest.raises(ZeroDivisionError):
        phomo("run", site, "--out", tmp_path / "run")


def test_simulate_writes_a_site_once_with_the_options_given(tmp_path, capsys):
    chosen = ("--lighting", "strong", "--seed", 2, "--detector.no-noise", "--detector.psf-sigma-px", 0.8)
    arguments = ("simulate", "--out", tmp_path / "s", "--views", 3, "--image-size", 48, *chosen)
    assert phomo(*arguments) == 0
    printed = capsys.readouterr().err
    assert str(tmp_path / "s" / "site.toml") in printed
    assert "truth.h5" in printed
    options = tomllib.loads((tmp_path / "s" / "simulation.toml").read_text())
    assert (options["lighting"], options["seed"]) == ("strong", 2)
    assert (options["detector"]["noise"], options["detector"]["psf_sigma_px"]) == (False, 0.8)
    assert phomo("info", tmp_path / "s") == 0
    assert "3 views" in capsys.readouterr().out
    assert phomo(*arguments) == 2
    assert "--overwrite" in capsys.readouterr().err


def test_run_logs_reports_and_prints_where(mapped, tmp_path, capsys, monkeypatch):
    """A finished run once more: all is read back, stages go to log and terminal, the page's path to stdout."""
    draw_no_figures(monkeypatch)
    folder = mapped.copy(tmp_path / "run")
    level = logging.getLogger("photoclinometry").level
    assert phomo("run", mapped.site, "--out", folder) == 0
    said = capsys.readouterr()
    assert said.out.strip() == str(folder / "report" / "index.html")
    assert "last estimate   as in the earlier run" in said.err
    assert "reweighting" not in said.err
    assert f"{len(mapped.result.scene.landmarks)} landmarks in 6 views, mean PSNR" in said.err
    log = (folder / "log").read_text()
    assert "INFO photoclinometry.pipeline.folder.run_folder: dense: read back from the earlier run" in log
    assert logging.getLogger("photoclinometry").level == level
    assert not logging.getLogger("photoclinometry").handlers


def test_run_says_what_went_less_than_well(mapped, tmp_path, capsys, monkeypatch):
    adjustment = replace(mapped.result.adjustment, converged=False, message="stopped after 60 iterations")
    result = replace(mapped.result, adjustment=adjustment, left_out={"images/004.fits": "not registered"})
    monkeypatch.setattr(pipeline, "run", lambda *_: result)
    assert phomo("run", mapped.site, "--out", tmp_path / "run") == 0
    message = capsys.readouterr().err
    assert "left out: images/004.fits: not registered" in message
    assert "the joint estimate has not converged: stopped after 60 iterations" in message


def test_info_describes_a_site_and_a_finished_run(mapped, capsys):
    assert phomo("info", mapped.site) == 0
    assert "6 views, brightness iof, body vesta" in capsys.readouterr().out
    assert phomo("info", mapped.run) == 0
    said = capsys.readouterr().out
    assert "lunar-lambert, brightness iof" in said
    assert "images/005.fits" in said
    assert "PSNR" in said


@pytest.mark.parametrize("what", ["site", "run"])
def test_tables_of_info_fit_80_columns_and_cut_nothing(mapped, capsys, monkeypatch, what):
    monkeypatch.setenv("COLUMNS", "80")
    assert phomo("info", getattr(mapped, what)) == 0
    said = capsys.readouterr().out
    assert max(len(line) for line in said.splitlines()) <= 80
    assert "\u2026" not in said
    assert all(f"images/{k:03d}.fits" in said for k in range(6))


@pytest.mark.parametrize("suffix", ["fits", "png"])
def test_render_draws_what_the_camera_saw(mapped, tmp_path, suffix):
    """Linear in the image: the correlation of a rendering with its image is nearly one."""
    out = tmp_path / f"view.{suffix}"
    assert phomo("render", mapped.run, "--out", out, "--view", "003") == 0
    drawn = read_image(out)
    seen = read_image(mapped.site.parent / "images" / "003.fits").brightness
    assert drawn.brightness.shape == seen.shape
    there = drawn.valid & (drawn.brightness > 0)
    assert there.sum() > 500
    assert np.corrcoef(drawn.brightness[there], seen[there])[0, 1] > 0.95


def test_evaluate_measures_a_run_against_the_truth(mapped, tmp_path, capsys):
    arguments = ("--truth", mapped.truth, "--no-images", "--out", tmp_path)
    assert phomo("evaluate", mapped.run, *arguments) == 0
    metrics = json.loads((tmp_path / "evaluation.json").read_text())
    assert metrics["surface_distance_mean_gsd"] < 0.2
    assert "evaluation.json" in capsys.readouterr().err
