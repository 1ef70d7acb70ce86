"""`phomo export`: a map for GIS, viewers and other reconstruction programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.output.export.formats import FORMATS
from photoclinometry.output.export.options import ExportOptions


def export(
    run: tyro.conf.Positional[Path],
    /,
    out: Path,
    options: Annotated[ExportOptions, tyro.conf.arg(name="")] = ExportOptions(),  # noqa: B008
) -> None:
    """Export a map as GeoTIFF, meshes, models and tables.

    A map made from images alone is in a frame and a unit of its own, which no reference system describes: its GeoTIFFs
    are maps of its mean plane, in metres where --unit-m says so. Say where on the body it lies (--transform, or
    --body-fixed), and they are maps of the body.

    Formats: {formats}.

    Args:
        run: Folder of a finished run.
        out: Folder for the products; new, empty, or an earlier export, which is replaced.
        options: What to export, and what is known of the map's frame.
    """
    from rich.console import Console

    import photoclinometry as pcm
    from photoclinometry.output.export import export_scene

    exported = export_scene(pcm.read_scene(run), out, options)
    console = Console(stderr=True, soft_wrap=True)
    for name, about in exported["files"].items():
        console.print(f"{name}: {about}", highlight=False, markup=False)
    if exported["left_out"]:
        names, reason = ", ".join(exported["left_out"]), next(iter(exported["left_out"].values()))
        console.print(f"left out: {names}: {reason}", highlight=False, markup=False)
    console.print(f"frame: {exported['frame']}", highlight=False, markup=False)
    print(out)


_FORMATS = "; ".join(f"{product.name}: {product.about}" for product in FORMATS.values())
export.__doc__ = (export.__doc__ or "").replace("{formats}", _FORMATS)
