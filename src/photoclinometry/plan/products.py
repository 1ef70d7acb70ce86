"""A plan as files: plan.json, and its pictures."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.json_file import write_json
from photoclinometry.model.errors import InputError
from photoclinometry.plan.run import Plan

JSON = "plan.json"
"""Its presence says that a folder holds a plan, which another may replace."""


def check_folder(folder: Path) -> None:
    """Raises InputError where `write_plan` must not write: a folder that holds something else than a plan."""
    if folder.is_dir() and any(folder.iterdir()) and not (folder / JSON).is_file():
        raise InputError(f"{folder}: is not empty and holds no plan; choose another --out")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; choose a folder for the plan (--out)")


def write_plan(folder: Path, plan: Plan) -> None:
    """plan.json and the pictures; the folder appears whole, in the place of an earlier plan.

    Raises InputError where the folder holds something else, RunFolderError where it cannot be written.
    """
    from photoclinometry.plan.pictures import draw_plan

    check_folder(folder)
    with atomic_path(folder) as work:
        work.mkdir()
        write_json(work / JSON, plan.as_dict())
        draw_plan(work, plan)
