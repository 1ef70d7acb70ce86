"""Names with square brackets are shown as they are: to rich, "[/a]" in a text would be an order."""

from dataclasses import replace
from pathlib import Path

import pytest

from commands import phomo
from fault_place import edit, write_mapped_site
from photoclinometry.io.scene_file import read_scene, write_scene

NAME = "crater [/a]"
VIEW = "images/[a]0.fits"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The working folder, with `mapped`, a site, and its map in `mapped/run`, of such names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    write_mapped_site(Path("mapped"))
    edit("mapped/site.toml", 'name = "place"', f'name = "{NAME}"')()
    edit("mapped/site.toml", "images/000.fits", VIEW)()
    scene = read_scene("mapped/run/scene.h5")
    views = replace(scene.views, name=(VIEW, *scene.views.name[1:]))
    write_scene("mapped/run/scene.h5", replace(scene, name=NAME, views=views))


def test_info_of_a_site_shows_names_as_they_are(here, capsys):
    assert phomo("info", "mapped/site.toml") == 0
    said = capsys.readouterr().out
    assert f"{NAME}: 4 views" in said
    assert VIEW in said


def test_info_of_a_run_shows_names_as_they_are(here, capsys):
    assert phomo("info", "mapped/run") == 0
    said = capsys.readouterr().out
    assert f"{NAME}: " in said
    assert VIEW in said
    assert "[dB]" in said or "dB" in said


def test_an_evaluation_shows_names_as_they_are(here, capsys):
    assert phomo("evaluate", "mapped/run", "--no-images", "--out", "out[a]") == 0
    said = capsys.readouterr()
    assert NAME in said.out
    assert "written: out[a]/evaluation.json" in said.err
