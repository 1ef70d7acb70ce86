"""The script that runs the pages word for word: what it runs, what it leaves out and why."""

import re
import subprocess
from pathlib import Path

import pytest

import run_documents
from run_documents import (
    NO_STAND_INS,
    PAGES,
    ROOT,
    STAND_INS,
    Step,
    code_blocks,
    commands_of,
    copy_repository,
    run_page,
    steps_of,
)

OSIRIS_REX = ROOT / "docs" / "missions" / "osiris-rex.md"
DONE = subprocess.CompletedProcess([], 0, "", "")
PAGE = """# A page

    phomo ingest *.fits --out site     # needs files
    phomo run site/site.toml --out run
    phomo simulate \\
        --out other
    VALUE=1
    a = [not a command]

```python
read("run")
```

```toml
phomo = "nothing"
```

    phomo info other
"""


def test_commands_are_found_in_their_order_and_what_cannot_run_is_left_out(tmp_path):
    (tmp_path / "page.md").write_text(PAGE)
    steps = steps_of(tmp_path / "page.md")
    assert [" ".join(s.text.split()) for s in steps] == [
        "phomo ingest *.fits --out site",
        "phomo run site/site.toml --out run",
        "phomo simulate --out other",
        "VALUE=1",
        'read("run")',
        "phomo info other",
    ]
    assert [s.skipped for s in steps] == [
        "needs images of an archive",
        "needs site, which a command left out makes",
        None,
        None,
        "needs run, which a command left out makes",
        None,
    ]
    assert [language for language, _ in code_blocks(tmp_path / "page.md")] == ["", "python", "toml", ""]
    assert list(commands_of("phomo a # b\n# phomo c\nls")) == ["phomo a"]


def test_every_command_of_the_tutorial_runs_and_most_of_the_readme():
    assert all(step.skipped is None for step in steps_of(ROOT / "docs" / "tutorial" / "first-map.md"))
    left_out = [step.text for step in steps_of(ROOT / "README.md") if step.skipped is not None]
    assert left_out == ["make test"]


def test_every_mission_page_has_commands_and_reasons_for_those_left_out(capsys):
    missions = [page for page in PAGES if "missions" in page]
    assert len(missions) == 6
    assert {Path(page).name for page in missions} == set(NO_STAND_INS) | set(STAND_INS)
    assert run_documents.main(["--list", "--pages", *missions]) == 0
    said = capsys.readouterr().out
    left_out = re.findall(r"left out \((needs images of [^)]*)\): phomo ingest", said)
    if run_documents.what_stand_ins_lack() is None:
        assert set(left_out) == set(NO_STAND_INS.values())
    else:
        assert len(left_out) >= 8


def test_every_stand_in_is_one_that_can_be_made():
    pytest.importorskip("spiceypy")
    pytest.importorskip("embreex")
    from stand_ins import ARCHIVES

    assert set(STAND_INS.values()) == set(ARCHIVES)


@pytest.mark.parametrize(
    ("page", "least"),
    [
        ("osiris-rex.md", 11),
        ("dawn.md", 6),
        ("hayabusa.md", 6),
        ("hayabusa2.md", 6),
        ("near.md", 7),
        ("rosetta.md", 6),
    ],
)
def test_every_command_of_pages_with_stand_ins_runs_but_the_downloads(monkeypatch, page, least):
    monkeypatch.setattr(run_documents, "what_stand_ins_lack", lambda: None)
    steps = steps_of(OSIRIS_REX.with_name(page))
    assert any(step.text.startswith("phomo export") for step in steps)
    assert len([step for step in steps if step.text.startswith("phomo") and step.skipped is None]) >= least
    assert {step.text.split()[0] for step in steps if step.skipped is not None} == {"wget"}


def test_without_real_kernels_the_page_on_osiris_rex_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(run_documents, "_SHARED", tmp_path / "absent")
    ingest = next(step for step in steps_of(OSIRIS_REX) if step.text.startswith("phomo ingest"))
    assert ingest.skipped is not None
    assert re.fullmatch(r"needs images of an archive, and for stand-ins real kernels in .*absent", ingest.skipped)


def test_the_package_s_name_at_the_index_stands_for_the_copy(monkeypatch, tmp_path):
    """PACKAGE.md is the text of the package index, and names the package as it is there."""
    assert all(step.skipped is None for step in steps_of(ROOT / "PACKAGE.md"))
    run = []
    monkeypatch.setattr(run_documents.subprocess, "run", lambda command, **_: run.append(command[2]) or DONE)
    for step in ("pip install photoclinometry", "pip install 'photoclinometry[geo]'", "pip install photoclinometry-x"):
        run_documents._run(Step(step), tmp_path, {}, lambda _: None)
    assert run == ["pip install .", "pip install '.[geo]'", "pip install photoclinometry-x"]


def test_a_failure_is_counted_and_shown(monkeypatch, tmp_path):
    """With an environment and a copy that cost nothing."""
    monkeypatch.setattr(run_documents.venv, "create", lambda *_, **__: None)
    monkeypatch.setattr(run_documents, "copy_repository", lambda folder: folder.mkdir())
    monkeypatch.setattr(run_documents, "_INSTALL", "true")
    said = []
    steps = [
        Step("NAME=site"),
        Step("test $NAME = site && test -f placed"),
        Step("echo wrong >&2; exit 3"),
        Step("no", "is left out"),
    ]
    assert run_page(steps, said.append, lambda copy: (copy / "placed").touch()) == 1
    told = "\n".join(said)
    assert "exit 3" in told
    assert "    wrong" in told
    assert "left out    no    (is left out)" in told


def test_the_copy_has_what_git_has_and_no_build_outputs(tmp_path):
    copy_repository(tmp_path / "copy")
    assert (tmp_path / "copy" / "pyproject.toml").is_file()
    assert not (tmp_path / "copy" / ".venv").exists()
    assert not list((tmp_path / "copy").rglob("*.nbi"))
