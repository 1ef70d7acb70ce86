"""A scene as files that other programs open: one folder, whole or not at all."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from photoclinometry import __version__
from photoclinometry.io.atomic import atomic_path, write_text
from photoclinometry.io.meshes.ply import write_ply
from photoclinometry.io.models.colmap import write_colmap
from photoclinometry.io.models.text_model import write_text_model
from photoclinometry.model.errors import InputError, RunFolderError
from photoclinometry.model.scene import Scene
from photoclinometry.output.export.frame import Framed, framed
from photoclinometry.output.export.maps import possible_maps, write_maps
from photoclinometry.output.export.meshes import write_meshes
from photoclinometry.output.export.options import ExportOptions, MapProduct, Product
from photoclinometry.output.export.sumfiles import write_sumfiles
from photoclinometry.output.export.tables import write_tables

log = logging.getLogger(__name__)

MANIFEST = "export.json"
FORMAT = "photoclinometry export"
_MAPS: tuple[MapProduct, ...] = get_args(MapProduct)


def export_scene(scene: Scene, out: Path | str, options: ExportOptions | None = None) -> dict[str, Any]:
    """The products in the folder `out`, with export.json, which says the frame and its unit, and what each file is.

    `out` is new, empty, or an earlier export, which is replaced. Returns what export.json holds. Raises InputError for
    products that the scene or its frame does not allow, and RunFolderError; `out` then is as it was.
    """
    options, out = options or ExportOptions(), Path(out).resolve()
    placed = framed(scene, options)
    products = _chosen(placed, options)
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
        }
        write_text(temporary / MANIFEST, json.dumps(about, indent=1, default=str) + "\n")
    return about


def _write(folder: Path, placed: Framed, products: list[Product], options: ExportOptions) -> dict[str, str]:
    scene, files = placed.scene, {}
    maps: list[MapProduct] = [product for product in _MAPS if product in products]
    if maps:
        files |= write_maps(folder, placed, maps, options)
    if "obj" in products or "gltf" in products:
        files |= write_meshes(folder, placed, "obj" in products, "gltf" in products)
    if "ply" in products:
        write_ply(folder / "landmarks.ply", scene, mesh=True)
        files["landmarks.ply"] = "landmarks as a mesh, with normals, albedos and standard deviations"
    if "colmap" in products:
        write_colmap(folder / "sparse", scene, max_points=len(scene.landmarks))
        files["sparse"] = "COLMAP model with all landmarks"
    if "text-model" in products:
        write_text_model(folder / "model", scene)
        files["model"] = "text model of the paper's authors, albedos are normal albedos"
    if "sumfile" in products:
        files |= write_sumfiles(folder / "sumfiles", placed)
    if "csv" in products:
        files |= write_tables(folder, placed)
    return files


def _chosen(placed: Framed, options: ExportOptions) -> list[Product]:
    """What to write. Raises InputError for what there is nothing for."""
    others: tuple[Product, ...] = ("obj", "gltf", "ply", "colmap", "text-model", "csv")
    of_body: tuple[Product, ...] = ("sumfile",) if placed.globe is not None else ()
    possible: list[Product] = [*possible_maps(placed), *others, *of_body]
    if not options.products:
        return possible
    why = {
        "sigma": "it states no uncertainties",
        "albedo": "it holds geometry alone",
        "reflectance": "it holds geometry alone",
        "sumfile": "it is in no body-fixed frame; give --transform, or --body-fixed with --unit-m",
    }
    for product in options.products:
        if product not in possible:
            raise InputError(f"scene {placed.scene.name!r} cannot be exported as {product}: {why[product]}")
    return list(dict.fromkeys(options.products))


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
