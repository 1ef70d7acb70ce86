"""What `phomo` answered to the faults of `faults.py` before the work on its messages, as `benchmarks/faults_at.py`
measured it; decision 0056 says of which commit.

`faults_before.csv` has the answers. Its last column, whether the words name the cause, a person fills by reading.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

FILE = Path(__file__).with_name("faults_before.csv")

WORDS = ("one line", "several lines", "box")
"""Ends that consist of words about what is wrong."""
NO_WORDS = ("traceback", "exit code 0", "not noticed", "no end")
ABSENT = ("no such command", "no such option", "not comparable", "not tried")


@dataclass(frozen=True, kw_only=True)
class Answer:
    """How the command that met a fault ended."""

    kind: str
    fault: str
    ends: str
    """One of `WORDS`, `NO_WORDS` and `ABSENT`. "not noticed": the command ended as it does without the fault. "no end":
    it still worked at the time limit. "not comparable": the spoilt part did not exist."""
    code: str = ""
    """Exit code; empty where there is none."""
    words: str = ""
    """The last line of standard error, of a box its text; shortened."""
    left: str = ""
    """Files and folders that the command made or changed."""
    cause: str = ""
    """Whether `words` name the cause that today's message names: yes or no; empty where `ends` is not of `WORDS`."""

    @property
    def key(self) -> tuple[str, str]:
        return self.kind, self.fault

    @property
    def group(self) -> str:
        """What is counted: the end, and of words whether they name the cause."""
        return {"yes": "the cause", "no": "something else"}.get(self.cause, self.ends)


def read_answers(file: Path = FILE) -> list[Answer]:
    """The rows of a file; none where there is no file."""
    if not file.is_file():
        return []
    with file.open(encoding="utf-8", newline="") as stream:
        return [Answer(**row) for row in csv.DictReader(stream)]


def write_answers(answers: Iterable[Answer], file: Path = FILE) -> None:
    with file.open("w", encoding="utf-8", newline="") as stream:
        table = csv.DictWriter(stream, [each.name for each in fields(Answer)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(answer) for answer in answers)
