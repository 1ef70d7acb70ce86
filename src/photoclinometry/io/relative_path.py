"""Paths in files that name other files, such as the images in `site.toml`."""

from __future__ import annotations

import os
from pathlib import Path, PurePath


def relative_path(file: Path, folder: Path) -> str:
    """The path of a file as seen from a folder, with forward slashes; either need not exist.

    Opened from there it leads to the file, also where links are on the way: ".." is the parent of the folder that a
    link leads to, not of the link. Names stay as they are given where they lead there. Where there is no relative path
    (another drive of Windows) it is the whole one.
    """
    there = folder.resolve()
    try:
        as_given = os.path.relpath(file, folder)
        if (there / as_given).resolve() == file.resolve():
            return PurePath(as_given).as_posix()
        return PurePath(os.path.relpath(file.parent.resolve() / file.name, there)).as_posix()
    except ValueError:
        return file.resolve().as_posix()
