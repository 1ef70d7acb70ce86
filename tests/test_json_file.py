"""JSON for users is valid JSON: numbers that are not finite are null, wherever they stand."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from eggs import egg_model
from photoclinometry.io.json_file import read_json, write_json
from photoclinometry.output.export.options import ExportOptions
from photoclinometry.output.export.shape.export import export_shape
from photoclinometry.output.export.shape.options import ShapeOptions
from photoclinometry.pipeline.folder.run_folder import open_run
from photoclinometry.pipeline.products import RunSummary, write_products

SOURCE = Path(__file__).parents[1] / "src" / "photoclinometry"


def read_strictly(path):
    """The content of a JSON file, as readers that know neither Infinity nor NaN read it."""

    def refused(word):
        raise ValueError(f"{path}: {word} is not JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refused)


def test_numbers_that_are_not_finite_are_null_at_any_depth(tmp_path):
    rows = ({"x": float("nan"), "y": 1.5}, {"x": np.float64(-np.inf)})
    write_json(tmp_path / "a.json", {"top": float("inf"), "rows": rows, "deep": {"list": [np.float32(np.inf), 2]}})
    expected = {"top": None, "rows": [{"x": None, "y": 1.5}, {"x": None}], "deep": {"list": [None, 2]}}
    assert read_strictly(tmp_path / "a.json") == read_json(tmp_path / "a.json") == expected


def test_numbers_of_numpy_are_numbers_and_paths_are_text(tmp_path):
    numbers = [np.float32(0.5), np.int64(3), np.bool_(True), 0.1]
    write_json(tmp_path / "a.json", {"numbers": numbers, "path": Path("a", "b")})
    content = read_strictly(tmp_path / "a.json")
    assert content == {"numbers": [0.5, 3, True, 0.1], "path": str(Path("a", "b"))}
    assert content["numbers"][2] is True


def test_the_figures_of_a_view_whose_scale_is_not_measured_are_valid_json(mapped, tmp_path, no_figures):
    """Of a view without a lit observation, whose scale has an infinite variance."""
    adjustment = mapped.result.adjustment
    variance = np.ones(len(adjustment.scene.views))
    variance[2] = np.inf
    scene = replace(adjustment.scene, uncertainty={**adjustment.scene.uncertainty, "scale": variance})
    summary = RunSummary(adjustment=replace(adjustment, scene=scene), config={}, left_out={})
    write_products(open_run(tmp_path / "run"), summary)
    rows = read_strictly(tmp_path / "run" / "metrics.json")["views"]
    assert [row["scale_sigma_percent"] is None for row in rows] == [k == 2 for k in range(6)]


def test_an_infinite_option_is_recorded_as_it_is_typed(tmp_path):
    """Null would say that the option was left out."""
    options, shape_options = ExportOptions(products=("properties",)), ShapeOptions(correlation_m=float("inf"))
    export_shape(egg_model(), tmp_path / "out", options, shape_options)
    assert read_strictly(tmp_path / "out" / "export.json")["options"]["correlation_m"] == "inf"
    assert read_strictly(tmp_path / "out" / "properties.json")["sigma"]["correlation_length_m"] == "infinite"


def test_json_for_users_is_written_in_one_place():
    """But for the mark of a run folder, which only the program reads, and glTF, where JSON is part of a binary file."""
    writes = re.compile(r"write_(text|bytes)\(.*json\.dumps")
    users = {file for file in SOURCE.rglob("*.py") if writes.search(file.read_text(encoding="utf-8"))}
    assert users == {SOURCE / name for name in ("io/json_file.py", "io/meshes/gltf.py", "pipeline/folder/run_mark.py")}
