"""PDS4 images: an XML label beside a file of raw or FITS pixels. PDS4 Information Model, Array_2D_Image."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from photoclinometry.io.archives.pds3 import check_fits, find_beside
from photoclinometry.io.archives.product import Product
from photoclinometry.io.archives.pvl import Block, Quantity, number, whole
from photoclinometry.io.archives.raw_raster import Layout, physical_image, read_pixels
from photoclinometry.io.reading import read_image_bytes
from photoclinometry.model.errors import ImageError
from photoclinometry.model.image import Image

_MAX_BYTES = 1 << 24
"""16 MiB: labels have some kilobytes; larger files are something else."""
_MAX_DEPTH = 40
"""Nested elements; labels have about 10, and recursion must end."""
_TYPES = {
    "IEEE754MSBSingle": ">f4",
    "IEEE754LSBSingle": "<f4",
    "IEEE754MSBDouble": ">f8",
    "IEEE754LSBDouble": "<f8",
    "SignedMSB2": ">i2",
    "SignedLSB2": "<i2",
    "UnsignedMSB2": ">u2",
    "UnsignedLSB2": "<u2",
    "SignedMSB4": ">i4",
    "SignedLSB4": "<i4",
    "UnsignedMSB4": ">u4",
    "UnsignedLSB4": "<u4",
    "UnsignedByte": "u1",
}


def read_pds4(path: Path) -> Product:
    """The first two-axis image of a PDS4 label. Raises ImageError, InputError."""
    label = _label(path)
    for area in (b for b in label.walk() if b.name.startswith("FILE_AREA")):
        array = next((b for b in area.blocks if b.name.startswith("ARRAY_2D")), None)
        file = area.block("FILE")
        if array is not None and file is not None:
            data = find_beside(path, str(file.get("FILE_NAME")))
            break
    else:
        raise ImageError(f"{path}: the label describes no two-axis image (Array_2D_Image); give the label of an image")
    layout = _layout(path, array)
    check_fits(path, data, layout)
    raw = read_pixels(path, data, layout)
    display = next((b for b in label.walk() if b.name == "DISPLAY_DIRECTION"), Block(""))
    return Product(
        path=path,
        data=data,
        kind="PDS4",
        image=_image(path, array, raw),
        label=label,
        lines_up=_direction(display.get("VERTICAL_DISPLAY_DIRECTION"), "Bottom to Top", "Top to Bottom"),
        samples_left=_direction(display.get("HORIZONTAL_DISPLAY_DIRECTION"), "Right to Left", "Left to Right"),
    )


def _label(path: Path) -> Block:
    data = read_image_bytes(path, limit=_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise ImageError(f"{path}: is larger than {_MAX_BYTES >> 20} MiB, so it is not a PDS4 label; check the path")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ImageError(f"{path}: declares a document type or entities, which no PDS4 label does; remove them")
    try:
        return _block(path, ElementTree.fromstring(data), 0)
    except (ElementTree.ParseError, UnicodeError, LookupError, ValueError) as error:
        raise ImageError(f"{path}: the label is not complete XML ({error}); fetch it again") from error


def _block(path: Path, element: ElementTree.Element, depth: int) -> Block:
    """An element as a block; children that hold text alone become statements. Names in upper case, no namespace."""
    if depth > _MAX_DEPTH:
        raise ImageError(f"{path}: elements are nested more than {_MAX_DEPTH} deep, so it is not a PDS4 label")
    block = Block(_name(element))
    for child in element:
        if len(child):
            block.blocks.append(_block(path, child, depth + 1))
        else:
            block.statements.append((_name(child), _value((child.text or "").strip(), child.get("unit"))))
    return block


def _name(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2].upper()


def _value(text: str, unit: str | None) -> Any:
    try:
        value: Any = int(text) if text.lstrip("+-").isdigit() and len(text) < 19 else float(text)
    except ValueError:
        return text
    return Quantity(float(value), unit.lower()) if unit else value


def _layout(path: Path, array: Block) -> Layout:
    if array.get("AXES") != 2 or array.get("AXIS_INDEX_ORDER", "Last Index Fastest") != "Last Index Fastest":
        raise ImageError(f"{path}: the array's axes are not two in the order lines, samples; convert it to FITS")
    size = {b.get("SEQUENCE_NUMBER"): whole(path, b, "ELEMENTS") for b in array.blocks if b.name == "AXIS_ARRAY"}
    element = array.block("ELEMENT_ARRAY") or Block("")
    kind = _TYPES.get(str(element.get("DATA_TYPE")))
    if kind is None:
        raise ImageError(f"{path}: pixels of type {element.get('DATA_TYPE')!r} are not known; convert it to FITS")
    if set(size) != {1, 2}:
        raise ImageError(f"{path}: the array has no Axis_Array 1 and 2; correct the label")
    return Layout(offset=whole(path, array, "OFFSET", 0), lines=size[1], samples=size[2], dtype=np.dtype(kind))


def _image(path: Path, array: Block, raw: np.ndarray) -> Image:
    valid = np.isfinite(raw) if raw.dtype.kind == "f" else raw != np.iinfo(raw.dtype).max
    for _, value in (array.block("SPECIAL_CONSTANTS") or Block("")).statements:
        value = getattr(value, "value", value)
        if isinstance(value, int | float):
            valid &= raw != (raw.dtype.type(value) if raw.dtype.kind == "f" else value)
    element = array.block("ELEMENT_ARRAY") or Block("")
    factor, offset = number(path, element, "SCALING_FACTOR", 1.0), number(path, element, "VALUE_OFFSET", 0.0)
    return physical_image(path, raw, valid, factor, offset)


def _direction(written: Any, yes: str, no: str) -> bool | None:
    return {yes.lower(): True, no.lower(): False}.get(str(written).lower())
