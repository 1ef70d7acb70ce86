"""Every fault of the table ends its command as the table says: exit code, one line, and what is on disk."""

import logging
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from commands import phomo
from fault_place import build_place, contents, frames, small_disk
from faults import BOX, EVALUATE, EXPORT, FAULTS, INGEST, LINE, RENDER, RUN, SUNS, VIEWS, Fault
from faults_at import end_of
from faults_before import ABSENT, NO_WORDS, WORDS, read_answers
from photoclinometry.photometry.albedo import with_model
from photoclinometry.pipeline import run as pipeline
from scenes import synthetic_scene

TRIED = [fault for fault in FAULTS if not fault.test]


def name_of(fault: Fault) -> str:
    return f"{fault.kind}: {fault.name}"


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("good")
    build_place(folder)
    return folder


@pytest.fixture
def here(good, tmp_path, monkeypatch):
    """A copy of the good examples as the working folder, and a terminal of 80 columns."""
    folder = tmp_path / "here"
    shutil.copytree(good, folder)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "80")
    return folder


def message(said: str, form: str) -> str:
    """The command's last words, without "phomo: ", in one line."""
    assert "Traceback" not in said
    lines = said.splitlines()
    if form == BOX:
        return " ".join("".join(" " if c in "│─╭╮╰╯" else c for c in said).split())
    (first,) = (k for k, line in enumerate(lines) if line.startswith("phomo: "))
    if form == LINE:
        assert first == len(lines) - 1, said
    return " ".join(" ".join(lines[first:]).removeprefix("phomo: ").split())


@pytest.mark.parametrize("fault", TRIED, ids=name_of)
def test_a_fault_ends_its_command_as_the_table_says(fault, here, capsys):
    if fault.make is not None:
        fault.make()
    before = contents(here)
    with small_disk(fault.disk):
        assert phomo(*shlex.split(fault.command)) == fault.code
    said = message(capsys.readouterr().err, fault.form)
    assert fault.is_said_by(said), said
    after = contents(here)
    changed = sorted(path for path in before | after if before.get(path) != after.get(path))
    whole = tuple(path.removesuffix("/...") for path in fault.left if path.endswith("/..."))
    expected = sorted(path for path in fault.left if not path.endswith("/..."))
    assert [path for path in changed if not path.startswith(whole)] == expected
    assert all(path in changed for path in whole)
    assert not logging.getLogger("photoclinometry").handlers


def test_the_table_names_each_fault_once():
    assert len({name_of(fault) for fault in FAULTS}) == len(FAULTS) >= 110


def test_a_fault_says_how_its_message_begins():
    assert [name_of(fault) for fault in FAULTS if fault.says.startswith("...")] == []


def test_each_answer_of_before_has_its_fault():
    """Faults that came later need none."""
    answers = read_answers()
    keys = [answer.key for answer in answers]
    assert len(set(keys)) == len(keys)
    assert set(keys) <= {(fault.kind, fault.name) for fault in FAULTS}
    for answer in answers:
        assert answer.ends in (*WORDS, *NO_WORDS, *ABSENT)
        assert answer.cause in (("yes", "no") if answer.ends in WORDS else ("",)), answer


def test_words_are_those_of_a_fault_if_they_begin_so_and_have_its_parts_in_order():
    fault = Fault(kind="", name="", command="", says="a.png: is ... so ... remove")
    assert fault.is_said_by("a.png: is dark, so that nothing is seen; remove it")
    assert not fault.is_said_by("images/a.png: is dark, so that nothing is seen; remove it")
    assert not fault.is_said_by("a.png: is dark; remove it, so that the rest is mapped")
    for says in ("a.png: is dark; remove it", "a.png: ... remove it"):
        whole = Fault(kind="", name="", command="", says=says, whole=True)
        assert whole.is_said_by("a.png: is dark; remove it")
        assert not whole.is_said_by("a.png: is dark; remove it, or else")


def test_ends_of_commands_are_told_apart():
    assert end_of("work\nphomo: a.png: is dark\n", 2) == ("one line", "a.png: is dark")
    assert end_of("phomo: 2 files:\n  a.png: is dark\n", 2) == ("several lines", "2 files: a.png: is dark")
    assert end_of("╭─ Missing ─╮\n│ --out PATH │\n╰───────────╯\n", 2) == ("box", "Missing --out PATH")
    assert end_of("Traceback (most recent call last):\nKeyError: 7\n", 1) == ("traceback", "KeyError: 7")
    assert end_of("written: a.png\n", 0) == ("exit code 0", "written: a.png")


def test_the_reference_shows_each_fault_beside_its_answer_of_before(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "docs" / "_ext")
    import faults_reference

    rows = [line.split(" | ") for line in faults_reference.page().splitlines() if line.startswith("| ")]
    rows = [row for row in rows if row[0] != "| fault"]
    assert [row[0].removeprefix("| ") for row in rows] == [fault.name for fault in FAULTS]
    assert {len(row) for row in rows} == {len(faults_reference.HEADS)}
    assert [row[0].removeprefix("| ") for row in rows if row[2] == "nothing"] == [f.name for f in FAULTS if not f.says]
    measured = {answer.key for answer in read_answers()}
    later = [fault.name for fault in FAULTS if (fault.kind, fault.name) not in measured]
    assert [row[0].removeprefix("| ") for row in rows if row[-1] == "not measured |"] == later


def test_the_reference_shows_a_fault_that_came_later_without_an_answer_of_before(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "docs" / "_ext")
    import faults_reference

    monkeypatch.setattr("faults_before.read_answers", lambda: read_answers()[1:])
    (first,) = (line for line in faults_reference.page().splitlines() if line.startswith(f"| {FAULTS[0].name} "))
    assert first.endswith(" | not measured |")


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault.test], ids=name_of)
def test_the_test_of_a_fault_exists(fault):
    file, function = fault.test.split("::")
    assert f"def {function}(" in Path(__file__).with_name(file).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "command",
    [
        "info site",
        "info mapped/run",
        f"{EVALUATE} --no-images",
        f"{EXPORT} --products csv",
        f"{RENDER} --sun 0 0 1",
        f"{VIEWS} 10 5 --out new",
        f"{INGEST} {SUNS}",
    ],
)
def test_what_is_not_spoilt_is_good(command, here):
    assert phomo(*shlex.split(command)) == 0


def test_a_run_that_ended_at_its_images_goes_on_with_corrected_ones(here, capsys):
    """All of them changed, so that the folder's site has no image in common with the corrected one."""
    frames(lambda x: 100 * x)()
    assert phomo(*shlex.split(RUN)) == 2
    assert "divide per cent by 100" in capsys.readouterr().err
    frames(lambda x: x)()
    assert phomo(*shlex.split(RUN)) == 1
    assert "0 of 4 views registered" in capsys.readouterr().err


def test_suns_that_light_no_landmark_are_told(here, monkeypatch, capsys):
    (fault,) = (fault for fault in FAULTS if fault.test.endswith("::test_suns_that_light_no_landmark_are_told"))
    scene = synthetic_scene(size=8)
    reversed_suns = replace(scene, views=replace(scene.views, sun=-scene.views.sun))
    monkeypatch.setattr(pipeline, "run", lambda *_, **__: with_model(reversed_suns, scene.reflectance))
    assert phomo(*shlex.split(fault.command)) == fault.code
    assert fault.is_said_by(message(capsys.readouterr().err, fault.form))


def test_memory_that_does_not_suffice_is_told(here, monkeypatch, capsys):
    def fails(*_):
        raise MemoryError("Unable to allocate 32.0 GiB for an array with shape (65535, 65535)")

    monkeypatch.setattr(pipeline, "run", fails)
    assert phomo(*shlex.split(RUN)) == 1
    said = message(capsys.readouterr().err, LINE)
    assert said.startswith("out of memory (Unable to allocate 32.0 GiB")
    assert said.endswith("; give a smaller region, a larger stride, or fewer or smaller images")
