"""The folder of an evaluation holds one evaluation: nothing of an earlier one stays beside it."""

import json

import numpy as np
import pytest

from photoclinometry.evaluate.compare import Comparison
from photoclinometry.evaluate.evaluation import Evaluation
from photoclinometry.io.similarity import read_similarity
from photoclinometry.model.geometry import Similarity
from photoclinometry.output.evaluation import write_evaluation
from scenes import synthetic_scene


@pytest.fixture
def compared():
    alignment = Similarity(2.0, np.eye(3), np.array([1.0, 2.0, 3.0]))
    found = Comparison(metrics={}, aligned=synthetic_scene(size=8, views=3), errors={}, similarity=alignment)
    return Evaluation(name="place", metrics={"views": 3.0}, comparison=found)


def test_the_alignment_and_the_maps_of_an_earlier_evaluation_are_removed(compared, tmp_path):
    """With the alignment of an earlier run, an export would put the map in a wrong place."""
    write_evaluation(tmp_path, compared)
    assert read_similarity(tmp_path / "reference_from_scene.toml").scale == 2.0
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "difference_surface_distance_m.png").touch()
    write_evaluation(tmp_path, Evaluation(name="place", metrics={"views": 4.0}))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["evaluation.json", "evaluation.md"]
    assert json.loads((tmp_path / "evaluation.json").read_text()) == {"views": 4.0}


def test_files_that_no_evaluation_wrote_stay(compared, tmp_path):
    for name in ("reference_from_scene.toml", "maps/difference_mine.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("mine")
    write_evaluation(tmp_path, Evaluation(name="place", metrics={"views": 3.0}))
    assert (tmp_path / "reference_from_scene.toml").read_text() == "mine"
    assert (tmp_path / "maps" / "difference_mine.png").is_file()
    (tmp_path / "maps" / "sketch.png").touch()
    write_evaluation(tmp_path, compared)
    assert [path.name for path in (tmp_path / "maps").iterdir()] == ["sketch.png"]
