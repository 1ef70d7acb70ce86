"""Run folders: what they accept, what they refuse, and that stages come back as they were."""

import errno
import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from photoclinometry import __version__
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.geometry import Rigid, so3_exp
from photoclinometry.model.region import Region
from photoclinometry.pipeline.folder import records
from photoclinometry.pipeline.folder.records import write_record
from photoclinometry.pipeline.folder.run_folder import FORMAT, MARK, open_run
from photoclinometry.pipeline.folder.stage import Keyed, Stage, Tools, digest, program_digest
from photoclinometry.pipeline.run import RunOptions
from photoclinometry.sfm import SfmOptions


@dataclass(frozen=True)
class Part:
    """What may be in a result, several times."""

    cost: dict[str, float]
    accepted: bool


@dataclass(frozen=True)
class Result:
    """What a stage may leave: arrays, poses, numbers, text, and parts."""

    points: np.ndarray
    poses: Rigid
    error_px: float
    count: int
    name: str
    region: Region
    parts: tuple[Part, ...]
    maybe: np.ndarray | None
    other: Part | None
    by_name: dict[str, np.ndarray]


def result(seed: int = 0) -> Result:
    rng = np.random.default_rng(seed)
    poses = Rigid(so3_exp(rng.normal(size=(4, 3))), rng.normal(size=(4, 3)))
    part = Part({"sun": np.inf, "photometric": 0.1 + 0.2}, True)
    region = Region(row=1, col=np.int64(2), height=3, width=4, stride=5)
    arrays = {"albedo": rng.normal(size=3)}
    return Result(
        rng.normal(size=(7, 3)), poses, 0.1 + 0.2, 7, "Vesta", region, (part, part), rng.normal(size=2), None, arrays
    )


@dataclass(frozen=True, kw_only=True)
class Sparse(Stage[Result]):
    """A stage that is only given a number."""

    name = "sparse"
    result = Result
    seed: int = 0

    def make(self, tools: Tools) -> Result:
        return result(self.seed)


class Never(Sparse):
    """The same, but not to be made."""

    def make(self, tools: Tools) -> Result:
        raise AssertionError("the stage was made again")

    @property
    def key(self) -> str:
        return Sparse(seed=self.seed).key


class Elsewhere(Sparse):
    """A stage whose result is not there."""

    name = "elsewhere"


class Damaged(Sparse):
    """A stage whose file is damaged."""

    name = "dense"


def assert_equal(a: Result, b: Result) -> None:
    assert (a.region, a.parts, a.other) == (b.region, b.parts, b.other)
    np.testing.assert_array_equal(a.maybe, b.maybe)
    np.testing.assert_array_equal(a.by_name["albedo"], b.by_name["albedo"])
    np.testing.assert_array_equal(a.points, b.points)
    np.testing.assert_array_equal(a.poses.rotation, b.poses.rotation)
    np.testing.assert_array_equal(a.poses.translation, b.poses.translation)
    assert (a.error_px, a.count, a.name) == (b.error_px, b.count, b.name)
    assert (type(b.error_px), type(b.count), type(b.name)) == (float, int, str)


@pytest.fixture
def folder(tmp_path):
    return open_run(tmp_path / "run")


def test_a_stage_comes_back_as_it_was_made(folder):
    made = folder.result_of(Sparse()).value
    again = open_run(folder.path)
    assert_equal(made, result())
    assert_equal(made, again.result_of(Never()).value)
    assert [cost.resumed for cost in folder.costs + again.costs] == [False, True]


def test_a_folder_tells_what_it_holds_without_reading_it(folder, monkeypatch):
    """A body asks for all its tiles, of gigabytes."""
    folder.result_of(Sparse())
    (folder.path / "stages" / "dense.npz").write_bytes(b"PK")
    monkeypatch.setattr(records, "_decoded", lambda *_: pytest.fail("the content was read"))
    assert folder.holds(Sparse())
    assert not folder.holds(Sparse(seed=1))
    assert not folder.holds(Elsewhere())
    assert not folder.holds(Damaged())


def test_another_key_makes_the_stage_again(folder):
    folder.result_of(Sparse())
    assert_equal(result(1), folder.result_of(Sparse(seed=1)).value)
    assert_equal(result(1), folder.result_of(Never(seed=1)).value)


def test_a_changed_program_makes_the_stage_again(folder, monkeypatch):
    folder.result_of(Sparse())
    monkeypatch.setattr("photoclinometry.pipeline.folder.stage.program_digest", lambda: "another")
    with pytest.raises(AssertionError, match="made again"):
        folder.result_of(Never())


def test_the_program_is_its_sources_and_without_these_its_version(tmp_path, monkeypatch):
    """A changed line and a renamed file are another program, other files are not."""
    import photoclinometry

    compute = program_digest.__wrapped__
    monkeypatch.setattr(photoclinometry, "__file__", str(tmp_path / "__init__.pyc"))
    assert compute() == __version__
    (tmp_path / "a.py").write_text("x = 1")
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper" / "b.py").write_text("y = 1")
    found = [compute()]
    (tmp_path / "notes.txt").write_text("z")
    assert compute() == found[0]
    (tmp_path / "deeper" / "b.py").write_text("y = 2")
    found.append(compute())
    (tmp_path / "deeper" / "b.py").rename(tmp_path / "deeper" / "c.py")
    found.append(compute())
    assert len(set(found)) == 3


def test_a_stage_that_fails_leaves_nothing(folder):
    with pytest.raises(AssertionError):
        folder.result_of(Never())
    assert not folder.costs
    assert not list((folder.path / "stages").glob("*"))


def test_damage_anywhere_in_a_stage_file_is_warned_of_and_made_good(folder, caplog):
    """Cut short or with a byte changed: never a crash, never other values than were written."""
    folder.result_of(Sparse())
    file = folder.path / "stages" / "sparse.npz"
    content = file.read_bytes()
    rng = np.random.default_rng(0)
    damaged = [content[:size] for size in rng.integers(0, len(content), 20)]
    for at in rng.integers(0, len(content), 100):
        damaged.append(content[:at] + bytes([content[at] ^ 0xFF]) + content[at + 1 :])
    for data in damaged:
        file.write_bytes(data)
        assert_equal(result(), folder.result_of(Sparse()).value)
    warnings = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert len(warnings) >= 60
    assert all(w.startswith(f"{file}: damaged") for w in warnings)


def test_a_file_that_does_not_fit_into_memory_is_not_damaged(folder, monkeypatch, caplog):
    """Nor one that may not be read: made again, neither could be read back."""
    folder.result_of(Sparse())

    def fails(*_, **__):
        raise MemoryError("Unable to allocate 32.0 GiB")

    with monkeypatch.context() as patch:
        patch.setattr(np, "load", fails)
        with pytest.raises(MemoryError):
            folder.result_of(Never())

    def refuses(*_):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(records, "open", refuses, raising=False)
    with pytest.raises(RunFolderError, match="cannot be read: Permission denied; change the permissions"):
        folder.result_of(Never())
    assert not [record for record in caplog.records if record.levelno == logging.WARNING]


def test_stages_are_timed(folder):
    with folder.timed("images"):
        sum(range(200_000))
    (stage,) = folder.costs
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


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", "7", "\x00", "[" * 100_000])
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
        ("sparse", replace(options, matching_passes=3)),
        ("sparse", replace(options, sfm=SfmOptions(seed=1))),
        ("sparse", replace(options, reflectance="akimov")),
        ("sparse", options, 1.0),
        ("sparse", options, None),
    ]
    digests = [digest(*p) for p in parts]
    assert len(set(digests)) == len(parts)
    assert digests == [digest(*p) for p in parts]
    assert digests[0] == digest("sparse", RunOptions())


def test_digests_tell_arrays_to_the_last_bit_and_results_by_their_keys():
    array = np.array([0.1, 0.2])
    parts = [
        array,
        array.astype(np.float32),
        array[None],
        np.nextafter(array, 1.0),
        {"a": array},
        {"b": array},
        Keyed(array, "key"),
        Keyed(array, "other"),
        Path("key"),
        (Part({}, True), "x"),
        (Part({}, False), "x"),
    ]
    assert len({digest(part) for part in parts}) == len(parts)
    assert digest(Keyed(1, "key")) == digest(Keyed(2, "key"))
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    assert digest(np.float64(0.3)) == digest(0.3)


def test_what_has_no_value_that_tells_it_is_not_digested():
    with pytest.raises(TypeError, match="has no digest; give it as Keyed"):
        digest(object())


def test_what_cannot_be_read_back_is_not_written(tmp_path):
    with pytest.raises(TypeError, match="value: object cannot be kept"):
        write_record(tmp_path / "x.npz", "key", object())
    assert not list(tmp_path.iterdir())
