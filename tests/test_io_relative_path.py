"""Relative paths lead to the file from the folder, links or none."""

import os
from pathlib import Path

import pytest

from photoclinometry.io.relative_path import relative_path


@pytest.fixture
def place(tmp_path):
    """`real/deep/er` with the link `short` to it, `data` with an image in it, and `images`, a link to `data`."""
    (tmp_path / "real" / "deep" / "er").mkdir(parents=True)
    (tmp_path / "short").symlink_to(tmp_path / "real" / "deep" / "er")
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "1.fits").write_text("one")
    (tmp_path / "images").symlink_to("data")
    return tmp_path


@pytest.mark.parametrize(
    ("file", "folder", "expected"),
    [
        ("data/1.fits", ".", "data/1.fits"),
        ("data/1.fits", "real", "../data/1.fits"),
        ("images/1.fits", ".", "images/1.fits"),  # a name stays where it leads there
        ("data/1.fits", "short", "../../../data/1.fits"),
        ("data/1.fits", "short/new", "../../../../data/1.fits"),
        ("real/deep/er/../../../data/1.fits", "short", "../../../data/1.fits"),
    ],
)
def test_a_path_leads_from_the_folder_to_the_file(place, file, folder, expected):
    found = relative_path(place / file, place / folder)
    assert found == expected
    (place / folder).mkdir(exist_ok=True)
    assert (place / folder / found).read_text() == "one"


def test_a_path_may_be_relative_to_the_working_folder(place, monkeypatch):
    monkeypatch.chdir(place)
    assert relative_path(Path("data/1.fits"), Path("short")) == "../../../data/1.fits"


def test_without_a_relative_path_it_is_the_whole_one(place, monkeypatch):
    def on_another_drive(*_):
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(os.path, "relpath", on_another_drive)
    assert relative_path(place / "images" / "1.fits", place) == (place / "data" / "1.fits").as_posix()
