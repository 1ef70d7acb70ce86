"""What a run leaves belongs to one map, also where the run is stopped while it writes."""

import logging
import shutil
from dataclasses import replace
from types import SimpleNamespace

import pytest

from photoclinometry.body import products as body_products
from photoclinometry.io.held_out import read_held_out
from photoclinometry.io.run_files import (
    BODY_FILE,
    CONFIG_FILE,
    HELD_OUT_FILE,
    METRICS_FILE,
    REPORT_FOLDER,
    SCENE_FILE,
    is_body,
    read_config,
    read_metrics,
)
from photoclinometry.model.errors import ReconstructionError
from photoclinometry.pipeline import run as pipeline
from photoclinometry.pipeline.folder.run_folder import RunFolder
from photoclinometry.pipeline.options import RunOptions
from photoclinometry.pipeline.products import RunSummary, write_products


def stopped(*_, **__):
    raise KeyboardInterrupt


@pytest.fixture
def finished(mapped, tmp_path):
    """A finished run folder."""
    return mapped.copy(tmp_path / "run")


@pytest.mark.parametrize(
    ("at", "options"),
    [("io.scene_file.write_scene", {}), ("pipeline.products._findings", {"site": "new"})],
    ids=["the first file", "the report"],
)
def test_a_run_that_is_stopped_at_its_products_leaves_no_figures_of_another_map(
    mapped, finished, monkeypatch, at, options
):
    monkeypatch.setattr(f"photoclinometry.{at}", stopped)
    summary = RunSummary(adjustment=mapped.result.adjustment, config={"site": "new"}, left_out={})
    with pytest.raises(KeyboardInterrupt):
        write_products(RunFolder(finished), summary)
    assert not (finished / REPORT_FOLDER).exists()
    assert read_metrics(finished) == {}
    assert {key: value for key, value in read_config(finished).items() if key != "version"} == options
    assert (finished / SCENE_FILE).is_file()


def test_views_held_out_are_those_of_the_last_map(mapped, finished, monkeypatch):
    monkeypatch.setattr("photoclinometry.pipeline.products._findings", stopped)
    summary = RunSummary(adjustment=mapped.result.adjustment, config={}, left_out={})
    for views in (mapped.result.scene.views[[2]], None):
        with pytest.raises(KeyboardInterrupt):
            write_products(RunFolder(finished), replace(summary, held_out=views))
        found = read_held_out(finished / HELD_OUT_FILE)
        assert (found and found.name) == (views and views.name)


def test_a_body_that_is_stopped_at_its_products_leaves_no_figures_of_another(finished, monkeypatch):
    shutil.move(finished / SCENE_FILE, finished / BODY_FILE)
    monkeypatch.setattr(body_products, "shape_model", stopped)
    with pytest.raises(KeyboardInterrupt):
        body_products.write_body_products(
            RunFolder(finished), SimpleNamespace(unit="m"), SimpleNamespace(surface=None), {}
        )
    assert is_body(finished)
    assert not {REPORT_FOLDER, METRICS_FILE, CONFIG_FILE} & {path.name for path in finished.iterdir()}


def test_a_run_that_fails_leaves_the_earlier_map_with_its_own_options(mapped, finished, monkeypatch, caplog):
    """The options of the run that failed are in the log."""

    def failed(*_):
        raise ReconstructionError("0 of 6 views registered")

    monkeypatch.setattr(pipeline, "read_inputs", failed)
    before = [(finished / name).read_bytes() for name in (CONFIG_FILE, METRICS_FILE, SCENE_FILE)]
    with caplog.at_level(logging.DEBUG), pytest.raises(ReconstructionError):
        pipeline.run(mapped.site, finished, RunOptions(matching_passes=3))
    assert [(finished / name).read_bytes() for name in (CONFIG_FILE, METRICS_FILE, SCENE_FILE)] == before
    assert (finished / REPORT_FOLDER / "index.html").is_file()
    (options,) = (message for message in caplog.messages if message.startswith("options:"))
    assert "matching_passes = 3" in options
