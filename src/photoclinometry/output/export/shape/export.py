"""A whole body as files that other programs open: one folder, whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.options import options_for_json
from photoclinometry.io.run_files import BODY_FILE, is_body
from photoclinometry.model.errors import InputError
from photoclinometry.model.geometry import METRES, Similarity
from photoclinometry.model.owner import Owner
from photoclinometry.model.shape_model import ShapeModel
from photoclinometry.output.export.folder import write_export
from photoclinometry.output.export.formats import FORMATS
from photoclinometry.output.export.options import ExportOptions
from photoclinometry.output.export.shape.formats import SHAPE_FORMATS
from photoclinometry.output.export.shape.options import ShapeOptions
from photoclinometry.output.export.shape.placed import PlacedShape, placed_shape

_OF_PLACES = ("transform", "site", "body_fixed", "projection", "center_deg", "standard_geometry_deg")
"""Options that do not apply to whole bodies, which are in the body-fixed frame."""


def is_shape(path: Path) -> bool:
    """Whether a path is a shape model: a PLY file, or the folder of a body."""
    return path.suffix.lower() == ".ply" if path.is_file() else is_body(path)


def shape_file(path: Path) -> Path:
    """The file of the shape model at a path for which `is_shape` holds."""
    return path if path.is_file() else path / BODY_FILE


def export_shape(
    shape: ShapeModel,
    out: Path | str,
    options: ExportOptions | None = None,
    shape_options: ShapeOptions | None = None,
    *,
    name: str = BODY_FILE,
    path: Path | None = None,
    owner: Owner | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """The products of a closed, body-fixed model in the folder `out`, with export.json, which says what each file is.

    The frame's origin is inside, z is the axis of rotation, x at longitude zero. Without `options.products`, all that
    the model and the options allow are written, the others are in "not_possible" with the reason. name: of the model,
    for files; path: where it was read, for errors, by default its name. owner: what it was made of; by default its name
    stands for it. An earlier export of another owner is replaced with `overwrite` only. Returns what export.json holds.
    Raises InputError for options that are wrong or do not apply, models that are not closed, and products that are not
    possible; RunFolderError; `out` then is as it was.
    """
    options, shape_options = options or ExportOptions(), shape_options or ShapeOptions()
    _check_options(options)
    where = str(path or name)
    shape = _in_metres(shape, options.unit_m)
    _check_metres(shape, shape_options, where)
    placed = placed_shape(
        shape,
        name,
        shape_options,
        where=where,
        body=options.body,
        radii_m=options.radii_m,
        resolution=options.resolution,
    )
    about = {
        "body": options.body,
        "frame": _frame_words(placed),
        "options": options_for_json(asdict(options) | asdict(shape_options)),
        "not_possible": {} if options.products else _not_possible(placed),
    }
    owner = owner or Owner("body", name, options.body, "", ())
    return write_export(Path(out), SHAPE_FORMATS, placed, where, options, about, owner, overwrite=overwrite)


def check_no_shape_options(options: ShapeOptions) -> None:
    """Raises InputError for options of whole bodies that are given with the map of a place."""
    changed = _changed(options, ShapeOptions())
    if changed:
        raise InputError(f"{changed} is for a whole body (a folder with {BODY_FILE}); this is the map of a place")


def _check_options(options: ExportOptions) -> None:
    plain = replace(
        ExportOptions(), **{f.name: getattr(options, f.name) for f in fields(options) if f.name in _OF_PLACES}
    )
    changed = _changed(plain, ExportOptions())
    if changed:
        raise InputError(f"{changed} is for the map of a place; this is a whole body, in the body-fixed frame already")
    for product in options.products:
        if product in FORMATS and product not in SHAPE_FORMATS:
            raise InputError(
                f"{product} is a product of the map of a place; of a whole body: {', '.join(SHAPE_FORMATS)}"
            )


def _changed(options: Any, plain: Any) -> str | None:
    """The first option, as typed, that differs from its default."""
    for field in fields(options):
        if getattr(options, field.name) != getattr(plain, field.name):
            return "--" + field.name.replace("_", "-")
    return None


def _in_metres(shape: ShapeModel, unit_m: float | None) -> ShapeModel:
    """The model in metres, if its unit is known or given. Raises InputError where both are, and differ."""
    stated = None if shape.unit is None else METRES[shape.unit]
    if unit_m is not None and stated is not None and unit_m != stated:
        raise InputError(f"the model is in {shape.unit} already: leave out --unit-m")
    scale = unit_m if stated is None else stated
    if scale is None:
        return shape
    return shape.moved(Similarity(scale, np.eye(3), np.zeros(3)), "m")


def _check_metres(shape: ShapeModel, options: ShapeOptions, where: str) -> None:
    """Raises InputError for options in metres of a model whose unit is not known."""
    for name in ("density_kg_m3", "correlation_m"):
        if shape.unit != "m" and getattr(options, name) is not None:
            raise InputError(f"{where}: its unit is not known: --{name.replace('_', '-')} goes with --unit-m")


def _frame_words(placed: PlacedShape) -> str:
    unit = "in metres" if placed.shape.unit == "m" else "in an unknown unit"
    return f"that of {placed.name}, {unit}"


def _not_possible(placed: PlacedShape) -> Mapping[str, str]:
    reasons = {name: product.lacks(placed) for name, product in SHAPE_FORMATS.items()}
    return {name: reason for name, reason in reasons.items() if reason is not None}
