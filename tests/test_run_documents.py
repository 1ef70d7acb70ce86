"""The script that runs the pages word for word: what it runs, what it leaves out and why."""

import re

import run_documents
from run_documents import PAGES, ROOT, Step, code_blocks, commands_of, copy_repository, run_page, steps_of

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
    assert run_documents.main(["--list", "--pages", *missions]) == 0
    said = capsys.readouterr().out
    assert len(re.findall(r"left out \(needs images of an archive\): phomo ingest", said)) >= 10


def test_a_failure_is_counted_and_shown(monkeypatch, tmp_path):
    """With an environment and a copy that cost nothing."""
    monkeypatch.setattr(run_documents.venv, "create", lambda *_, **__: None)
    monkeypatch.setattr(run_documents, "copy_repository", lambda folder: folder.mkdir())
    monkeypatch.setattr(run_documents, "_INSTALL", "true")
    said = []
    steps = [Step("NAME=site"), Step("test $NAME = site"), Step("echo wrong >&2; exit 3"), Step("no", "is left out")]
    assert run_page(steps, said.append) == 1
    told = "\n".join(said)
    assert "exit 3" in told
    assert "    wrong" in told
    assert "left out    no    (is left out)" in told


def test_the_copy_has_what_git_has_and_no_build_outputs(tmp_path):
    copy_repository(tmp_path / "copy")
    assert (tmp_path / "copy" / "pyproject.toml").is_file()
    assert not (tmp_path / "copy" / ".venv").exists()
    assert not list((tmp_path / "copy").rglob("*.nbi"))
