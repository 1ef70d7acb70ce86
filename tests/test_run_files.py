"""What lies in a run folder is named in one place, and says whether it is a map or a whole body."""

import re
from pathlib import Path

import pytest

from photoclinometry.io.run_files import BODY_FILE, PRODUCTS, SCENE_FILE, is_body, is_map
from photoclinometry.output.export.shape.export import is_shape, shape_file

SOURCE = Path(__file__).parents[1] / "src" / "photoclinometry"


@pytest.mark.parametrize(
    ("files", "of_map", "of_body"),
    [
        ((), False, False),
        ((SCENE_FILE,), True, False),
        ((BODY_FILE,), False, True),
        ((SCENE_FILE, BODY_FILE), True, False),
    ],
    ids=["neither", "map", "body", "both"],
)
def test_a_folder_is_that_of_a_map_or_of_a_body_and_never_of_both(tmp_path, files, of_map, of_body):
    """All commands take it for the same: `phomo info`, `view`, `evaluate` and `export`."""
    for name in files:
        (tmp_path / name).touch()
    assert (is_map(tmp_path), is_body(tmp_path), is_shape(tmp_path)) == (of_map, of_body, of_body)


def test_a_mesh_is_a_shape_by_itself(tmp_path):
    for name in ("ball.PLY", BODY_FILE, SCENE_FILE):
        (tmp_path / name).touch()
    assert is_shape(tmp_path / "ball.PLY")
    assert not is_shape(tmp_path / SCENE_FILE)
    assert shape_file(tmp_path / "ball.PLY") == tmp_path / "ball.PLY"
    assert shape_file(tmp_path) == tmp_path / BODY_FILE


def test_no_other_module_spells_the_name_of_a_file_in_a_run_folder():
    """landmarks.ply and altimetry.csv are also files of exports and of simulated sites."""
    names = {name for name in PRODUCTS if "." in name} - {"landmarks.ply", "altimetry.csv"}
    assert names == {"scene.h5", "body.ply", "metrics.json", "config.toml", "held_out.json"}
    spelt = re.compile("[\"'](?:" + "|".join(map(re.escape, sorted(names))) + ")[\"']")
    users = [file for file in SOURCE.rglob("*.py") if spelt.search(file.read_text(encoding="utf-8"))]
    assert users == [SOURCE / "io" / "run_files.py"]
