"""run.json: it marks a run folder, names its format, and says which site the folder belongs to."""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path
from typing import Any

from photoclinometry import __version__
from photoclinometry.io.atomic import unwritable, write_text
from photoclinometry.io.json_file import parse_json
from photoclinometry.io.run_files import CONFIG_FILE, LOG_FILE, PRODUCTS, SCENE_FILE
from photoclinometry.model.errors import RunFolderError
from photoclinometry.model.owner import Owner, read_owner
from photoclinometry.pipeline.folder import run_lock

log = logging.getLogger(__name__)

FORMAT = 1
"""Raised when what is in a run folder changes its meaning."""

MARK = "run.json"

BEGUN = frozenset((CONFIG_FILE, LOG_FILE))
"""What a run may leave before its first stage: config.toml by versions that wrote it first."""


def write_mark(folder: Path, owner: Owner | None = None) -> None:
    """Marks a folder as that of a run, of a site if that is known. Raises RunFolderError."""
    about = {} if owner is None else {"owner": owner.as_json()}
    write_text(folder / MARK, json.dumps({"format": FORMAT, "version": __version__, **about}) + "\n")


def owner_of_folder(folder: Path) -> Owner | None:
    """What the results in a run folder are of; None where it has no mark, or one that does not say.

    Raises RunFolderError where the mark is damaged.
    """
    return _read_mark(folder)[1] if (folder / MARK).is_file() else None


def check_new(path: Path) -> None:
    """Raises RunFolderError where something that is not a run stands at `path`. A run that begins has only its lock."""
    try:
        taken = path.exists() and (not path.is_dir() or not all(map(_is_of_a_beginning, path.iterdir())))
    except OSError as error:
        raise unwritable(path, error) from error
    if taken:
        raise RunFolderError(f"{path}: exists and is not a run folder; choose another --out")


def check_format(folder: Path) -> None:
    """Raises RunFolderError for a run folder of another format."""
    content, _ = _read_mark(folder)
    if content["format"] != FORMAT:
        raise RunFolderError(_of_other_format(folder, content))


def to_be_cleared(folder: Path, owner: Owner, overwrite: bool) -> bool:
    """Whether the run folder holds something else than runs of `owner`, and may be cleared of it.

    A folder without results is nobody's: a run that ended because of its images may go on with corrected ones.
    Raises RunFolderError where it may not: without `overwrite`, or if it holds anything that no run wrote.
    """
    content, found = _read_mark(folder)
    same_format = content["format"] == FORMAT
    results = {name for name in PRODUCTS - BEGUN if (folder / name).exists()}
    unclaimed = not results or (found is None and SCENE_FILE not in results)
    if same_format and (unclaimed or (found is not None and found.is_same(owner))):
        return False
    if not same_format and not overwrite:
        raise RunFolderError(_of_other_format(folder, content))
    if not overwrite:
        whose = "holds a map, and not of which site" if found is None else f"belongs to {found}"
        raise RunFolderError(
            f"{folder}: {whose}; this is {owner}: choose another --out, or give --overwrite (overwrite=True) to remove "
            "what is there"
        )
    _check_clearable(folder)
    return True


def clear(folder: Path) -> None:
    """Removes what runs wrote into a run folder, but for the mark, the lock, and the log, which is open by now.

    Raises RunFolderError where the folder holds anything that no run wrote, or something cannot be removed.
    """
    _check_clearable(folder)
    log.info("%s: what it holds of another run is removed", folder)
    for path in sorted(folder.iterdir()):
        if path.name in {MARK, run_lock.NAME, LOG_FILE}:
            continue
        remove(path)


def remove(path: Path) -> None:
    """Removes a file, a link or a folder, if it is there. Raises RunFolderError."""
    try:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(path, error) from error


def _read_mark(folder: Path) -> tuple[dict[str, Any], Owner | None]:
    """What the mark says, and of which site. Raises RunFolderError where it is damaged."""
    mark = folder / MARK
    try:
        content = parse_json(mark.read_text(encoding="utf-8"))
        content["format"]
        return content, read_owner(content)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RunFolderError(f"{mark}: damaged ({error}); choose another --out, or remove the folder") from error


def _of_other_format(folder: Path, content: dict[str, Any]) -> str:
    return (
        f"{folder}: run folder format {content['format']}, made by version {content.get('version')}; this version "
        f"({__version__}) writes format {FORMAT}: choose another --out, or remove the folder"
    )


def _check_clearable(folder: Path) -> None:
    """Raises RunFolderError where the folder holds something that no run wrote."""
    known = PRODUCTS | {MARK, run_lock.NAME}
    others = sorted(path.name for path in folder.iterdir() if path.name not in known and not _is_left_over(path))
    if others:
        raise RunFolderError(f"{folder}: holds {others[0]}, which no run wrote; move it, or choose another --out")


def _is_of_a_beginning(path: Path) -> bool:
    """Whether the file is there before the mark is."""
    return path.name == run_lock.NAME or _is_left_over(path)


def _is_left_over(path: Path) -> bool:
    """Whether a killed process left the file, under a temporary name of `io.atomic`."""
    return path.name.startswith(".") and (".partial-" in path.name or ".replaced-" in path.name)
