"""Measures the answers of an earlier revision of `phomo` to the faults of `tests/faults.py`.

    python benchmarks/faults_at.py 1d50e0a                          every fault: ten minutes, one process at a time
    python benchmarks/faults_at.py 1d50e0a --only "a Sun is NaN"    only these, such as new ones
    python benchmarks/faults_at.py HEAD --file now.csv              another revision, beside the file of the tests

Today's code makes the good examples (`tests/fault_place.py`). The revision makes `scene.h5` and `run.json` of the
finished run, since it may not read those of today, and runs the commands. Standard output has the answers in Markdown,
`tests/faults_before.csv` keeps them. Whether words name the cause is found where they are today's; elsewhere a person
fills that column, and it is kept while the words stay the same.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from contextlib import chdir
from dataclasses import replace
from pathlib import Path

import tyro

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from fault_place import build_place, contents, small_disk  # noqa: E402
from faults import FAULTS, REFINE, RUN, SUNS, Fault  # noqa: E402
from faults_before import FILE, WORDS, Answer, read_answers, write_answers  # noqa: E402

LIMIT_S = 60.0
"""Time limit of a command. Faults are answered in seconds; a study that ought not to begin takes an hour."""
LONGEST = 240
"""Characters of an answer that are kept."""
GOOD = (
    "evaluate mapped/run --out evaluated",
    "export mapped/run --out exported --products csv",
    "render mapped/run --out rendered.png",
    f"ingest photos/20190301T101500.png --out ingested {SUNS}",
    "refine model --out refined --min-observations 1 --min-view-observations 1",
)
"""Commands that have to succeed before a fault is put in. They also compile the revision's kernels."""
UNSPOILT = (RUN, "run mapped/site.toml --out other", REFINE)
"""Commands whose images do not determine a map. A fault that they end alike with was not noticed."""
UNKNOWN = re.compile("Unrecognized (or misplaced )?options: --|: unknown key;")
BODIES = {"body", "potato"}
"""Words of commands that are about whole bodies, which came with the command `body`."""
PHOMO = "from photoclinometry.cli import main; main()"
SCENE = """from pathlib import Path
from photoclinometry.io.scene_file import write_scene
from scenes import synthetic_scene
write_scene(Path("mapped/run/scene.h5"), synthetic_scene(size=12, views=4))"""


class Program:
    """The package as it was at a revision, in processes of its own."""

    def __init__(self, revision: str, folder: Path, good: Path) -> None:
        """Unpacks the revision, and builds the good examples. Ends the program where these are not good."""
        folder.mkdir()
        call = ["git", "archive", revision, "src", "tests"]
        archive = subprocess.run(call, cwd=ROOT, check=True, capture_output=True)
        subprocess.run(["tar", "x", "-C", folder], input=archive.stdout, check=True)
        self.folder, self.good = folder, good
        self.environment = os.environ | {"PYTHONPATH": f"{folder}/src:{folder}/tests", "COLUMNS": "80"}
        found = re.search(r"\{([a-z,\s]+)\}", self.call(PHOMO, "--help").stdout)
        assert found is not None
        self.commands = set(found[1].split(","))
        build_place(good)
        with chdir(good):
            self.call(SCENE).check_returncode()
            self.call(PHOMO, *shlex.split("run mapped/site.toml --out begun"))
            Path("begun/run.json").replace("mapped/run/run.json")
            shutil.rmtree("begun")
        with tempfile.TemporaryDirectory() as copy, chdir(copy):
            shutil.copytree(good, copy, dirs_exist_ok=True)
            for command in GOOD:
                done = self.call(PHOMO, *shlex.split(command))
                if done.returncode != 0:
                    raise SystemExit(f"{command}: fails without a fault, so that nothing is comparable: {done.stderr}")
            ends = (self.call(PHOMO, *shlex.split(command)) for command in UNSPOILT)
            self.unspoilt = {end_of(done.stderr, done.returncode) for done in ends}

    def call(self, code: str, *arguments: str, limit_s: float | None = None) -> subprocess.CompletedProcess[str]:
        """Raises TimeoutExpired."""
        call = [sys.executable, "-c", code, *arguments]
        return subprocess.run(
            call, env=self.environment, timeout=limit_s, capture_output=True, text=True, stdin=subprocess.DEVNULL
        )


def main(revision: str, /, only: tuple[str, ...] = (), file: Path = FILE) -> None:
    """Measure what a revision answers.

    Args:
        revision: Commit, branch or tag.
        only: Only the faults of these names.
        file: Table of answers, as CSV; rows that are not measured anew are kept.
    """
    known = {answer.key: answer for answer in read_answers(file)}
    print("| fault | ends | exit code | words | left |\n|---|---|---:|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        program = Program(revision, Path(folder, "source"), Path(folder, "good"))
        for fault in FAULTS:
            if not only or fault.name in only:
                found, earlier = answer(fault, program), known.get((fault.kind, fault.name))
                if earlier is not None and (earlier.ends, earlier.words) == (found.ends, found.words):
                    found = replace(found, cause=earlier.cause or found.cause)
                known[found.key] = found
                cells = (found.fault, found.ends, found.code, found.words.replace("|", "/"), found.left)
                print(f"| {' | '.join(cells)} |", flush=True)
    write_answers((known[key] for fault in FAULTS if (key := (fault.kind, fault.name)) in known), file)


def answer(fault: Fault, program: Program) -> Answer:
    """The answer to one fault, put into a copy of the good examples."""
    empty = Answer(kind=fault.kind, fault=fault.name, ends="not tried")
    # A folder in place of its site.toml was not understood; the same is meant.
    command = shlex.split(re.sub(r"^run site ", "run site/site.toml ", fault.command))
    if fault.test:
        return empty
    needed = {*command[:1], *("body" for word in command if word in BODIES)}
    if not needed <= program.commands and "no command" not in fault.says:
        return replace(empty, ends="no such command")
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        shutil.copytree(program.good, folder, dirs_exist_ok=True)
        try:
            if fault.make is not None:
                fault.make()
        except AssertionError:  # the text to be replaced is not there
            return replace(empty, ends="not comparable")
        before = contents(Path())
        try:
            with small_disk(fault.disk):
                done = program.call(PHOMO, *command, limit_s=LIMIT_S)
        except subprocess.TimeoutExpired:
            return replace(empty, ends="no end", left=_changes(before, contents(Path())))
        left = _changes(before, contents(Path()))
        said = done.stderr.replace(f"{Path().resolve()}/", "").replace(f"{program.folder}/", "")
        said = re.sub(r"(\.partial-)[0-9a-f]+", r"\1...", said)
    ends, words = end_of(said, done.returncode)
    cause = "yes" if ends in WORDS and fault.is_said_by(words) else ""
    if not cause and (ends, words) in program.unspoilt:
        ends = "not noticed"
    elif UNKNOWN.search(words) and not re.search("Unrecognized|unknown", fault.says):
        ends = "no such option"
    words = words if len(words) <= LONGEST else words[: LONGEST - 3].rstrip() + "..."
    return replace(empty, ends=ends, code=str(done.returncode), words=words, left=left, cause=cause)


def end_of(said: str, code: int) -> tuple[str, str]:
    """The kind of an end, and its words."""
    lines = [line.strip() for line in said.splitlines() if line.strip()] or [""]
    if code == 0 or "Traceback" in said:
        return "traceback" if code else "exit code 0", lines[-1]
    if "╭" in said:
        return "box", " ".join(re.sub("[│─╭╮╰╯]", " ", said[said.index("╭") :]).split())
    first = max((k for k, line in enumerate(lines) if line.startswith("phomo: ")), default=len(lines) - 1)
    words = " ".join(lines[first:]).removeprefix("phomo: ")
    return "one line" if first == len(lines) - 1 else "several lines", words


def _changes(before: dict[str, str], after: dict[str, str]) -> str:
    """Paths that appeared, changed or went; of a new folder itself alone."""
    changed = sorted(path for path in before | after if before.get(path) != after.get(path))
    new = tuple(f"{path}/" for path in changed if after.get(path) == "")
    return ", ".join(path + "/" * (f"{path}/" in new) for path in changed if not path.startswith(new))


if __name__ == "__main__":
    tyro.cli(main)
