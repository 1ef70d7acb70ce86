"""`phomo export`: a map for GIS, viewers and other reconstruction programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.output.export.formats import FORMATS, Format
from photoclinometry.output.export.options import ExportOptions
from photoclinometry.output.export.shape.formats import SHAPE_FORMATS
from photoclinometry.output.export.shape.options import ShapeOptions


def export(
    run: tyro.conf.Positional[Path],
    /,
    out: Path,
    overwrite: bool = False,
    options: Annotated[ExportOptions, tyro.conf.arg(name="")] = ExportOptions(),  # noqa: B008
    body_options: Annotated[ShapeOptions, tyro.conf.arg(name="")] = ShapeOptions(),  # noqa: B008
) -> None:
    """Export the map of a place, or a whole body, as GeoTIFF, meshes, models and tables.

    A map made from images alone is in a frame and a unit of its own, which no reference system describes: its GeoTIFFs
    are maps of its mean plane, in metres where --unit-m says so. Say where on the body it lies (--transform, or
    --body-fixed), and they are maps of the body.

    A whole body is a folder with body.ply, or a PLY file: a closed mesh in the body-fixed frame, z along the axis.
    Slope, elevation and gravity need its density (--density-kg-m3) and spin (--spin-period-h).

    Formats: {formats}.
    Of a whole body: {shape_formats}.

    Args:
        run: Folder of a finished run, or of a whole body.
        out: Folder for the products; new, empty, or an earlier export of the same map, which is replaced.
        overwrite: Replace an export of another map or body; without it, such a folder is refused.
        options: What to export, and what is known of the map's frame.
        body_options: Of whole bodies.
    """
    from rich.console import Console

    import photoclinometry as pcm
    from photoclinometry.io.meshes.shape_ply import read_shape_ply
    from photoclinometry.output.export import export_scene
    from photoclinometry.output.export.shape.export import (
        check_no_shape_options,
        export_shape,
        is_shape,
        shape_file,
    )
    from photoclinometry.pipeline.folder.run_mark import owner_of_folder

    if is_shape(run):
        path = shape_file(run)
        shape, owner = read_shape_ply(path), owner_of_folder(run)
        exported = export_shape(
            shape, out, options, body_options, name=path.name, path=path, owner=owner, overwrite=overwrite
        )
    else:
        check_no_shape_options(body_options)
        exported = export_scene(pcm.read_scene(run), out, options, overwrite=overwrite)
    console = Console(stderr=True, soft_wrap=True)
    for name, about in exported["files"].items():
        console.print(f"{name}: {about}", highlight=False, markup=False)
    if exported["left_out"]:
        names, reason = ", ".join(exported["left_out"]), next(iter(exported["left_out"].values()))
        console.print(f"left out: {names}: {reason}", highlight=False, markup=False)
    for name, reason in exported.get("not_possible", {}).items():
        console.print(f"left out: {name}: {reason}", highlight=False, markup=False)
    console.print(f"frame: {exported['frame']}", highlight=False, markup=False)
    print(out)


def _listed(formats: Mapping[str, Format]) -> str:
    return "; ".join(f"{product.name}: {product.about}" for product in formats.values())


export.__doc__ = (
    (export.__doc__ or "").replace("{formats}", _listed(FORMATS)).replace("{shape_formats}", _listed(SHAPE_FORMATS))
)
