"""A plan as files: plan.json, and its pictures."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.json_file import write_json
from photoclinometry.io.output_folder import check_output_folder
from photoclinometry.plan.run import Plan

JSON = "plan.json"
"""Its presence says that a folder holds a plan, which another may replace."""


def check_folder(folder: Path) -> None:
    """Raises RunFolderError where `write_plan` must not write: a folder that holds something else than a plan."""
    check_output_folder(folder, "plan", JSON, option="--out")


def write_plan(folder: Path, plan: Plan) -> None:
    """plan.json and the pictures; the folder appears whole, in the place of an earlier plan.

    Raises RunFolderError where the folder holds something else, and where it cannot be written.
    """
    from photoclinometry.plan.pictures import draw_plan

    check_folder(folder)
    with atomic_path(folder) as work:
        work.mkdir()
        write_json(work / JSON, plan.as_dict())
        draw_plan(work, plan)
