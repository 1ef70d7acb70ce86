"""Run folders: what they accept, what they refuse, and that stages come back as they were."""

import json
import logging
from dataclasses import dataclass, replace

import numpy as np
import pytest

from photoclinometry import __version__
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.geometry import Rigid, so3_exp
from photoclinometry.pipeline.run import RunOptions
from photoclinometry.pipeline.run_folder import FORMAT, MARK, digest, open_run
from photoclinometry.sfm import SfmOptions


@dataclass(frozen=True)
class Result:
    """What a stage may leave: arrays, poses, numbers and text."""

    points: np.ndarray
    poses: Rigid
    error_px: float
    count: int
    name: str


def result(seed: int = 0) -> Result:
    rng = np.random.default_rng(seed)
    poses = Rigid(so3_exp(rng.normal(size=(4, 3))), rng.normal(size=(4, 3)))
    return Result(rng.normal(size=(7, 3)), poses, 0.1 + 0.2, 7, "Vesta")


def never():
    raise AssertionError("the stage was made again")


def assert_equal(a: Result, b: Result) -> None:
    np.testing.assert_array_equal(a.points, b.points)
    np.testing.assert_array_equal(a.poses.rotation, b.poses.rotation)
    np.testing.assert_array_equal(a.poses.translation, b.poses.translation)
    assert (a.error_px, a.count, a.name) == (b.error_px, b.count, b.name)
    assert (type(b.error_px), type(b.count), type(b.name)) == (float, int, str)


@pytest.fixture
def folder(tmp_path):
    return open_run(tmp_path / "run")


def test_a_stage_comes_back_as_it_was_made(folder):
    made = folder.stage("sparse", "key", result, Result)
    again = open_run(folder.path)
    assert_equal(made, again.stage("sparse", "key", never, Result))
    assert [s.resumed for s in folder.stages + again.stages] == [False, True]


def test_another_key_makes_the_stage_again(folder):
    folder.stage("sparse", "key", result, Result)
    assert_equal(result(1), folder.stage("sparse", "other", lambda: result(1), Result))
    assert_equal(result(1), folder.stage("sparse", "other", never, Result))


def test_a_forgotten_stage_is_made_again(folder):
    folder.stage("sparse", "key", result, Result)
    folder.forget("sparse")
    folder.forget("sparse")
    assert_equal(result(1), folder.stage("sparse", "key", lambda: result(1), Result))


def test_a_stage_that_fails_leaves_nothing(folder):
    with pytest.raises(AssertionError):
        folder.stage("sparse", "key", never, Result)
    assert not folder.stages
    assert not list((folder.path / "stages").glob("*"))


def test_damage_anywhere_in_a_stage_file_is_warned_of_and_made_good(folder, caplog):
    """Cut short or with a byte changed: never a crash, never other values than were written."""
    folder.stage("sparse", "key", result, Result)
    file = folder.path / "stages" / "sparse.npz"
    content = file.read_bytes()
    rng = np.random.default_rng(0)
    damaged = [content[:size] for size in rng.integers(0, len(content), 20)]
    for at in rng.integers(0, len(content), 100):
        damaged.append(content[:at] + bytes([content[at] ^ 0xFF]) + content[at + 1 :])
    for data in damaged:
        file.write_bytes(data)
        assert_equal(result(), folder.stage("sparse", "key", result, Result))
    warnings = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert len(warnings) >= 60
    assert all(w.startswith(f"{file}: damaged") for w in warnings)


def test_stages_are_timed(folder):
    with folder.timed("images"):
        sum(range(200_000))
    (stage,) = folder.stages
    assert stage.stage == "images"
    assert 0 < stage.cpu_s < 5
    assert 0 < stage.wall_s < 60
    assert 0.01 < stage.peak_memory_gb < 100


def test_an_empty_folder_becomes_a_run_folder(tmp_path):
    open_run(tmp_path)
    assert json.loads((tmp_path / MARK).read_text()) == {"format": FORMAT, "version": __version__}


def test_a_folder_of_other_things_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(RunFolderError, match=r"is not a run folder; choose another --out"):
        open_run(tmp_path)
    with pytest.raises(RunFolderError, match=r"thesis\.tex: exists and is not a run folder"):
        open_run(tmp_path / "thesis.tex")
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_run_of_another_format_is_refused(tmp_path):
    (tmp_path / MARK).write_text(json.dumps({"format": FORMAT + 1, "version": "9.9"}))
    with pytest.raises(RunFolderError, match=rf"format {FORMAT + 1}, made by version 9\.9; .* writes format {FORMAT}"):
        open_run(tmp_path)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", "7", "\x00"])
def test_a_damaged_mark_is_refused(tmp_path, text):
    (tmp_path / MARK).write_text(text)
    with pytest.raises(RunFolderError, match=rf"{MARK}: damaged .*choose another --out, or remove the folder"):
        open_run(tmp_path)


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(RunFolderError, match=r"cannot be written: Not a directory; part of the path is a file"):
        open_run(tmp_path / "file" / "run")


def test_digests_differ_where_any_part_differs_and_only_there():
    options = RunOptions()
    parts = [
        ("sparse", options),
        ("dense", options),
        ("sparse", replace(options, match_rounds=3)),
        ("sparse", replace(options, sfm=SfmOptions(seed=1))),
        ("sparse", replace(options, reflectance="akimov")),
        ("sparse", options, 1.0),
        ("sparse", options, None),
    ]
    digests = [digest(*p) for p in parts]
    assert len(set(digests)) == len(parts)
    assert digests == [digest(*p) for p in parts]
    assert digests[0] == digest("sparse", RunOptions())
