"""A scene as files that other programs open: one folder, whole or not at all."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from photoclinometry import __version__
from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.scene import Scene
from photoclinometry.model.warning import warn
from photoclinometry.output.export.formats import FORMATS
from photoclinometry.output.export.frame import Framed, framed
from photoclinometry.output.export.options import ExportOptions

log = logging.getLogger(__name__)

MANIFEST = "export.json"
FORMAT = "photoclinometry export"


def export_scene(scene: Scene, out: Path | str, options: ExportOptions | None = None) -> dict[str, Any]:
    """The products in the folder `out`, with export.json, which says the frame and its unit, and what each file is.

    `out` is new, empty, or an earlier export, which is replaced. Without `options.products`, products whose extra is
    not installed are left out, with the reason in the log and under "left_out". Returns what export.json holds. Raises
    InputError for products that the scene or its frame does not allow, and RunFolderError; `out` then is as it was.
    """
    options, out = options or ExportOptions(), Path(out).resolve()
    placed = framed(scene, options)
    products = _chosen(placed, options)
    missing = {} if options.products else _not_installed(products)
    products = [name for name in products if name not in missing]
    for reason, names in _by_reason(missing).items():
        warn(log, "product-left-out", "left out: %s: %s", ", ".join(names), reason)
    _check_folder(out)
    with atomic_path(out) as temporary:
        temporary.mkdir()
        files = _write(temporary, placed, products, options)
        about = {
            "format": FORMAT,
            "version": 1,
            "written_by": f"photoclinometry {__version__}",
            "scene": scene.name,
            "body": options.body or scene.body,
            "frame": placed.words,
            "options": asdict(options),
            "files": files,
            "left_out": missing,
        }
        write_text(temporary / MANIFEST, json.dumps(about, indent=1, default=str) + "\n")
    return about


def _write(folder: Path, placed: Framed, products: list[str], options: ExportOptions) -> dict[str, str]:
    """Each writer once, for all its products. Raises InputError where a package that a writer needs is missing."""
    files: dict[str, str] = {}
    for write in dict.fromkeys(FORMATS[name].write for name in FORMATS if name in products):
        own = tuple(name for name in products if FORMATS[name].write is write)
        try:
            files |= write(folder, placed, own, options)
        except ModuleNotFoundError as error:
            extra = FORMATS[own[0]].extra
            if extra is None:
                raise
            cure = f"pip install 'photoclinometry[{extra}]', or leave it out of --products"
            raise InputError(f"{own[0]} needs {error.name}: {cure}") from error
    return files


def _chosen(placed: Framed, options: ExportOptions) -> list[str]:
    """What to write: what is asked for, or all that is possible. Raises InputError for what there is nothing for."""
    if not options.products:
        return [name for name, product in FORMATS.items() if product.lacks(placed) is None]
    for name in options.products:
        if name not in FORMATS:
            raise InputError(f"no export format {name!r}; known: {', '.join(FORMATS)}")
        why = FORMATS[name].lacks(placed)
        if why is not None:
            raise InputError(f"scene {placed.scene.name!r} cannot be exported as {name}: {why}")
    return list(dict.fromkeys(options.products))


def _not_installed(products: Sequence[str]) -> dict[str, str]:
    """The products whose package is not installed, with what to do."""
    missing = {}
    for name in products:
        package, extra = FORMATS[name].package, FORMATS[name].extra
        if package is not None and find_spec(package) is None:
            missing[name] = f"{package} is not installed: pip install 'photoclinometry[{extra}]'"
    return missing


def _by_reason(missing: dict[str, str]) -> dict[str, list[str]]:
    """The products by the reason why they are left out."""
    found: dict[str, list[str]] = {}
    for name, reason in missing.items():
        found.setdefault(reason, []).append(name)
    return found


def _check_folder(out: Path) -> None:
    """Raises RunFolderError for a folder that holds anything but an earlier export."""
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    cure = "choose another --out"
    if not out.is_dir():
        raise RunFolderError(f"{out}: is a file, not a folder; {cure}")
    try:
        before = json.loads((out / MANIFEST).read_text(encoding="utf-8"))
        own = {MANIFEST, *before["files"]} if before["format"] == FORMAT else set()
    except (OSError, ValueError, KeyError, TypeError):
        own = set()
    others = sorted(path.name for path in out.iterdir() if path.name not in own)
    if others:
        raise RunFolderError(f"{out}: holds {others[0]}, which no earlier export wrote; {cure}")
