"""Runs the commands of the README, the tutorial and the pages of the missions word for word, in a fresh environment.

    python benchmarks/run_documents.py                          # all of them: an hour, and downloads of packages
    python benchmarks/run_documents.py --list                   # what would run, and what is left out for which reason
    python benchmarks/run_documents.py --pages README.md        # some of them

Each page runs in a copy of the repository's files and in a virtual environment of its own, to which nothing is
installed but what the page says. What cannot run is left out and listed with its reason: commands that need downloaded
data, and those that need the result of such a command. Exit code 1 if a command fails.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
_MISSIONS = sorted(page for page in (ROOT / "docs" / "missions").glob("*.md") if page.name != "index.md")
PAGES = ("README.md", "docs/tutorial/first-map.md", *(f"docs/missions/{page.name}" for page in _MISSIONS))
EXCEPTIONS = {
    r"make test\b": "the suite is run by itself",
    r"phomo ingest\b": "needs images of an archive",
    r"phomo fetch\b": "downloads published data",
    r"phomo \S+ .*\bpublished/": "needs published data",
}
"""Commands that are not run, by a pattern of their beginning, and why."""
_INSTALL = "pip install ."
"""Run first on pages that do not say how to install."""
_PROGRAMS = ("phomo", "pip", "make", "mkdir")
_SHOWN = 20
"""Lines of a failed command's output that are shown."""


@dataclass(frozen=True)
class Step:
    """A command of a page, or a block of Python."""

    text: str
    skipped: str | None = None
    """Why it is not run."""
    python: bool = False


def code_blocks(page: Path) -> list[tuple[str, str]]:
    """(language, text) of the fenced and indented blocks of a page, in their order. Indented ones have no language."""
    text = page.read_text(encoding="utf-8")
    pattern = r"^```(\S*)\n(.*?)^```|((?:^    [^\n]*\n|^\n)+)"
    found = []
    for match in re.finditer(pattern, text, flags=re.MULTILINE | re.DOTALL):
        if match[3] is None:
            found.append((match[1], match[2]))
        elif match[3].strip():
            found.append(("", re.sub(r"^    ", "", match[3], flags=re.MULTILINE)))
    return found


def commands_of(block: str) -> Iterator[str]:
    """The commands of a block: continued lines joined, comments taken off."""
    for line in block.replace("\\\n", " ").splitlines():
        command = re.split(r"(?:^|\s)# ?", line, maxsplit=1)[0].strip()
        if command.split(" ")[0] in _PROGRAMS or re.match(r"[A-Z_]+=\S", command):
            yield command


def steps_of(page: Path) -> list[Step]:
    """The commands of a page in their order, with those that cannot run marked."""
    steps: list[Step] = []
    absent: set[str] = set()
    for language, block in code_blocks(page):
        if language == "python":
            steps.append(Step(block, _needs(block, absent), python=True))
        for command in commands_of(block) if language in ("", "bash", "sh", "console") else ():
            why = next((why for pattern, why in EXCEPTIONS.items() if re.match(pattern, command)), None)
            why = why or _needs(command, absent)
            if why is not None:
                absent |= _written(command)
            steps.append(Step(command, why))
    return steps


def _needs(text: str, absent: set[str]) -> str | None:
    """Why something cannot run: it names what a command that was left out would have written."""
    without_body = re.sub(r"--body \S+", "", text)  # a site may be called as its body
    named = {word.split("/")[0] for word in re.findall(r"[\w./-]+", without_body)}
    missing = sorted(named & absent)
    return f"needs {missing[0]}, which a command left out makes" if missing else None


def _written(command: str) -> set[str]:
    """The folder that a command makes (`--out`)."""
    words = shlex.split(command)
    return {words[k + 1].split("/")[0] for k, word in enumerate(words[:-1]) if word == "--out"}


def run_page(steps: Sequence[Step], say: Callable[[str], None] = print) -> int:
    """Runs the steps in a copy of the repository with an environment of its own; the number of failures."""
    failures = 0
    with tempfile.TemporaryDirectory() as temporary:
        copy, place = Path(temporary) / "checkout", Path(temporary) / "venv"
        copy_repository(copy)
        venv.create(place, with_pip=True)
        variables = os.environ | {"PATH": f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}", "MPLBACKEND": "agg"}
        variables.pop("PYTHONPATH", None)
        todo = [s for s in steps if s.skipped is None]
        if todo and not any(s.text.startswith("pip install") for s in todo):
            steps = [Step(_INSTALL), *steps]
        for step in steps:
            assigned = re.fullmatch(r"([A-Z_]+)=(\S+)", step.text)
            if assigned and step.skipped is None:
                variables[assigned[1]] = assigned[2]
            else:
                failures += not _run(step, copy, variables, say)
    return failures


def _run(step: Step, folder: Path, variables: dict[str, str], say: Callable[[str], None]) -> bool:
    title = "python block" if step.python else step.text
    if step.skipped is not None:
        say(f"  left out    {title}    ({step.skipped})")
        return True
    start = time.monotonic()
    command = ["python", "-c", step.text] if step.python else ["bash", "-c", step.text]
    done = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, check=False)
    say(f"  {'ok' if done.returncode == 0 else f'exit {done.returncode}':6}{time.monotonic() - start:5.0f} s {title}")
    if done.returncode:
        say("\n".join("    " + line for line in (done.stdout + done.stderr).splitlines()[-_SHOWN:]))
    return done.returncode == 0


def copy_repository(folder: Path) -> None:
    """The files that git knows, or would add, in a new folder."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode()
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def main(arguments: Sequence[str] | None = None) -> int:
    """The number of pages with a failure, as an exit code of 0 or 1."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--list", action="store_true", help="show what would run, and run nothing")
    parser.add_argument("--pages", nargs="+", default=PAGES, help="paths from the repository's root")
    options = parser.parse_args(arguments)
    failures = 0
    for name in options.pages:
        page = ROOT / name
        steps = steps_of(page)
        print(name)
        if options.list:
            for step in steps:
                title = "python block" if step.python else step.text
                print(f"  {'runs' if step.skipped is None else f'left out ({step.skipped})'}: {title}")
        else:
            failures += run_page(steps)
    print(f"{failures} commands failed" if failures else "no command failed" if not options.list else "nothing was run")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
