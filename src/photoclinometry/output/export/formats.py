"""The products that an export can hold. A format is one entry of FORMATS: all else follows from this table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from photoclinometry.io.meshes.ply import write_ply
from photoclinometry.io.models.colmap import write_colmap
from photoclinometry.io.models.text_model import write_text_model
from photoclinometry.output.export.frame import Framed
from photoclinometry.output.export.maps import write_maps
from photoclinometry.output.export.meshes import write_meshes
from photoclinometry.output.export.sumfiles import write_sumfiles
from photoclinometry.output.export.tables import write_tables
from photoclinometry.output.viewer import write_viewer

Written = dict[str, str]
"""Content of each file, by the file's name in the export's folder."""
Writer = Callable[[Path, Any, tuple[str, ...], Any], Written]
"""(folder, scene in its frame, products of this writer that are asked for, `ExportOptions`) -> `Written`; of a whole
body the second is a `PlacedShape`."""


def _always(framed: Any) -> str | None:
    return None


@dataclass(frozen=True, kw_only=True)
class Format:
    """One product of an export."""

    name: str
    about: str
    """The product, in words for the command's help."""
    write: Writer
    """Products that share a writer are written by one call. Raises InputError and RunFolderError."""
    extra: str | None = None
    """The optional dependency in pyproject.toml that the writer needs."""
    package: str | None = None
    """The package of that extra which the writer imports."""
    lacks: Callable[[Any], str | None] = _always
    """Why a scene cannot be exported so; None: it can."""


def _geometry_alone(framed: Framed) -> str | None:
    return "it holds geometry alone" if framed.scene.reflectance is None else None


def _no_sigmas(framed: Framed) -> str | None:
    stated = {"position", "normal", "albedo"} & set(framed.scene.uncertainty)
    return None if stated else "it states no uncertainties"


def _no_globe(framed: Framed) -> str | None:
    known = framed.globe is not None
    return None if known else "it is in no body-fixed frame; give --transform, or --body-fixed with --unit-m"


def _meshes(folder: Path, framed: Framed, products: tuple[str, ...], options: Any) -> Written:
    return write_meshes(folder, framed, "obj" in products, "gltf" in products)


def _ply(folder: Path, framed: Framed, products: tuple[str, ...], options: Any) -> Written:
    write_ply(folder / "landmarks.ply", framed.scene, mesh=True, unit="m" if framed.metric else None)
    return {"landmarks.ply": "landmarks as a mesh, with normals, albedos and standard deviations"}


def _colmap(folder: Path, framed: Framed, products: tuple[str, ...], options: Any) -> Written:
    write_colmap(folder / "sparse", framed.scene, max_points=len(framed.scene.landmarks))
    return {"sparse": "COLMAP model with all landmarks"}


def _text_model(folder: Path, framed: Framed, products: tuple[str, ...], options: Any) -> Written:
    tracks = framed.scene.tracks
    # Read noise puts dark ground below zero, where the format has its mark for what is not lit.
    dark = tracks.lit & (tracks.brightness < 0)
    write_text_model(folder / "model", replace(framed.scene, tracks=replace(tracks, lit=tracks.lit & ~dark)))
    omitted = f"; {dark.sum():,} keypoints of negative brightness are marked as not lit" if dark.any() else ""
    return {"model": f"text model of the paper's authors, albedos are normal albedos{omitted}"}


def _sumfiles(folder: Path, framed: Framed, products: tuple[str, ...], options: Any) -> Written:
    return write_sumfiles(folder / "sumfiles", framed)


def _tables(folder: Path, framed: Framed, products: tuple[str, ...], options: Any) -> Written:
    return write_tables(folder, framed)


def _viewer(folder: Path, framed: Framed, products: tuple[str, ...], options: Any) -> Written:
    write_viewer(folder / "viewer.html", framed.scene)
    return {"viewer.html": "page for the browser: the map under any Sun, without the images"}


_GEO = {"write": write_maps, "extra": "geo", "package": "rasterio"}

_ALL = (
    Format(name="dtm", about="GeoTIFF of heights", **_GEO),
    Format(name="albedo", about="GeoTIFF of albedos", lacks=_geometry_alone, **_GEO),
    Format(name="normals", about="GeoTIFF of unit normals", **_GEO),
    Format(name="slope", about="GeoTIFF of slopes", **_GEO),
    Format(name="reflectance", about="GeoTIFF at a standard geometry", lacks=_geometry_alone, **_GEO),
    Format(name="sigma", about="GeoTIFFs of standard deviations", lacks=_no_sigmas, **_GEO),
    Format(name="obj", about="mesh with the albedo as its texture", write=_meshes),
    Format(name="gltf", about="the same as one file", write=_meshes),
    Format(name="ply", about="landmarks as a mesh", write=_ply),
    Format(name="colmap", about="poses and landmarks as a COLMAP model", write=_colmap),
    Format(name="text-model", about="the format of the paper's authors", write=_text_model),
    Format(name="sumfile", about="one per view, for stereophotoclinometry (SPC)", write=_sumfiles, lacks=_no_globe),
    Format(name="viewer", about="page for the browser, with the Sun to be moved", write=_viewer),
    Format(name="csv", about="landmarks and views as tables", write=_tables),
)

FORMATS: dict[str, Format] = {product.name: product for product in _ALL}
"""In the order in which they are written."""
