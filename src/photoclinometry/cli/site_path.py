"""A site on the command line: a site.toml, or the folder with one."""

from __future__ import annotations

from pathlib import Path

from photoclinometry.model.errors import InputError


def site_file(path: Path) -> Path:
    """The site.toml that a path names: itself, or the one in a folder. Raises InputError for a folder without one."""
    if not path.is_dir():
        return path
    if not (path / "site.toml").is_file():
        raise InputError(f"{path}: the folder holds no site.toml; give a site.toml, or the folder with one")
    return path / "site.toml"
