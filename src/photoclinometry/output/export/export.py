"""A scene as files that other programs open: one folder, whole or not at all."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from photoclinometry.model.errors import InputError
from photoclinometry.model.owner import Owner
from photoclinometry.model.scene import Scene
from photoclinometry.output.export.folder import write_export
from photoclinometry.output.export.formats import FORMATS
from photoclinometry.output.export.frame import framed
from photoclinometry.output.export.options import ExportOptions
from photoclinometry.output.export.shape.formats import SHAPE_FORMATS


def export_scene(
    scene: Scene, out: Path | str, options: ExportOptions | None = None, *, overwrite: bool = False
) -> dict[str, Any]:
    """The products in the folder `out`, with export.json, which says the frame and its unit, and what each file is.

    `out` is new, empty, or an earlier export of the map, which is replaced; one of another map with `overwrite` only: a
    map is known by its views and their stated Suns. Without `options.products`, products whose extra is
    not installed are left out, with the reason in the log and under "left_out". Returns what export.json holds. Raises
    InputError for products that the scene or its frame does not allow, and RunFolderError; `out` then is as it was.
    """
    options = options or ExportOptions()
    for name in options.products:
        if name in SHAPE_FORMATS and name not in FORMATS:
            raise InputError(
                f"{name} is a product of a whole body, and this is the map of a place: {', '.join(FORMATS)}"
            )
    placed = framed(scene, options)
    about = {
        "scene": scene.name,
        "body": options.body or scene.body,
        "frame": placed.words,
        "options": asdict(options),
    }
    what = f"scene {scene.name!r}"
    return write_export(Path(out), FORMATS, placed, what, options, about, _owner(scene), overwrite=overwrite)


def _owner(scene: Scene) -> Owner:
    """The identity of a map, which stays when the site is mapped again."""
    views = zip(scene.views.name, scene.views.sun_measured, strict=True)
    known = tuple(f"{name} {x:.4f} {y:.4f} {z:.4f}" for name, (x, y, z) in views)
    return Owner("map", scene.name, scene.body, "", known)
