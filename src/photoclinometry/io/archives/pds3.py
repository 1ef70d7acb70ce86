"""PDS3 images with attached or detached labels. PDS Standards Reference 3.8, chapters 5 and 14, appendices A and C."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from photoclinometry.io.archives.product import Product
from photoclinometry.io.archives.pvl import MAX_LABEL_BYTES, Block, Quantity, number, parse_pvl, whole
from photoclinometry.io.archives.raw_raster import Layout, check_size, physical_image, read_pixels
from photoclinometry.io.reading import read_image_bytes
from photoclinometry.model.errors import ImageError
from photoclinometry.model.image import Image

_ORDER = {"LSB": "<", "PC": "<", "VAX": "<", "MSB": ">", "IEEE": ">", "SUN": ">", "MAC": ">"}
_SPECIAL = (
    "INVALID_CONSTANT",
    "INVALID_VALUE",
    "MISSING_CONSTANT",
    "MISSING",
    "NULL_CONSTANT",
    "CORE_NULL",
    "CORE_LOW_REPR_SATURATION",
    "CORE_LOW_INSTR_SATURATION",
    "CORE_HIGH_REPR_SATURATION",
    "CORE_HIGH_INSTR_SATURATION",
    "LOW_REPR_SATURATION",
    "LOW_INSTR_SATURATION",
    "HIGH_REPR_SATURATION",
    "HIGH_INSTR_SATURATION",
)
"""Keys of values, as stored, that mark pixels without a measurement."""
_FITS_BLOCK = 2880
"""Bytes; FITS headers are whole blocks."""
_FITS_CARD = 80
"""Bytes of one keyword in a FITS header."""


def read_pds3(path: Path) -> Product:
    """The image of a PDS3 label, attached or detached. Raises ImageError, InputError."""
    label = parse_pvl(read_image_bytes(path, limit=MAX_LABEL_BYTES + 1), str(path))
    image = label.block("IMAGE")
    if image is None:
        held = ", ".join(b.name for b in label.blocks) or "nothing"
        raise ImageError(f"{path}: the label describes no IMAGE (it describes {held}); give the label of an image")
    data, offset = _place(path, label)
    layout = _layout(path, image, offset)
    check_fits(path, data, layout)
    raw = read_pixels(path, data, layout)
    return Product(
        path=path,
        data=data,
        kind="PDS3",
        image=_image(path, image, raw),
        label=label,
        lines_up=_direction(label, "LINE_DISPLAY_DIRECTION", "UP", "DOWN"),
        samples_left=_direction(label, "SAMPLE_DISPLAY_DIRECTION", "LEFT", "RIGHT"),
    )


def _place(path: Path, label: Block) -> tuple[Path, int]:
    """The file that ^IMAGE names, and the offset of the pixels in it [bytes]."""
    pointer = label.get("^IMAGE")
    if pointer is None:
        raise ImageError(f"{path}: the label has no ^IMAGE, so the place of its pixels is unknown; correct the label")
    parts: list[Any] = list(pointer) if isinstance(pointer, tuple) and not isinstance(pointer, Quantity) else [pointer]
    data = path
    if parts and isinstance(parts[0], str):
        data = find_beside(path, parts.pop(0))
    where = parts[0] if parts else 1
    if isinstance(where, Quantity) and where.unit.startswith("byte"):
        return data, int(where.value) - 1
    if not isinstance(where, int):
        raise ImageError(f"{path}: ^IMAGE = {pointer!r} is not understood; correct the label")
    if where == 1:
        return data, 0
    record = label.get("RECORD_BYTES")
    if not isinstance(record, int) or record < 1:
        raise ImageError(f"{path}: ^IMAGE counts records, but RECORD_BYTES is {record!r}; correct the label")
    return data, (where - 1) * record


def find_beside(path: Path, name: str) -> Path:
    """The file `name` in the folder of a label, ignoring case and any folder in `name`. Raises ImageError."""
    bare = name.replace("\\", "/").rsplit("/", 1)[-1]
    for found in sorted(path.parent.iterdir()):
        if found.name.lower() == bare.lower() and found.is_file():
            return found
    raise ImageError(f"{path}: its pixels are in {bare}, which is not beside it; put it into the same folder")


def _layout(path: Path, image: Block, offset: int) -> Layout:
    encoding = image.get("ENCODING_TYPE", "N/A")
    if str(encoding).upper() not in ("N/A", "NONE"):
        raise ImageError(f"{path}: its pixels are compressed ({encoding}); decompress it first, or get it as FITS")
    bands = image.get("BANDS", 1)
    if bands != 1:
        raise ImageError(f"{path}: has {bands} bands; export one of them")
    return Layout(
        offset=offset,
        lines=whole(path, image, "LINES"),
        samples=whole(path, image, "LINE_SAMPLES"),
        dtype=_dtype(path, image),
        prefix=whole(path, image, "LINE_PREFIX_BYTES", 0),
        suffix=whole(path, image, "LINE_SUFFIX_BYTES", 0),
    )


def _dtype(path: Path, image: Block) -> np.dtype:
    name, bits = str(image.get("SAMPLE_TYPE")).upper(), whole(path, image, "SAMPLE_BITS")
    first = name.split("_")[0]
    order = _ORDER.get(first, ">")
    kind = "f" if name.endswith(("REAL", "FLOAT")) else "u" if "UNSIGNED" in name else "i"
    known = first in _ORDER or name in ("INTEGER", "UNSIGNED_INTEGER", "REAL", "FLOAT")
    if not known or bits not in ((32, 64) if kind == "f" else (8, 16, 32)) or (first == "VAX" and kind == "f"):
        raise ImageError(f"{path}: pixels of type {name}, {bits} bits, are not known; convert it to FITS")
    # Labels call eight-bit counts from 0 to 255 "integer", but no camera's counts are negative.
    kind = "u" if bits == 8 else kind
    return np.dtype(f"{order}{kind}{bits // 8}")


def _image(path: Path, image: Block, raw: np.ndarray) -> Image:
    valid = np.isfinite(raw) if raw.dtype.kind == "f" else raw != np.iinfo(raw.dtype).max
    for value in _special_values(image, raw.dtype):
        valid &= raw != value
    top = image.get("PIXEL_SATURATION_VALUE")
    if isinstance(top, int | float):
        valid &= raw < top
    factor, offset = number(path, image, "SCALING_FACTOR", 1.0), number(path, image, "OFFSET", 0.0)
    return physical_image(path, raw, valid, factor, offset)


def _special_values(image: Block, dtype: np.dtype) -> Iterator[Any]:
    for key in _SPECIAL:
        values = image.get(key)
        for value in values if isinstance(values, tuple) and not isinstance(values, Quantity) else (values,):
            if isinstance(value, int | float):
                yield dtype.type(value) if dtype.kind == "f" else value
            elif isinstance(value, str) and value.startswith("16#") and value.endswith("#"):
                yield _from_bits(value[3:-1], dtype)


def _from_bits(digits: str, dtype: np.dtype) -> Any:
    """The value with these stored bits, such as FF7FFFFB of 16#FF7FFFFB#; NaN, equal to no pixel, for wrong digits."""
    try:
        bits = bytes.fromhex(digits.rjust(2 * dtype.itemsize, "0"))
    except ValueError:
        return np.nan
    return np.frombuffer(bits, dtype.newbyteorder(">"))[0] if len(bits) == dtype.itemsize else np.nan


def check_fits(path: Path, data: Path, layout: Layout) -> None:
    """Raises ImageError if the data file is FITS and holds another number of pixels than the label gives."""
    head = read_image_bytes(data, limit=10 * _FITS_BLOCK)
    if not head.startswith(b"SIMPLE"):
        return
    size = {}
    for at in range(0, len(head) - _FITS_CARD + 1, _FITS_CARD):
        card = head[at : at + _FITS_CARD]
        if card[:6] in (b"NAXIS1", b"NAXIS2") and card[10:30].strip().isdigit():
            size[card[:6]] = int(card[10:30])
        if card.startswith(b"END "):
            break
    found = (size.get(b"NAXIS2", layout.lines), size.get(b"NAXIS1", layout.samples))
    check_size(data, *found)
    if found != (layout.lines, layout.samples):
        raise ImageError(
            f"{path}: the label gives {layout.lines} lines of {layout.samples} samples, but {data.name} holds "
            f"{found[0]} of {found[1]}; correct the label, or give the FITS file alone"
        )


def _direction(label: Block, key: str, yes: str, no: str) -> bool | None:
    return {yes: True, no: False}.get(str(label.find(key)).upper())
