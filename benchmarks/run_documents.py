"""Runs the commands of the README, the tutorial and the pages of the missions word for word, in a fresh environment.

    python benchmarks/run_documents.py                          # all of them: an hour, and downloads of packages
    python benchmarks/run_documents.py --list                   # what would run, and what is left out for which reason
    python benchmarks/run_documents.py --pages README.md        # some of them

Each page runs in a copy of the repository's files and in a virtual environment of its own, to which nothing is
installed but what the page says; the package's name at the package index stands for the copy. Where a page downloads
files of an archive, stand-ins lie in place (`stand_ins.py`). What cannot run is left out and listed with its reason:
commands that need downloaded data, and those that need the result of such a command. Exit code 1 if a command fails.
"""

from __future__ import annotations

import argparse
import importlib.util
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
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[1]
_MISSIONS = sorted(page for page in (ROOT / "docs" / "missions").glob("*.md") if page.name != "index.md")
PAGES = ("README.md", "PACKAGE.md", "docs/tutorial/first-map.md", *(f"docs/missions/{page.name}" for page in _MISSIONS))
EXCEPTIONS = {
    r"make test\b": "the suite is run by itself",
    r"wget\b": "downloads from an archive",
    r"phomo fetch\b": "downloads published data",
    r"phomo \S+ .*\bpublished/": "needs published data",
}
"""Commands that are not run, by a pattern of their beginning, and why."""
STAND_INS = {
    "dawn.md": "fc2",
    "hayabusa.md": "amica",
    "hayabusa2.md": "onc-t",
    "near.md": "msi",
    "osiris-rex.md": "mapcam",
    "rosetta.md": "nac",
}
"""The archive of `stand_ins.py` whose files are placed for a page, by the page's name."""
NO_STAND_INS: dict[str, str] = {}
"""Missions whose `phomo ingest` is left out, and why."""
_SHARED = ROOT.parent / "shared" / "data"
"""Real files of archives, where they are at hand."""
_REAL_FILES = {
    "osiris-rex.md": {
        "20190425T211232S312_map_iofL2pan.cub": "phocube/20190425T211232S312_map_iofL2pan-crop.cub",
        "20200303T213031S138_ncm_L0.cub": "osirisRexImages/20200303T213031S138_ncm_L0-reduced.cub",
        "ocams20190314t190123s972_map_iofl2pan_77236.png": "spc/ocams20190314t190123s972_map_iofl2pan_77236.png",
        "sumfiles/M605862153F5.SUM": "spc/M605862153F5.SUM",
    },
}
"""Real files of a page, by the names that the page gives them."""
_INGEST = r"phomo ingest\b"
_INSTALL = "pip install ."
"""Run first on pages that do not say how to install."""
_FROM_INDEX = re.compile(r"^(pip install '?)photoclinometry(?=\[|'|$)")
"""The package by its name at the package index."""
_PROGRAMS = ("phomo", "pip", "make", "mkdir", "wget")
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
    exceptions = EXCEPTIONS | _without_images(page)
    for language, block in code_blocks(page):
        if language == "python":
            steps.append(Step(block, _needs(block, absent), python=True))
        for command in commands_of(block) if language in ("", "bash", "sh", "console") else ():
            why = next((why for pattern, why in exceptions.items() if re.match(pattern, command)), None)
            why = why or _needs(command, absent)
            if why is not None:
                absent |= _written(command)
            steps.append(Step(command, why))
    return steps


def _without_images(page: Path) -> dict[str, str]:
    """The exception of `phomo ingest` on pages for which there are no files to ingest."""
    if page.name in STAND_INS:
        lacking = what_stand_ins_lack()
        return {} if lacking is None else {_INGEST: f"needs images of an archive, and for stand-ins {lacking}"}
    return {_INGEST: NO_STAND_INS.get(page.name, "needs images of an archive")}


def what_stand_ins_lack() -> str | None:
    """The missing parts for making stand-ins; None if nothing is missing."""
    if not _SHARED.is_dir():
        return f"real kernels in {os.path.relpath(_SHARED, ROOT)}"
    missing = [name for name in ("spiceypy", "embreex") if importlib.util.find_spec(name) is None]
    return f"the package {missing[0]}" if missing else None


def place_stand_ins(page: str, folder: Path) -> None:
    """The downloads of a mission's page: stand-ins for images and kernels, and real files where they are at hand."""
    from stand_ins import write_archive

    write_archive(folder, STAND_INS[page], _SHARED)
    for name, source in _REAL_FILES.get(page, {}).items():
        (folder / name).parent.mkdir(exist_ok=True)
        shutil.copy2(_SHARED / "formats" / source, folder / name)


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


def run_page(
    steps: Sequence[Step], say: Callable[[str], None] = print, place: Callable[[Path], None] | None = None
) -> int:
    """Runs the steps in a copy of the repository with an environment of its own; the number of failures.

    place: puts files of an archive into the copy, first of all.
    """
    failures = 0
    with tempfile.TemporaryDirectory() as temporary:
        copy, environment = Path(temporary) / "checkout", Path(temporary) / "venv"
        copy_repository(copy)
        if place is not None:
            place(copy)
        venv.create(environment, with_pip=True)
        variables = os.environ | {"PATH": f"{environment / 'bin'}{os.pathsep}{os.environ['PATH']}", "MPLBACKEND": "agg"}
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
    command = ["python", "-c", step.text] if step.python else ["bash", "-c", _FROM_INDEX.sub(r"\1.", step.text)]
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
            placed = what_stand_ins_lack() is None
            place = partial(place_stand_ins, page.name) if placed and page.name in STAND_INS else None
            failures += run_page(steps, place=place)
    print(f"{failures} commands failed" if failures else "no command failed" if not options.list else "nothing was run")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
