"""`phomo study`: many simulated sites, many models, and the paper's tables and figures."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.study import StudyOptions


def study(
    out: Path,
    options: Annotated[StudyOptions, tyro.conf.arg(name="")] = StudyOptions(),  # noqa: B008
) -> Path:
    """Simulate sites, map each with every model, and write tables and figures against the exact truth.

    Every combination of preset, lighting, surface, seed and model is one run. An interrupted study resumes; with other
    options, finished runs are kept where possible. Writes study.md, study.json and figures/, and shows the tables.

    Args:
        out: Folder for the study; new, empty, or that of an earlier one.
        options: The sites to simulate, and how they are mapped.
    """
    from rich.console import Console

    from photoclinometry.evaluate.spread import Table
    from photoclinometry.io.json_file import read_json
    from photoclinometry.study import run_study

    console = Console(stderr=True)

    def progress(what: str, done: int, total: int) -> None:
        console.print(f"{done}/{total} {what}", highlight=False, markup=False)

    path = run_study(options, out, progress)
    logging.getLogger(__name__).info("study: %s", path)
    for content in read_json(path.with_name("study.json"), "repeat the command")["tables"]:
        table = Table.from_dict(content).terminal(console.width)
        console.print(f"\n{table}", highlight=False, markup=False, soft_wrap=True)
    print(path)
    return path
