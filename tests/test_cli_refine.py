"""`phomo refine`: what it says, where, and that mistakes leave nothing behind."""

import pytest

from commands import phomo
from photoclinometry.io.models.text_model import read_text_model, write_text_model
from runs import draw_no_figures
from scenes import synthetic_scene


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("text") / "model"
    write_text_model(folder, synthetic_scene(size=12, views=4, keypoint_noise_px=0.05, brightness_noise=1e-3))
    return folder


def test_refine_writes_a_run_folder_that_the_other_commands_read(model, tmp_path, capsys, monkeypatch):
    draw_no_figures(monkeypatch)
    out = tmp_path / "out"
    options = ("--reflectance", "lunar-lambert", "--body", "vesta", "--min-observations", 4)
    assert phomo("refine", model, "--out", out, *options, "--adjust.solver.max-steps", 3) == 0
    said = capsys.readouterr()
    assert said.out.strip() == str(out / "report" / "index.html")
    assert "144 landmarks in 4 views" in said.err
    assert "adjust" in (out / "log").read_text()
    assert len(read_text_model(out / "model").scene.landmarks) == 144
    assert phomo("info", out) == 0
    assert "144 landmarks, 4 views" in capsys.readouterr().out
    assert phomo("evaluate", out, "--no-images") == 0
    assert "keypoint residual" in capsys.readouterr().out
    assert phomo("evaluate", out) == 2
    assert "give the site.toml of the run's images (--site, site=), or leave the images out" in capsys.readouterr().err
