"""The page of faults, generated from the table that the tests try."""

from __future__ import annotations

import re
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs" / "reference" / "cli" / "faults.md"

INTRO = """# Faults

What `phomo` answers to what can go wrong. Each row is a test: the fault is put into good examples, the command is run,
and exit code, message and everything on disk are compared. A message is one line, the last one on standard error, and
begins with `phomo:`; only those about options may be in a box. Three dots stand for other words.
[All exit codes](../run-folder.md#exit-codes).
"""
HEADS = ("fault", "command", "message", "exit code", "left on disk")
LEFT = {
    (): "nothing new",
    ("map", "map/config.toml", "map/log", "map/run.json"): "a run folder without results; the command goes on there",
}


def page() -> str:
    """The table in Markdown, a section for each kind."""
    sys.path.insert(0, str(ROOT / "tests"))
    from faults import FAULTS

    lines = [INTRO]
    for kind, group in groupby(FAULTS, key=lambda fault: fault.kind):
        lines += [f"## {kind}", "", f"| {' | '.join(HEADS)} |", "|---|---|---|---:|---|"]
        for fault in group:
            left = LEFT.get(fault.left) or ", ".join(fault.left)
            command = re.sub(r"x{20,}", "xxx...", f"phomo {fault.command}")
            cells = (fault.name, _code(command), _code(fault.says), str(fault.code), left)
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def _code(text: str) -> str:
    """Text as it is typed or printed; with more backticks around it than it has."""
    if not text:
        return "-"
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
