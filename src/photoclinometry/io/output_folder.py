"""Whether a command may write the folder that it is given."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.model.errors import RunFolderError


def check_output_folder(
    folder: Path, what: str, mark: str | None = None, *, overwrite: bool = True, option: str | None = None
) -> None:
    """Raises RunFolderError where a folder must not be written: one that holds something else than an earlier `what`.

    what: what is written there, for messages. mark: the file that says that a folder holds one, which the next may
    replace; None where none is replaced. overwrite: whether it is to be replaced. option: that names the folder.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    another = option or "folder"
    if mark is None:
        raise RunFolderError(f"{folder}: exists and is not empty; choose another {another} for the {what}")
    if not folder.is_dir():
        named = f" ({option})" if option else ""
        raise RunFolderError(f"{folder}: is a file; choose a folder for the {what}{named}")
    if not (folder / mark).is_file():
        raise RunFolderError(f"{folder}: is not empty and holds no {what}; choose another {another}")
    if not overwrite:
        raise RunFolderError(f"{folder}: holds a {what} already; pass --overwrite, or choose another {another}")
