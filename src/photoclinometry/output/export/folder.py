"""The folder of an export: the products of a table of formats, whole or not at all, with a manifest."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from photoclinometry import __version__
from photoclinometry.io.atomic import atomic_path
from photoclinometry.io.json_file import parse_json, write_json
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.owner import Owner, read_owner
from photoclinometry.model.warning import warn
from photoclinometry.output.export.formats import Format

log = logging.getLogger(__name__)

MANIFEST = "export.json"
FORMAT = "photoclinometry export"


def write_export(
    out: Path,
    formats: Mapping[str, Format],
    placed: Any,
    what: str,
    options: Any,
    about: Mapping[str, Any],
    owner: Owner,
    *,
    overwrite: bool = False,
) -> dict[str, Any]:
    """The products of `formats` that `options.products` names, all possible by default, in the folder `out`.

    placed: what the writers take; what: it in words, for errors; about: what export.json says besides the files;
    owner: what is exported. `out` is new, empty, or an earlier export of it, which is replaced; one of something else
    with `overwrite` only. Returns what export.json holds. Raises InputError for products that cannot be written, and
    RunFolderError; `out` then is as it was.
    """
    products = _chosen(formats, placed, what, options)
    missing = {} if options.products else _not_installed(formats, products)
    products = [name for name in products if name not in missing]
    for reason, names in _by_reason(missing).items():
        warn(log, "product-left-out", "left out: %s: %s", ", ".join(names), reason)
    check_folder(out, owner, overwrite)
    with atomic_path(out) as temporary:
        temporary.mkdir()
        files = _write(temporary, formats, placed, products, options)
        content = {
            "format": FORMAT,
            "version": 1,
            "written_by": f"photoclinometry {__version__}",
            **about,
            "owner": owner.as_json(),
            "files": files,
            "left_out": missing,
        }
        write_json(temporary / MANIFEST, content)
    return content


def _write(
    folder: Path, formats: Mapping[str, Format], placed: Any, products: list[str], options: Any
) -> dict[str, str]:
    """Each writer once, for all its products. Raises InputError where a package that a writer needs is missing."""
    files: dict[str, str] = {}
    for write in dict.fromkeys(formats[name].write for name in formats if name in products):
        own = tuple(name for name in products if formats[name].write is write)
        try:
            files |= write(folder, placed, own, options)
        except ModuleNotFoundError as error:
            extra = formats[own[0]].extra
            if extra is None:
                raise
            cure = f"pip install 'photoclinometry[{extra}]', or leave it out of --products"
            raise InputError(f"{own[0]} needs {error.name}: {cure}") from error
    return files


def _chosen(formats: Mapping[str, Format], placed: Any, what: str, options: Any) -> list[str]:
    """The products to write: those asked for, or all possible ones. Raises InputError for products without data."""
    if not options.products:
        return [name for name, product in formats.items() if product.lacks(placed) is None]
    for name in options.products:
        if name not in formats:
            raise InputError(f"no export format {name!r}; known: {', '.join(formats)}")
        why = formats[name].lacks(placed)
        if why is not None:
            raise InputError(f"{what} cannot be exported as {name}: {why}")
    return list(dict.fromkeys(options.products))


def _not_installed(formats: Mapping[str, Format], products: Sequence[str]) -> dict[str, str]:
    """The products whose package is not installed, with what to do."""
    missing = {}
    for name in products:
        package, extra = formats[name].package, formats[name].extra
        if package is not None and find_spec(package) is None:
            missing[name] = f"{package} is not installed: pip install 'photoclinometry[{extra}]'"
    return missing


def _by_reason(missing: dict[str, str]) -> dict[str, list[str]]:
    """The products by the reason why they are left out."""
    found: dict[str, list[str]] = {}
    for name, reason in missing.items():
        found.setdefault(reason, []).append(name)
    return found


def check_folder(out: Path, owner: Owner, overwrite: bool) -> None:
    """Raises RunFolderError for a folder that holds anything but an earlier export, of `owner` unless `overwrite`."""
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    cure = "choose another --out"
    if not out.is_dir():
        raise RunFolderError(f"{out}: is a file, not a folder; {cure}")
    found = None
    try:
        before = parse_json((out / MANIFEST).read_text(encoding="utf-8"))
        own = {MANIFEST, *before["files"]} if before["format"] == FORMAT else set()
        found = read_owner(before)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        own = set()
    others = sorted(path.name for path in out.iterdir() if path.name not in own)
    if others:
        raise RunFolderError(f"{out}: holds {others[0]}, which no earlier export wrote; {cure}")
    if not overwrite and (found is None or not found.is_same(owner)):
        whose = "an export, and not of what" if found is None else f"an export of {found}"
        raise RunFolderError(
            f"{out}: holds {whose}; this is {owner}: {cure}, or give --overwrite (overwrite=True) to replace it"
        )
