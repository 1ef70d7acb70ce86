"""The page of faults, generated from the table that the tests try."""

from __future__ import annotations

import re
import sys
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from faults_before import Answer

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs" / "reference" / "cli" / "faults.md"

INTRO = """# Faults

What `phomo` answers to what can go wrong. Each row is a test: the fault is put into good examples, the command is run,
and exit code, message and everything on disk are compared. A message is one line, the last one on standard error, and
begins with `phomo:`; only those about options may be in a box. Three dots stand for other words.
[All exit codes](../run-folder.md#exit-codes).

The last column has what the command answered before the work on its messages, as measured
([decision 0056](../../decisions/0056-faults-before-and-now.md)): its words with the exit code before them, or how it
ended without any. Words about something else than the cause are in italics. Faults that came to the table later were
not measured.
"""
HEADS = ("fault", "command", "message", "exit code", "left on disk", "before")
LEFT = {
    (): "nothing new",
    ("map", "map/log", "map/run.json"): "a run folder without results; the command goes on there",
}


def page() -> str:
    """The table in Markdown, a section for each kind."""
    sys.path.insert(0, str(ROOT / "tests"))
    from faults import FAULTS
    from faults_before import read_answers

    before = {answer.key: answer for answer in read_answers()}
    lines = [INTRO]
    for kind, group in groupby(FAULTS, key=lambda fault: fault.kind):
        lines += [f"## {kind}", "", f"| {' | '.join(HEADS)} |", "|---|---|---|---:|---|---|"]
        for fault in group:
            left = LEFT.get(fault.left) or ", ".join(fault.left)
            earlier = _earlier(before.get((fault.kind, fault.name)))
            cells = (
                fault.name,
                _code(f"phomo {fault.command}".strip()),
                _code(fault.says),
                str(fault.code),
                left,
                earlier,
            )
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def _earlier(answer: Answer | None) -> str:
    """What was answered before: code and words, or how the command ended; and what it left on disk."""
    if answer is None:
        return "not measured"
    left = f"; left: {answer.left}" if answer.left else ""
    if answer.cause:
        slant = "*" if answer.cause == "no" else ""
        return f"{answer.code}: {slant}{_code(answer.words)}{slant}{left}"
    return (f"traceback: {_code(answer.words)}" if answer.ends == "traceback" else answer.ends) + left


def _code(text: str) -> str:
    """Text as it is typed or printed, long names shortened, with more backticks around it than it has; "nothing" where
    nothing is printed."""
    if not text:
        return "nothing"
    text = re.sub(r"x{20,}", "xxx...", text)
    mark = "``" if "`" in text else "`"
    space = " " if "`" in text else ""
    return f"{mark}{space}{text.replace('|', '/')}{space}{mark}"


def write_page(app: Any = None) -> None:
    """Writes reference/cli/faults.md, which is not kept in the repository."""
    FILE.parent.mkdir(parents=True, exist_ok=True)
    text = page()
    if not FILE.is_file() or FILE.read_text(encoding="utf-8") != text:
        FILE.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write_page)
    return {"parallel_read_safe": True}
